//! Speed of the fused training kernel against candle's autograd, in one interleaved run.
//!
//! `CANDLE_CPU_MASK=0 cargo run --release -p bake-train --example fused_against_candle [TIER]`: the variable keeps
//! candle from counting the processors before every product. One-core speeds are by processor time of the
//! thread, those of two cores by the clock, each the best of its rounds; shares are of the peak that a loop of
//! independent multiply-adds reaches in the same rounds. Operations counted are those of the matrix products,
//! without the gradient by the inputs, which nobody needs.

use bake_runtime::Rng;
use bake_runtime::network::Dense;
use bake_runtime::simd::{Simd, Tier, Vector};
use bake_train::bench::peak::{CHAINS, Chains};
use bake_train::fused::{Features, Fused, Nonlinearity, Outputs, OutputsMut, Shape, TileLoss};
use bake_train::nn::mlp::Mlp;
use candle_core::{Device, Tensor};
use std::hint::black_box;
use std::io::Write;
use std::ops::Range;
use std::time::Instant;

/// As in the program.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Queries of a step.
const QUERIES: usize = 8192;
/// Queries that candle gets at a time: its tensors then stay in the cache, where it is fastest.
const CANDLE_QUERIES: usize = 512;
/// Rounds, of which the best counts.
const ROUNDS: usize = 12;
/// Steps of a round, one after the other as in training. By the clock each is measured alone: short enough that
/// on a busy machine some are left in peace.
const STEPS: usize = 5;
/// Width of input and output.
const ENDS: (usize, usize) = (32, 5);
/// (hidden layers, width).
const NETWORKS: [(usize, usize); 4] = [(6, 64), (6, 128), (4, 32), (4, 64)];

/// Half the sum of all outputs' squares, over all columns.
struct Squares<'a> {
    features: &'a [f32],
    columns: usize,
}

impl TileLoss for Squares<'_> {
    #[inline(always)]
    fn features<S: Simd>(&self, _: S, queries: Range<usize>, rows: &mut Features) {
        for column in 0..self.columns {
            for (i, query) in queries.clone().enumerate() {
                let row = &self.features[(column * QUERIES + query) * ENDS.0..][..ENDS.0];
                rows.row(column, i).copy_from_slice(row);
            }
        }
    }

    #[inline(always)]
    fn loss<S: Simd>(&self, simd: S, _: Range<usize>, outputs: &Outputs, gradient: &mut OutputsMut) -> f64 {
        let lanes = S::Vector::LANES;
        let mut sum = simd.splat(0.0);
        for column in 0..self.columns {
            for output in 0..ENDS.1 {
                let (y, out) = (outputs.plane(column, output), gradient.plane(column, output));
                for (y, out) in y.chunks(lanes).zip(out.chunks_mut(lanes)) {
                    let y = simd.load(y);
                    sum = y.mul_add(y, sum);
                    y.store(out);
                }
            }
        }
        let mut sums = [0.0; 16];
        sum.store(&mut sums[..lanes]);
        sums.iter().map(|s| 0.5 * f64::from(*s)).sum()
    }
}

/// Steps of every chain of the peak: some milliseconds.
const PEAK_STEPS: usize = 1 << 21;

/// Processor time of this thread in seconds. The system brings it up to date when the thread yields.
fn processor_seconds() -> f64 {
    std::thread::yield_now();
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text.split(' ').next().and_then(|n| n.parse::<f64>().ok());
    nanoseconds.unwrap_or(f64::NAN) * 1e-9
}

/// Processor time of `work` on this thread.
fn processor_time(work: impl FnOnce()) -> f64 {
    let before = processor_seconds();
    work();
    processor_seconds() - before
}

/// candle's loss and gradients of one batch; `plain` uses no operation of ours.
fn candle_step(mlp: &Mlp, x: &Tensor, columns: usize, plain: bool) -> candle_core::Result<f32> {
    let y = match plain {
        false => mlp.forward(x, columns)?,
        true => plain_forward(mlp, x, columns)?,
    };
    let loss = (y.sqr()?.sum_all()? * (0.5 / (x.dim(0)? / columns) as f64))?;
    black_box(loss.backward()?);
    loss.to_scalar()
}

fn plain_forward(mlp: &Mlp, x: &Tensor, columns: usize) -> candle_core::Result<Tensor> {
    let queries = x.dim(0)? / columns;
    let mut x = x.clone();
    for (i, (weight, bias)) in mlp.layers.iter().enumerate() {
        let z = x.matmul(&weight.t()?)?;
        let hidden = i + 1 < mlp.layers.len();
        if columns == 1 {
            let value = z.broadcast_add(bias)?;
            x = if hidden { value.silu()? } else { value };
            continue;
        }
        let value = z.narrow(0, 0, queries)?.broadcast_add(bias)?;
        let tangents = z.narrow(0, queries, (columns - 1) * queries)?;
        x = if hidden {
            let sigma = candle_nn::ops::sigmoid(&value)?;
            let slope = (&sigma * ((&value * (1.0 - &sigma)?)? + 1.0)?)?;
            let slopes = Tensor::cat(&vec![slope; columns - 1], 0)?;
            Tensor::cat(&[(&value * sigma)?, (tangents * slopes)?], 0)?
        } else {
            Tensor::cat(&[value, tangents], 0)?
        };
    }
    Ok(x)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    gemm::set_threading_threshold(usize::MAX);
    let tiers = match std::env::args().nth(1) {
        Some(name) => Tier::available()
            .into_iter()
            .filter(|t| t.name() == name)
            .collect(),
        None => Tier::available().split_off(1),
    };
    let mut out = std::io::stdout();
    writeln!(
        out,
        "{:8} {:6} {:>7} {:>9} {:>9} {:>9} {:>9} {:>8} {:>8} {:>7} {:>7} {:>7}",
        "tier",
        "net",
        "columns",
        "candle/s",
        "+own op/s",
        "fused/s",
        "2 cores/s",
        "GFLOP/s",
        "peak",
        "share",
        "gain",
        "2 cores"
    )?;
    for tier in tiers {
        for (depth, width) in NETWORKS {
            for columns in [1, 3] {
                run(tier, depth, width, columns, &mut out)?;
            }
        }
    }
    Ok(())
}

fn run(
    tier: Tier,
    depth: usize,
    width: usize,
    columns: usize,
    out: &mut impl Write,
) -> Result<(), Box<dyn std::error::Error>> {
    let mut rng = Rng::new(&[1]);
    let mut random = |count: usize, scale: f64| -> Vec<f32> {
        (0..count)
            .map(|_| (scale * (2.0 * rng.uniform() - 1.0)) as f32)
            .collect()
    };
    let mut widths = vec![ENDS.0];
    widths.extend(vec![width; depth]);
    widths.push(ENDS.1);
    let shape = Shape::new(widths, Nonlinearity::Silu)?;
    let parameters = random(shape.parameters(), 2.0 / (width as f64).sqrt());
    let features = random(columns * QUERIES * ENDS.0, 1.0);
    let mut rest = &parameters[..];
    let dense = shape.layers().map(|(inputs, outputs)| {
        let (weight, after) = rest.split_at(inputs * outputs);
        let (bias, after) = after.split_at(outputs);
        rest = after;
        Dense {
            weight: weight.into(),
            bias: bias.into(),
            inputs,
            outputs,
        }
    });
    let mlp = Mlp::from_dense(&dense.collect::<Vec<_>>())?;
    let batches: Vec<Tensor> = (0..QUERIES / CANDLE_QUERIES)
        .map(|batch| {
            let blocks = (0..columns).flat_map(|column| {
                let start = (column * QUERIES + batch * CANDLE_QUERIES) * ENDS.0;
                features[start..start + CANDLE_QUERIES * ENDS.0].iter().copied()
            });
            let x = blocks.collect::<Vec<f32>>();
            // A plain tensor, as features are in training: nothing asks for their gradient.
            Tensor::from_vec(x, (columns * CANDLE_QUERIES, ENDS.0), &Device::Cpu)
        })
        .collect::<candle_core::Result<_>>()?;
    let loss = Squares {
        features: &features,
        columns,
    };
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let (one, two) = (pool(1)?, pool(2)?);
    let mut single = Fused::new(tier, shape.clone(), columns)?;
    let mut double = Fused::new(tier, shape.clone(), columns)?;
    let mut best = [f64::INFINITY; 5];
    let mut values = [0.0; 3];
    for _ in 0..ROUNDS {
        for (i, plain) in [(0, true), (1, false)] {
            let mut sum = 0.0;
            let seconds = processor_time(|| {
                for x in &batches {
                    sum += candle_step(&mlp, x, columns, plain).unwrap_or(f32::NAN);
                }
            });
            values[i] = f64::from(sum) / batches.len() as f64;
            best[i] = best[i].min(seconds);
        }
        let seconds = one.install(|| {
            processor_time(|| {
                for _ in 0..STEPS {
                    let step = single.step(&parameters, QUERIES, &loss);
                    values[2] = step.map_or(f64::NAN, |step| step.0);
                }
            })
        });
        best[2] = best[2].min(seconds / STEPS as f64);
        for _ in 0..STEPS {
            let started = Instant::now();
            two.install(|| double.step(&parameters, QUERIES, &loss))?;
            best[3] = best[3].min(started.elapsed().as_secs_f64());
        }
        let seconds = processor_time(|| {
            black_box(tier.dispatch(Chains { steps: PEAK_STEPS }).unwrap_or(f32::NAN));
        });
        best[4] = best[4].min(seconds);
    }
    assert!(
        values.iter().all(|v| (v / values[0] - 1.0).abs() < 1e-4),
        "{values:?}"
    );
    let rate = |seconds: f64| QUERIES as f64 / seconds;
    let flops = 2.0 * (shape.training_macs() * columns * QUERIES) as f64 / best[2];
    let peak = 2.0 * (tier.lanes() * CHAINS * PEAK_STEPS) as f64 / best[4];
    writeln!(
        out,
        "{:8} {:6} {columns:>7} {:>8.0}k {:>8.0}k {:>8.0}k {:>8.0}k {:>8.1} {:>8.1} {:>6.1}% {:>6.2}x {:>6.2}x",
        tier.name(),
        format!("{depth}x{width}"),
        rate(best[0]) * 1e-3,
        rate(best[1]) * 1e-3,
        rate(best[2]) * 1e-3,
        rate(best[3]) * 1e-3,
        flops * 1e-9,
        peak * 1e-9,
        100.0 * flops / peak,
        best[0] / best[2],
        best[2] / best[3],
    )?;
    Ok(())
}
