//! The bake of one material: frames, maps, and the three networks, with presets for how much work to spend.

use crate::card::{MapsUsed, PaperTraining, Recipe, TrainingCost};
use crate::charts::ChartsNetwork;
use crate::clock::Clock;
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
use bake_runtime::{BakedMaterial, Dense, Family, Material, Network, NetworkSpec, Role};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

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
    /// What `material` is worth: a few minutes where only `wo` is free, up to an hour of one core for the networks where
    /// parameters are; a `quick` look takes a minute. Slices of layered materials take several times as long as others' to
    /// make, so there are half as many.
    pub fn of(preset: Preset, material: &Material, quick: bool) -> Effort {
        let wide = !material.free().is_empty();
        let (slices, steps) = match (preset, wide, quick) {
            (Preset::Warp, false, false) => (512, [4000, 6000, 6000, 3000]),
            (Preset::Warp, false, true) => (128, [1500, 1000, 1000, 500]),
            (Preset::Warp, true, false) => (8192, [20_000, 40_000, 40_000, 10_000]),
            (Preset::Warp, true, true) => (512, [2000, 2000, 2000, 500]),
            (Preset::Paper, false, false) => (512, [0, 12_000, 12_000, 6000]),
            (Preset::Paper, false, true) => (64, [0, 500, 500, 250]),
            (Preset::Paper, true, false) => (4096, [0, 20_000, 20_000, 10_000]),
            (Preset::Paper, true, true) => (256, [0, 500, 500, 250]),
        };
        let slow = wide && !quick && material.family == Family::Layered;
        Effort {
            slices: if slow { slices / 2 } else { slices },
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
    /// Name in files: of its run, and of its learning curve.
    pub fn key(self) -> &'static str {
        match self {
            Stage::Charts => "charts",
            Stage::Maps => "maps",
            Stage::Sample => "sample",
            Stage::Eval => "eval",
            Stage::Pdf => "pdf",
        }
    }

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
    /// What the training cost, over all pieces of the run.
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
        clock: RefCell::new(Clock::open(work)?),
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
    clock: RefCell<Clock>,
}

impl<'a> Oven<'a> {
    /// Does `work`, which belongs to `stage`.
    fn timed<T>(&self, stage: Stage, work: impl FnOnce() -> Result<T>) -> Result<T> {
        self.clock.borrow_mut().time(stage.key(), work)
    }

    /// The plan of a stage that trains a network.
    fn plan(&self, stage: Stage, rate: f64, (rule, schedule): (Rule, Schedule)) -> Plan {
        let [charts, sample, eval, pdf] = self.effort.steps;
        Plan {
            stage: stage.key(),
            steps: match stage {
                Stage::Charts => charts,
                Stage::Maps => unreachable!("maps are not trained"),
                Stage::Sample => sample,
                Stage::Eval => eval,
                Stage::Pdf => pdf,
            },
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
        let tick = self.tick(Stage::Maps);
        self.timed(Stage::Maps, || {
            let summary = maps::compute(&job, self.work, &tick)?;
            let slices = database::load(self.work, places.len(), &job.fingerprint())?;
            Ok((summary, slices))
        })
    }

    fn warp(self) -> Result<Bake> {
        let places = places::draw(self.material, self.effort.slices, self.seed);
        let course = (Rule::Muon, Schedule::WarmUpCosine);
        let charts_plan = Plan {
            batch: self.effort.batch / 4,
            ..self.plan(Stage::Charts, CHARTS_RATE, course)
        };
        let plan = |stage| self.plan(stage, WARP_RATE, course);
        let (work, context) = (self.work, &self.context[..]);
        let [sample_spec, eval_spec, pdf_spec] = &self.specs;
        let charts = self.timed(Stage::Charts, || {
            let tick = self.tick(Stage::Charts);
            ChartsNetwork::train(
                sample_spec,
                charts_plan.clone(),
                self.material,
                &places,
                work,
                &tick,
            )
        })?;
        let (summary, slices) = self.maps(&places, Charts::Predicted(&charts), Solver::Frame)?;
        let set = self.timed(Stage::Sample, || Ok(Arc::new(TrainingSet::new(slices, &charts))))?;
        let sampler = self.timed(Stage::Sample, || {
            let tick = self.tick(Stage::Sample);
            sample::train(sample_spec, plan(Stage::Sample), &set, work, context, &tick)
        })?;
        let eval = self.timed(Stage::Eval, || {
            let tick = self.tick(Stage::Eval);
            let plan = plan(Stage::Eval);
            density::train_eval(eval_spec, plan, self.material, &charts, work, context, &tick)
        })?;
        let pdf = self.timed(Stage::Pdf, || {
            let tick = self.tick(Stage::Pdf);
            let sampler = (sample_spec, &sampler);
            density::train_pdf(pdf_spec, plan(Stage::Pdf), &set, sampler, work, context, &tick)
        })?;
        let [sample_plan, eval_plan, pdf_plan] = [Stage::Sample, Stage::Eval, Stage::Pdf].map(plan);
        let cost = TrainingCost {
            maps: MapsUsed::new(Solver::Frame, maps::CELLS, false, &summary),
            networks: recipes(&[charts_plan, sample_plan, eval_plan, pdf_plan]),
            ..self.cost()
        };
        Ok(self.done([sampler, eval, pdf], &charts.layers, cost))
    }

    /// Where only `wo` is free, maps are made as the paper makes them; else by our solver, and expressed on the disk.
    fn paper(self) -> Result<Bake> {
        let places = places::draw(self.material, self.effort.slices, self.seed);
        let solver = match self.material.free().is_empty() {
            true => Solver::SinkhornSliced,
            false => Solver::Frame,
        };
        let (summary, slices) = self.maps(&places, Charts::Fitted, solver)?;
        let set = self.timed(Stage::Sample, || Ok(Arc::new(DiskSet::new(slices, solver))))?;
        let (adam, ranger) = (
            (Rule::Adam, Schedule::Cosine),
            (Rule::Ranger, Schedule::FlatCosine),
        );
        let train = |spec: &NetworkSpec, plan: &Plan, stage: Stage| {
            self.timed(stage, || {
                let tick = self.tick(stage);
                disk::train(spec, plan.clone(), &set, self.work, &self.context, &tick)
            })
        };
        let plans = [
            self.plan(Stage::Sample, PAPER_RATE, adam),
            self.plan(Stage::Eval, PAPER_RATE, ranger),
            self.plan(Stage::Pdf, PAPER_RATE, ranger),
        ];
        let [sample_spec, eval_spec, pdf_spec] = &self.specs;
        let sampler = train(sample_spec, &plans[0], Stage::Sample)?;
        let eval = train(eval_spec, &plans[1], Stage::Eval)?;
        let pdf = train(pdf_spec, &plans[2], Stage::Pdf)?;
        let cost = TrainingCost {
            maps: MapsUsed::new(solver, maps::CELLS, true, &summary),
            networks: recipes(&plans),
            paper: Some(PaperTraining::printed()),
            ..self.cost()
        };
        Ok(self.done([sampler, eval, pdf], &[], cost))
    }

    /// What the training cost, as far as both presets have it in common.
    fn cost(&self) -> TrainingCost {
        let steps: u64 = self.effort.steps[1..].iter().sum();
        let seconds = |stages: &[Stage]| {
            let keys: Vec<&str> = stages.iter().map(|stage| stage.key()).collect();
            self.clock.borrow().seconds(&keys)
        };
        TrainingCost {
            seconds: seconds(&[Stage::Sample, Stage::Eval, Stage::Pdf]),
            maps_seconds: seconds(&[Stage::Charts, Stage::Maps]),
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
