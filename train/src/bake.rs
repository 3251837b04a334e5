//! The bake of one material: frames, maps, and the three networks, with presets for how much work to spend.

use crate::charts::ChartsNetwork;
use crate::database;
use crate::error::Result;
use crate::maps::{self, Charts, Job, Summary};
use crate::optimiser::Rule;
use crate::places;
use crate::presets::Preset;
use crate::training::data::TrainingSet;
use crate::training::mlp::Mlp;
use crate::training::run::Plan;
use crate::training::schedule::Schedule;
use crate::training::{density, sample};
use crate::transport::Solver;
use bake_runtime::{BakedMaterial, Material, Network, NetworkSpec, Role};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// How much work a bake spends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    /// Number of slices.
    pub slices: usize,
    /// Steps of the frame, sampling, evaluation and pdf networks.
    pub steps: [u64; 4],
    /// Samples per step.
    pub batch: usize,
}

impl Effort {
    /// The shipped models.
    pub const FULL: Effort = Effort {
        slices: 768,
        steps: [4000, 10_000, 8000, 4000],
        batch: 4096,
    };
    /// A first look in a minute.
    pub const QUICK: Effort = Effort {
        slices: 128,
        steps: [1500, 2000, 1000, 500],
        batch: 4096,
    };
}

/// Peak learning rates of the charts' network, and of the other three.
const CHARTS_RATE: f64 = 1e-2;
/// See [`CHARTS_RATE`].
const RATE: f64 = 4e-3;

/// A stage of the bake, for progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Charts are fitted and their network is trained.
    Charts,
    /// Slices and importance maps.
    Maps,
    /// The sampling network.
    Sample,
    /// The evaluation network.
    Eval,
    /// The pdf network.
    Pdf,
}

impl Stage {
    /// Words for a progress bar.
    pub fn label(self) -> &'static str {
        match self {
            Stage::Charts => "charts of lobes",
            Stage::Maps => "importance maps",
            Stage::Sample => "sampling network",
            Stage::Eval => "evaluation network",
            Stage::Pdf => "pdf network",
        }
    }
}

/// A baked material with what it cost.
#[derive(Clone, Debug)]
pub struct Bake {
    /// The three networks.
    pub material: BakedMaterial,
    /// Seconds for slices, frames and maps in this run (resumed work is not counted again).
    pub maps_seconds: f64,
    /// Seconds for the three networks in this run.
    pub train_seconds: f64,
    /// Training samples drawn, over all networks.
    pub samples: u64,
    /// How the maps came out.
    pub maps: Summary,
}

/// Bakes `material`, keeping checkpoints in `work` and taking up what lies there.
///
/// `progress` hears (stage, done, total); breaking ends the bake with [`crate::Error::Interrupted`] after a
/// checkpoint. The networks depend on `material`, `effort` and `seed` alone, not on the number of threads.
///
/// # Errors
/// See [`crate::Error`].
pub fn bake(
    material: &Material,
    preset: Preset,
    effort: Effort,
    seed: u64,
    work: &Path,
    progress: &(dyn Fn(Stage, u64, u64) -> std::ops::ControlFlow<()> + Sync),
) -> Result<Bake> {
    let [sample_spec, eval_spec, pdf_spec] = [
        preset.spec(Role::Sample, material)?,
        preset.spec(Role::Eval, material)?,
        preset.spec(Role::Pdf, material)?,
    ];
    let context = format!("{material:?} {effort:?}");
    let [frame_steps, sample_steps, eval_steps, pdf_steps] = effort.steps;
    let plan = |stage: &'static str, steps: u64, rate: f64| Plan {
        stage,
        steps,
        batch: effort.batch,
        rate,
        schedule: Schedule::WarmUpCosine,
        rule: Rule::Muon,
        seed,
    };

    let started = Instant::now();
    let tick = |stage: Stage| move |done: u64, total: u64| progress(stage, done, total);
    let places = places::draw(material, effort.slices, seed);
    let frame_plan = Plan {
        batch: effort.batch / 4,
        ..plan("charts", frame_steps, CHARTS_RATE)
    };
    let charts = ChartsNetwork::train(
        &sample_spec,
        frame_plan,
        material,
        &places,
        work,
        &tick(Stage::Charts),
    )?;
    let job = Job {
        material,
        places: &places,
        drawn: &format!("training places, seed {seed}"),
        charts: Charts::Predicted(&charts),
        solver: Solver::Frame,
        cells: maps::CELLS,
        seed,
    };
    let summary = maps::compute(&job, work, &tick(Stage::Maps))?;
    let slices = database::load(work, places.len(), &job.fingerprint())?;
    let maps_seconds = started.elapsed().as_secs_f64();

    let started = Instant::now();
    let set = Arc::new(TrainingSet::new(slices, &charts));
    let sampler = sample::train(
        &sample_spec,
        plan("sample", sample_steps, RATE),
        &set,
        work,
        &context,
        &tick(Stage::Sample),
    )?;
    let eval = density::train_eval(
        &eval_spec,
        plan("eval", eval_steps, RATE),
        material,
        &charts,
        work,
        &context,
        &tick(Stage::Eval),
    )?;
    let pdf = density::train_pdf(
        &pdf_spec,
        plan("pdf", pdf_steps, RATE),
        &set,
        (&sample_spec, &sampler),
        work,
        &context,
        &tick(Stage::Pdf),
    )?;
    let train_seconds = started.elapsed().as_secs_f64();

    let network = |spec: NetworkSpec, mlp: Mlp| Network {
        spec,
        frame: charts.layers.clone(),
        net: mlp.to_dense(),
    };
    Ok(Bake {
        material: BakedMaterial {
            sample: network(sample_spec, sampler),
            eval: network(eval_spec, eval),
            pdf: network(pdf_spec, pdf),
        },
        maps_seconds,
        train_seconds,
        samples: (sample_steps + eval_steps + pdf_steps) * effort.batch as u64,
        maps: summary,
    })
}
