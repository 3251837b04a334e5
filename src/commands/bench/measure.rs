//! Times everything in interleaved rounds: a clock that drifts, and whatever else the machine does, hits all alike.

use super::queries::{Batch, Engine, Estimator};
use super::row::{Results, Row};
use super::subjects::{Kind, Subject};
use crate::output;
use anyhow::Result;
use bake_export::{export, layers_to_onnx};
use bake_runtime::native::{Layers, NativeBackend, Tier};
use bake_runtime::onnxruntime::{OrtBackend, PlainModel, library_path};
use bake_runtime::spec::Activation;
use bake_runtime::{BakedMaterial, Dense, Error, Rng, oracle};
use bake_train::bench::median;
use bake_train::bench::peak::Peak;
use bake_train::card::difference;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

/// Queries per call.
const BATCHES: [usize; 5] = [1, 16, 256, 4096, 65536];
/// The same for `--quick`.
const QUICK_BATCHES: [usize; 2] = [1, 4096];
/// Rounds, of which the median counts.
const ROUNDS: usize = 11;
/// The same for `--quick`.
const QUICK_ROUNDS: usize = 3;
/// A call is repeated within a round until it has taken this long, seconds.
const ROUND_SECONDS: f64 = 1e-3;
/// What has taken this long in all, seconds, sits the other rounds out: large batches on slow tiers.
const JOB_SECONDS: f64 = 0.25;
/// Queries per call of onnxruntime that are tried; the best counts.
const ORT_CHUNKS: [usize; 3] = [256, 1024, 4096];

/// A row under way, and what runs for it.
struct Job<'a> {
    row: Row,
    multiply_adds: Option<usize>,
    run: Box<dyn FnMut() -> bake_runtime::Result<()> + 'a>,
    /// Calls per round.
    calls: usize,
    seconds: Vec<f64>,
    /// Seconds of all rounds together.
    spent: f64,
}

/// What one batch runs with.
struct Bench {
    rounds: usize,
    /// Peaks of every tier, of all rounds so far.
    peaks: BTreeMap<&'static str, Vec<Peak>>,
    rows: Vec<Row>,
}

/// Measures `subjects`, in fewer batches and rounds where it is to be `quick`.
pub fn all(subjects: &[Subject], quick: bool, tick: &dyn Fn(u64, u64) -> ControlFlow<()>) -> Result<Results> {
    let batches = if quick { &QUICK_BATCHES[..] } else { &BATCHES };
    let with_ort = match library_path() {
        Ok(_) => true,
        Err(error) => {
            output::warn(&format!("rows of onnxruntime are left out: {error}"));
            false
        }
    };
    let mut bench = Bench {
        rounds: if quick { QUICK_ROUNDS } else { ROUNDS },
        peaks: BTreeMap::new(),
        rows: Vec::new(),
    };
    let total = (subjects.len() * batches.len()) as u64;
    for (s, subject) in subjects.iter().enumerate() {
        let engines = match &subject.kind {
            Kind::Layers(..) => None,
            Kind::Networks { material, .. } => Some(Engines::new(material, with_ort)?),
        };
        if let Kind::Networks {
            folder: Some(folder), ..
        } = &subject.kind
        {
            bench.load(subject, folder)?;
        }
        for (b, &batch) in batches.iter().enumerate() {
            if tick((s * batches.len() + b) as u64, total).is_break() {
                anyhow::bail!("interrupted; nothing was written");
            }
            match (&subject.kind, &engines) {
                (
                    Kind::Networks {
                        material, binning_l1, ..
                    },
                    Some(engines),
                ) => bench.networks(subject, material, *binning_l1, engines, batch)?,
                (Kind::Layers(layers, activation), _) => {
                    bench.layers(subject, layers, *activation, batch, with_ort)?
                }
                (Kind::Networks { .. }, None) => unreachable!("networks have engines"),
            }
        }
    }
    let peaks = bench.peaks.iter().filter_map(|(name, peaks)| {
        let tier = Tier::named(name).ok()?;
        let peak = Peak::highest(peaks);
        Some((*name, (peak.gflops, peak.vectors_per_cycle(tier))))
    });
    Ok(Results {
        peaks: peaks.collect(),
        rows: bench.rows,
    })
}

/// Everything that runs the networks of one material.
struct Engines {
    /// Every tier of this processor, the best last.
    natives: Vec<(Tier, NativeBackend)>,
    /// onnxruntime, by queries per call; none without it.
    orts: Vec<(usize, OrtBackend)>,
}

impl Engines {
    fn new(material: &BakedMaterial, with_ort: bool) -> Result<Engines> {
        let natives = Tier::available().into_iter();
        let natives = natives.map(|tier| Ok((tier, NativeBackend::new(material, tier)?)));
        let mut orts = Vec::new();
        if with_ort {
            let folder = tempfile::tempdir()?;
            export(material, folder.path())?;
            for chunk in ORT_CHUNKS {
                orts.push((chunk, OrtBackend::new(folder.path())?.with_chunk(chunk)));
            }
        }
        Ok(Engines {
            natives: natives.collect::<Result<_>>()?,
            orts,
        })
    }

    /// The best tier, and what runs on it.
    fn best(&self) -> (Tier, &NativeBackend) {
        let (tier, native) = self.natives.last().expect("every processor has a tier");
        (*tier, native)
    }
}

impl Bench {
    /// The files of a material, until it can answer on the best tier.
    fn load(&mut self, subject: &Subject, folder: &Path) -> Result<()> {
        let tier = Tier::best();
        let row = Row::new(subject, "native", Some(tier), Estimator::Load, 1);
        self.run(vec![Job::new(row, None, || {
            let loaded = NativeBackend::new(&BakedMaterial::load(folder)?, tier)?;
            std::hint::black_box(loaded);
            Ok(())
        })])
    }

    /// Dense layers on every tier, and in onnxruntime without anything around them.
    fn layers(
        &mut self,
        subject: &Subject,
        layers: &[Dense],
        activation: Activation,
        batch: usize,
        with_ort: bool,
    ) -> Result<()> {
        let inputs = layers[0].inputs;
        let outputs = layers[layers.len() - 1].outputs;
        let mut rng = Rng::new(&[batch as u64]);
        let rows: Vec<f32> = (0..batch * inputs)
            .map(|_| (2.0 * rng.uniform() - 1.0) as f32)
            .collect();
        let column = |c: usize| rows.iter().skip(c).step_by(inputs).copied().collect();
        let columns: Vec<Vec<f32>> = (0..inputs).map(column).collect();
        let columns: Vec<&[f32]> = columns.iter().map(Vec::as_slice).collect();
        let truth = |i: usize| {
            let x = rows[i * inputs..][..inputs]
                .iter()
                .map(|v| f64::from(*v))
                .collect();
            oracle::forward(layers, activation, &[x]).swap_remove(0)
        };
        let compared = batch.min(64);
        let error = |at: &dyn Fn(usize, usize) -> f32| {
            let errors = (0..compared).flat_map(|i| {
                let truth = truth(i).into_iter().enumerate();
                truth.map(move |(c, truth)| difference(at(i, c), truth))
            });
            errors.fold(0.0, f64::max)
        };
        let multiply_adds = layers.iter().map(|l| l.inputs * l.outputs).sum();
        let mut jobs = Vec::new();
        for tier in Tier::available() {
            let packed = Layers::new(layers, activation, tier)?;
            let mut out = vec![vec![0.0f32; batch]; outputs];
            let run = |packed: &Layers, out: &mut [Vec<f32>]| {
                let mut out: Vec<&mut [f32]> = out.iter_mut().map(Vec::as_mut_slice).collect();
                packed.run(&columns, &mut out)
            };
            run(&packed, &mut out)?;
            let mut row = Row::new(subject, "native", Some(tier), Estimator::Layers, batch);
            row.max_abs_error = Some(error(&|i, c| out[c][i]));
            row.encoding_in_graph = false;
            jobs.push(Job::new(row, Some(multiply_adds), move || run(&packed, &mut out)));
        }
        if with_ort {
            let mut model = PlainModel::new(&layers_to_onnx(layers, activation))?;
            let mut found = Vec::new();
            model.run("x", inputs, &rows, |y| found = y.to_vec())?;
            let mut row = Row::new(subject, "ort", None, Estimator::Layers, batch);
            row.max_abs_error = Some(error(&|i, c| found[i * outputs + c]));
            row.encoding_in_graph = false;
            let chunks = ORT_CHUNKS.map(|chunk| chunk.min(batch));
            for (k, chunk) in chunks.into_iter().enumerate() {
                if chunks[..k].contains(&chunk) {
                    continue;
                }
                let mut model = PlainModel::new(&layers_to_onnx(layers, activation))?;
                let rows = &rows;
                jobs.push(Job::new(row.clone(), Some(multiply_adds), move || {
                    let mut chunks = rows.chunks(chunk * inputs);
                    chunks.try_for_each(|rows| {
                        model.run("x", inputs, rows, |y| {
                            std::hint::black_box(y);
                        })
                    })
                }));
            }
        }
        self.run(jobs)
    }

    /// A material's queries on every tier, with bound parameters on the best one, and in onnxruntime.
    fn networks(
        &mut self,
        subject: &Subject,
        material: &BakedMaterial,
        binning_l1: Option<f64>,
        engines: &Engines,
        batch: usize,
    ) -> Result<()> {
        let (best_tier, best) = engines.best();
        let queries = Batch::new(material, best, batch, false)?;
        let mut shared = Batch::new(material, best, batch, true)?;
        let bound = best.bind(&shared.shared())?;
        shared.unbound();
        let free = !material.sample.spec.material.free().is_empty();
        let charts = material.sample.spec.charts().map_or(0, |c| c.anchors.len());
        let estimators = [
            (Estimator::Learned, true),
            (Estimator::Jacobian, true),
            (Estimator::Mixture, charts > 1),
            (Estimator::Eval, true),
            (Estimator::Pdf, true),
            (Estimator::ExactPdf, charts > 0),
        ];
        for (estimator, _) in estimators.into_iter().filter(|(_, offered)| *offered) {
            let multiply_adds = estimator.multiply_adds(material);
            let truths = queries.truths(material, estimator);
            let row = |backend, tier| {
                let row = Row::new(subject, backend, tier, estimator, batch);
                Row { binning_l1, ..row }
            };
            let compared = |mut row: Row, engine| -> Result<Job> {
                let mut queries = queries.clone();
                queries.answer(engine, estimator)?;
                row.max_abs_error = Some(queries.largest_error(&truths));
                let run = move || queries.answer(engine, estimator);
                Ok(Job::new(row, multiply_adds, run))
            };
            let mut jobs = Vec::new();
            for (tier, native) in &engines.natives {
                jobs.push(compared(row("native", Some(*tier)), Engine::Native(native))?);
            }
            if free {
                let (mut queries, bound) = (shared.clone(), &bound);
                let row = Row {
                    bound: true,
                    ..row("native", Some(best_tier))
                };
                let run = move || queries.answer(Engine::Native(bound), estimator);
                jobs.push(Job::new(row, None, run));
            }
            let in_graph = !matches!(estimator, Estimator::Mixture | Estimator::ExactPdf);
            // A chunk that is longer than the batch is the same as the shortest that is.
            let chunks = engines.orts.iter();
            let chunks = chunks.filter(|(chunk, _)| in_graph && *chunk <= batch.max(ORT_CHUNKS[0]));
            for (_, ort) in chunks {
                jobs.push(compared(row("ort", None), Engine::Ort(ort))?);
            }
            self.run(jobs)?;
        }
        Ok(())
    }

    /// Times `jobs` in turns with the peaks of all tiers, and keeps the best of rows that differ in nothing else.
    fn run(&mut self, mut jobs: Vec<Job>) -> Result<()> {
        for job in &mut jobs {
            let started = Instant::now();
            (job.run)()?;
            let seconds = started.elapsed().as_secs_f64();
            job.spent = seconds;
            job.calls = (ROUND_SECONDS / seconds.max(1e-9)).ceil() as usize;
        }
        let mut peaks: BTreeMap<&'static str, Vec<Peak>> = BTreeMap::new();
        for _ in 0..self.rounds {
            for tier in Tier::available() {
                let peak = Peak::measure(tier)?;
                peaks.entry(tier.name()).or_default().push(peak);
                self.peaks.entry(tier.name()).or_default().push(peak);
            }
            for job in &mut jobs {
                if !job.seconds.is_empty() && job.spent > JOB_SECONDS {
                    continue;
                }
                let started = Instant::now();
                for _ in 0..job.calls {
                    (job.run)()?;
                }
                let seconds = started.elapsed().as_secs_f64();
                job.spent += seconds;
                job.seconds.push(seconds / job.calls as f64);
            }
        }
        let highest = peaks.iter().map(|(tier, all)| (*tier, Peak::highest(all).gflops));
        let peaks: BTreeMap<&str, f64> = highest.collect();
        let mut finished: Vec<Row> = Vec::new();
        for mut job in jobs {
            let seconds = median(&job.seconds) / job.row.batch as f64;
            job.row.ns_per_query = seconds * 1e9;
            job.row.gflops = job.multiply_adds.map(|n| 2.0 * n as f64 / seconds * 1e-9);
            let peak = peaks[job.row.tier.unwrap_or(Tier::best().name())];
            job.row.percent_of_fma_peak = job.row.gflops.map(|gflops| 100.0 * gflops / peak);
            let same = finished.last_mut().filter(|last| last.is_like(&job.row));
            match same {
                Some(last) if last.ns_per_query <= job.row.ns_per_query => {}
                Some(last) => *last = job.row,
                None => finished.push(job.row),
            }
        }
        self.rows.extend(finished);
        Ok(())
    }
}

impl<'a> Job<'a> {
    fn new(row: Row, multiply_adds: Option<usize>, run: impl FnMut() -> Result<(), Error> + 'a) -> Job<'a> {
        Job {
            row,
            multiply_adds,
            run: Box::new(run),
            calls: 1,
            seconds: Vec::new(),
            spent: 0.0,
        }
    }
}
