//! Training of a flow by maximum likelihood on directions drawn from importance maps.

use super::condition::{Condition, Fold};
use super::{LOG_SCALE_MAX, RealNvp, plane, roles, shapes};
use crate::Tick;
use crate::error::Result;
use crate::maps::MappedSlice;
use crate::nn;
use crate::optimiser::{Block, Rule, layout};
use crate::training::mlp::Mlp;
use crate::training::run::{HeldOut, Plan, Run};
use crate::training::schedule::Schedule;
use crate::transport::frame_map::FrameMap;
use bake_runtime::network::Dense;
use bake_runtime::{Material, Rng};
use candle_core::{Device, Tensor, Var};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::path::Path;
use std::time::Instant;

#[cfg(test)]
mod tests;

/// Key of initial weights and of batches.
const KEY: u64 = 0xf10f;
/// Name of the stage: part of the names of checkpoint and learning curve.
pub const STAGE: &str = "flow";
/// Samples per step.
pub const BATCH: usize = 4096;
/// Parts of a batch that run side by side; a fixed number, so that sums do not depend on threads. Their largest tensors
/// then stay below the 65 536 elements from which candle hands element-wise work to its own threads.
const SHARDS: usize = 8;
/// Peak learning rate. On the vase, three couplings and 1000 steps: binning L1 at 45° is 0.095, 0.089, 0.079 and 0.077 with
/// 2e-3, 4e-3, 1e-2 and 2e-2, the last with weights above 150.
const RATE: f64 = 1e-2;
/// Steps whose time is measured, of which the median counts.
const TIMED_STEPS: u64 = 9;

/// What a flow learns from.
pub struct FlowSet {
    condition: Condition,
    /// Per slice: its map, where its directions are folded to, its features.
    slices: Vec<(FrameMap, Fold, Vec<f32>)>,
}

impl FlowSet {
    /// Prepares the `slices` of `material`, at least one, whose maps are those of [`crate::transport::Solver::Frame`].
    pub fn new(material: &Material, slices: &[MappedSlice]) -> FlowSet {
        let condition = Condition::new(material);
        let prepare = |slice: &MappedSlice| {
            let wo = DVec3::from_array(slice.wo);
            let fold = condition.fold(wo);
            let features = condition.features(&slice.parameters, fold.apply(wo));
            let features = features.into_iter().map(|v| v as f32).collect();
            (FrameMap::new(&slice.charts), fold, features)
        };
        FlowSet {
            slices: slices.iter().map(prepare).collect(),
            condition,
        }
    }

    /// Number of features of a slice.
    pub fn features(&self) -> usize {
        self.condition.width()
    }

    /// Points of the plane `[size, 2]` under directions drawn from slices, each as likely as any, and the features of
    /// these slices `[size, features]`.
    fn draw(&self, size: usize, rng: &mut Rng) -> Result<(Tensor, Tensor)> {
        let mut points = Vec::with_capacity(2 * size);
        let mut features: Vec<f32> = Vec::with_capacity(size * self.features());
        for _ in 0..size {
            let k = (rng.uniform() * self.slices.len() as f64) as usize;
            let (map, fold, slice) = &self.slices[k];
            let (wi, _) = map.direction(rng.pair());
            points.extend(plane::from_direction(fold.apply(wi)).to_array().map(|v| v as f32));
            features.extend(slice);
        }
        let points = Tensor::from_vec(points, (size, 2), &Device::Cpu)?;
        Ok((
            points,
            Tensor::from_vec(features, (size, self.features()), &Device::Cpu)?,
        ))
    }
}

/// A flow in candle's operations: the network of each coupling, from the Gaussian to the slice.
struct Flow(Vec<nn::mlp::Mlp>);

impl Flow {
    fn new(couplings: &[[Dense; 3]]) -> candle_core::Result<Flow> {
        let nets = couplings.iter().map(|layers| nn::mlp::Mlp::from_dense(layers));
        nets.collect::<candle_core::Result<_>>().map(Flow)
    }

    fn vars(&self) -> impl Iterator<Item = &Var> {
        self.0.iter().flat_map(|net| net.vars())
    }

    /// Ln of the density at `points` `[B, 2]` of the plane under `features` `[B, F]`: `[B]`.
    fn log_density(&self, points: &Tensor, features: &Tensor) -> candle_core::Result<Tensor> {
        let mut x = [points.narrow(1, 0, 1)?, points.narrow(1, 1, 1)?];
        let mut log_det = x[0].zeros_like()?;
        for (i, mlp) in self.0.iter().enumerate().rev() {
            let [kept, moved] = roles(i);
            let output = mlp.forward(&Tensor::cat(&[&x[kept], features], 1)?, 1)?;
            let raw = (output.narrow(1, 0, 1)? * (1.0 / LOG_SCALE_MAX))?;
            let log_scale = (raw.tanh()? * LOG_SCALE_MAX)?;
            x[moved] = ((&x[moved] - output.narrow(1, 1, 1)?)? * log_scale.neg()?.exp()?)?;
            log_det = (log_det + log_scale)?;
        }
        let [x, y] = x;
        let squares = ((x.sqr()? + y.sqr()?)? * -0.5)?;
        ((squares - log_det)? - TAU.ln())?.squeeze(1)
    }

    /// Mean negative log-density, and its gradient by all variables one after another.
    fn gradient(&self, points: &Tensor, features: &Tensor) -> Result<(f64, Vec<f32>)> {
        let loss = self.log_density(points, features)?.mean_all()?.neg()?;
        let store = loss.backward()?;
        let mut gradient = Vec::new();
        for var in self.vars() {
            match store.get(var) {
                Some(g) => gradient.extend(g.flatten_all()?.to_vec1::<f32>()?),
                None => gradient.resize(gradient.len() + var.elem_count(), 0.0),
            }
        }
        Ok((f64::from(loss.to_scalar::<f32>()?), gradient))
    }
}

/// A flow under training: the networks of its couplings lie one after another in one vector.
struct Course<'a> {
    set: &'a FlowSet,
    couplings: usize,
    batch: usize,
    seed: u64,
}

impl Course<'_> {
    fn layers(&self) -> [(usize, usize); 3] {
        shapes(self.set.features())
    }

    fn start(&self) -> Vec<f32> {
        let mut rng = Rng::new(&[KEY, self.seed]);
        let nets = (0..self.couplings).map(|_| Mlp::random(&self.layers(), &mut rng).values);
        nets.collect::<Vec<_>>().concat()
    }

    fn blocks(&self) -> Vec<Block> {
        let own = layout(&self.layers());
        let size = own.last().map_or(0, |block| block.range().end);
        let of = |coupling: usize| {
            own.iter().map(move |block| Block {
                offset: block.offset + coupling * size,
                ..*block
            })
        };
        (0..self.couplings).flat_map(of).collect()
    }

    /// The layers of every coupling.
    fn dense(&self, values: &[f32]) -> Vec<[Dense; 3]> {
        let net = |values: &[f32]| {
            let mlp = Mlp {
                layers: self.layers().to_vec(),
                values: values.to_vec(),
            };
            let layers: std::result::Result<[Dense; 3], _> = mlp.to_dense().try_into();
            layers.unwrap_or_else(|_| unreachable!("as many layers as shapes"))
        };
        let size = values.len() / self.couplings;
        values.chunks_exact(size).map(net).collect()
    }

    /// Fills in the gradient at `values` for the batch of `step`, and gives the loss.
    fn slope(&self, step: u64, values: &[f32], gradient: &mut [f32]) -> Result<f64> {
        let flow = Flow::new(&self.dense(values))?;
        let shard = |shard: usize| {
            let mut rng = Rng::new(&[KEY, self.seed, 1 + step, shard as u64]);
            let (points, features) = self.set.draw(self.batch / SHARDS, &mut rng)?;
            flow.gradient(&points, &features)
        };
        let shards = (0..SHARDS)
            .into_par_iter()
            .map(shard)
            .collect::<Result<Vec<_>>>()?;
        for (_, part) in &shards {
            let pairs = gradient.iter_mut().zip(part);
            pairs.for_each(|(sum, part)| *sum += part / SHARDS as f32);
        }
        Ok(shards.iter().map(|(loss, _)| loss).sum::<f64>() / SHARDS as f64)
    }
}

/// How a flow is trained in `steps` steps.
pub fn plan(steps: u64, seed: u64) -> Plan {
    Plan {
        stage: STAGE,
        steps,
        batch: BATCH,
        rate: RATE,
        schedule: Schedule::WarmUpCosine,
        rule: Rule::Muon,
        seed,
    }
}

/// candle would split every product over all cores; the shards already use them.
fn keep_products_on_their_thread() {
    gemm::set_threading_threshold(usize::MAX);
}

/// Seconds that one step of a flow of `couplings` couplings takes here and now.
///
/// # Errors
/// As [`train`].
pub fn step_seconds(set: &FlowSet, couplings: usize) -> Result<f64> {
    keep_products_on_their_thread();
    let course = Course {
        set,
        couplings,
        batch: BATCH,
        seed: 0,
    };
    let values = course.start();
    let mut gradient = vec![0.0; values.len()];
    let mut seconds = Vec::new();
    for step in 0..=TIMED_STEPS {
        let started = Instant::now();
        course.slope(step, &values, &mut gradient)?;
        seconds.push(started.elapsed().as_secs_f64());
    }
    // The first one finds caches cold.
    let timed = &mut seconds[1..];
    timed.sort_by(f64::total_cmp);
    Ok(timed[timed.len() / 2])
}

/// Trains a flow of `couplings` couplings; [`super::couplings_of`] gives their number for a number of parameters.
///
/// Checkpoint and learning curve lie in `folder`; what lies there of the same plan and `context` (a text that names
/// what `set` was made of) is taken up. The result depends on the arguments alone, not on the number of threads.
///
/// # Errors
/// As [`Run::new`] and [`Run::descend`].
pub fn train(
    set: &FlowSet,
    couplings: usize,
    plan: Plan,
    folder: &Path,
    context: &str,
    tick: Tick,
) -> Result<RealNvp> {
    keep_products_on_their_thread();
    let course = Course {
        set,
        couplings,
        batch: plan.batch,
        seed: plan.seed,
    };
    let run = Run::new(plan, course.blocks(), course.start(), folder, context)?;
    let slope = |step: u64, values: &[f32], gradient: &mut [f32]| course.slope(step, values, gradient);
    let values = run.descend(slope, HeldOut::NONE, tick)?;
    Ok(RealNvp {
        condition: set.condition.clone(),
        couplings: course.dense(&values),
    })
}
