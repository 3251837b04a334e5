//! The bake of one material: frames, maps, and the three networks, with presets for how much work to spend.

use crate::card::{MapsUsed, PaperTraining, Recipe, TrainingCost};
use crate::charts::ChartsNetwork;
use crate::database;
use crate::error::Result;
use crate::maps::{self, Charts, Job, MappedSlice, Summary};
use crate::optimiser::Rule;
use crate::places::{self, Place};
use crate::presets::Preset;
use crate::training::data::TrainingSet;
use crate::training::disk::{self, DiskSet};
use crate::training::mlp::Mlp;
use crate::training::run::Plan;
use crate::training::schedule::Schedule;
use crate::training::{density, sample};
use crate::transport::Solver;
use bake_runtime::{BakedMaterial, Dense, Material, Network, NetworkSpec, Role};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// How much work a bake spends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    /// Number of slices.
    pub slices: usize,
    /// Steps of the charts', sampling, evaluation and pdf networks.
    pub steps: [u64; 4],
    /// Samples per step.
    pub batch: usize,
}

impl Effort {
    /// What `material` is worth: a few minutes where only `wo` is free, up to an hour of one core per network where
    /// parameters are; a `quick` look takes a minute.
    pub fn of(preset: Preset, material: &Material, quick: bool) -> Effort {
        let wide = !material.free().is_empty();
        let (slices, steps) = match (preset, wide, quick) {
            (Preset::Warp, false, false) => (512, [4000, 6000, 6000, 3000]),
            (Preset::Warp, false, true) => (128, [1500, 1000, 1000, 500]),
            (Preset::Warp, true, false) => (8192, [20_000, 40_000, 40_000, 10_000]),
            (Preset::Warp, true, true) => (512, [2000, 2000, 2000, 500]),
            (Preset::Paper, false, false) => (512, [0, 12_000, 12_000, 6000]),
            (Preset::Paper, false, true) => (64, [0, 500, 500, 250]),
            (Preset::Paper, true, false) => (8192, [0, 40_000, 40_000, 20_000]),
            (Preset::Paper, true, true) => (256, [0, 500, 500, 250]),
        };
        Effort {
            slices,
            steps,
            batch: 8192,
        }
    }
}

/// Peak learning rates of the charts' network, and of the other three of the warp preset.
const CHARTS_RATE: f64 = 1e-2;
/// See [`CHARTS_RATE`].
const WARP_RATE: f64 = 4e-3;
/// Peak learning rate of the paper preset. The paper's 1e-4 belongs to batches of a million and 500 epochs; with batches a
/// hundred times smaller and a thousandth of the samples, this one leads farther.
const PAPER_RATE: f64 = 2e-3;

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
    /// What the training cost; seconds are those of this run (resumed work is not counted again).
    pub cost: TrainingCost,
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
    progress: Progress,
) -> Result<Bake> {
    let [sample_spec, eval_spec, pdf_spec] = [
        preset.spec(Role::Sample, material)?,
        preset.spec(Role::Eval, material)?,
        preset.spec(Role::Pdf, material)?,
    ];
    let oven = Oven {
        material,
        effort,
        seed,
        work,
        progress,
        specs: [sample_spec, eval_spec, pdf_spec],
        context: format!("{material:?} {effort:?}"),
    };
    match preset {
        Preset::Warp => oven.warp(),
        Preset::Paper => oven.paper(),
    }
}

/// Hears (stage, done, total).
type Progress<'a> = &'a (dyn Fn(Stage, u64, u64) -> ControlFlow<()> + Sync);

/// What one bake works on and with.
struct Oven<'a> {
    material: &'a Material,
    effort: Effort,
    seed: u64,
    work: &'a Path,
    progress: Progress<'a>,
    /// Of the sampling, evaluation and pdf network.
    specs: [NetworkSpec; 3],
    context: String,
}

impl<'a> Oven<'a> {
    /// The stage's plan; `network` counts as in [`Effort::steps`].
    fn plan(
        &self,
        stage: &'static str,
        network: usize,
        rate: f64,
        (rule, schedule): (Rule, Schedule),
    ) -> Plan {
        Plan {
            stage,
            steps: self.effort.steps[network],
            batch: self.effort.batch,
            rate,
            schedule,
            rule,
            seed: self.seed,
        }
    }

    fn tick(&self, stage: Stage) -> impl Fn(u64, u64) -> ControlFlow<()> + Sync + use<'a> {
        let progress = self.progress;
        move |done, total| progress(stage, done, total)
    }

    /// Slices and maps at `places`.
    fn maps(&self, places: &[Place], charts: Charts, solver: Solver) -> Result<(Summary, Vec<MappedSlice>)> {
        let job = Job {
            material: self.material,
            places,
            drawn: &format!("training places, seed {}", self.seed),
            charts,
            solver,
            cells: maps::CELLS,
            seed: self.seed,
        };
        let summary = maps::compute(&job, self.work, &self.tick(Stage::Maps))?;
        let slices = database::load(self.work, places.len(), &job.fingerprint())?;
        Ok((summary, slices))
    }

    fn warp(self) -> Result<Bake> {
        let started = Instant::now();
        let places = places::draw(self.material, self.effort.slices, self.seed);
        let course = (Rule::Muon, Schedule::WarmUpCosine);
        let charts_plan = Plan {
            batch: self.effort.batch / 4,
            ..self.plan("charts", 0, CHARTS_RATE, course)
        };
        let [sample_spec, eval_spec, pdf_spec] = &self.specs;
        let tick = self.tick(Stage::Charts);
        let charts = ChartsNetwork::train(
            sample_spec,
            charts_plan.clone(),
            self.material,
            &places,
            self.work,
            &tick,
        )?;
        let (summary, slices) = self.maps(&places, Charts::Predicted(&charts), Solver::Frame)?;
        let maps_seconds = started.elapsed().as_secs_f64();

        let started = Instant::now();
        let set = Arc::new(TrainingSet::new(slices, &charts));
        let plan = |stage, network| self.plan(stage, network, WARP_RATE, course);
        let (work, context) = (self.work, &self.context[..]);
        let tick = self.tick(Stage::Sample);
        let sampler = sample::train(sample_spec, plan("sample", 1), &set, work, context, &tick)?;
        let tick = self.tick(Stage::Eval);
        let eval = density::train_eval(
            eval_spec,
            plan("eval", 2),
            self.material,
            &charts,
            work,
            context,
            &tick,
        )?;
        let tick = self.tick(Stage::Pdf);
        let pdf = density::train_pdf(
            pdf_spec,
            plan("pdf", 3),
            &set,
            (sample_spec, &sampler),
            work,
            context,
            &tick,
        )?;
        let train_seconds = started.elapsed().as_secs_f64();
        let plans = [charts_plan, plan("sample", 1), plan("eval", 2), plan("pdf", 3)];
        let cost = TrainingCost {
            maps: MapsUsed::new(Solver::Frame, maps::CELLS, false, &summary),
            networks: recipes(&plans),
            ..self.cost([maps_seconds, train_seconds])
        };
        Ok(self.done([sampler, eval, pdf], &charts.layers, cost))
    }

    /// Where only `wo` is free, maps are made as the paper makes them; else by our solver, and expressed on the disk.
    fn paper(self) -> Result<Bake> {
        let started = Instant::now();
        let places = places::draw(self.material, self.effort.slices, self.seed);
        let solver = match self.material.free().is_empty() {
            true => Solver::SinkhornSliced,
            false => Solver::Frame,
        };
        let (summary, slices) = self.maps(&places, Charts::Fitted, solver)?;
        let maps_seconds = started.elapsed().as_secs_f64();

        let started = Instant::now();
        let set = Arc::new(DiskSet::new(slices, solver));
        let (adam, ranger) = (
            (Rule::Adam, Schedule::Cosine),
            (Rule::Ranger, Schedule::FlatCosine),
        );
        let train = |spec: &NetworkSpec, plan: Plan, stage: Stage| {
            disk::train(spec, plan, &set, self.work, &self.context, &self.tick(stage))
        };
        let plans = [
            self.plan("sample", 1, PAPER_RATE, adam),
            self.plan("eval", 2, PAPER_RATE, ranger),
            self.plan("pdf", 3, PAPER_RATE, ranger),
        ];
        let [sample_spec, eval_spec, pdf_spec] = &self.specs;
        let sampler = train(sample_spec, plans[0].clone(), Stage::Sample)?;
        let eval = train(eval_spec, plans[1].clone(), Stage::Eval)?;
        let pdf = train(pdf_spec, plans[2].clone(), Stage::Pdf)?;
        let train_seconds = started.elapsed().as_secs_f64();
        let cost = TrainingCost {
            maps: MapsUsed::new(solver, maps::CELLS, true, &summary),
            networks: recipes(&plans),
            paper: Some(PaperTraining::printed()),
            ..self.cost([maps_seconds, train_seconds])
        };
        Ok(self.done([sampler, eval, pdf], &[], cost))
    }

    /// What the training cost, as far as both presets have it in common.
    fn cost(&self, [maps_seconds, seconds]: [f64; 2]) -> TrainingCost {
        let steps: u64 = self.effort.steps[1..].iter().sum();
        TrainingCost {
            seconds,
            maps_seconds,
            samples: steps * self.effort.batch as u64,
            threads: rayon::current_num_threads(),
            maps: MapsUsed::new(Solver::Frame, maps::CELLS, false, &Summary::default()),
            networks: BTreeMap::new(),
            paper: None,
        }
    }

    fn done(self, networks: [Mlp; 3], frame: &[Dense], cost: TrainingCost) -> Bake {
        let mut built = self.specs.into_iter().zip(networks).map(|(spec, mlp)| Network {
            spec,
            frame: frame.to_vec(),
            net: mlp.to_dense(),
        });
        let mut next = || built.next().unwrap_or_else(|| unreachable!("there are three"));
        Bake {
            material: BakedMaterial {
                sample: next(),
                eval: next(),
                pdf: next(),
            },
            cost,
        }
    }
}

/// How each network is trained, by its name.
fn recipes(plans: &[Plan]) -> BTreeMap<String, Recipe> {
    plans
        .iter()
        .map(|plan| (plan.stage.to_string(), Recipe::of(plan)))
        .collect()
}
