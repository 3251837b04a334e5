//! The flow that is trained beside a baked material: as many parameters, about as long.

use super::Model;
use crate::arguments::RivalsOptions;
use crate::commands::baking::CHECKPOINTS;
use crate::commands::{prepare_folder, write_json};
use crate::output;
use crate::progress::Stages;
use anyhow::{Context, Result, bail};
use bake_train::bake::{Effort, Stage};
use bake_train::card::TrainingCost;
use bake_train::comparators::realnvp::training::{self, FlowSet, STAGE};
use bake_train::comparators::realnvp::{RealNvp, couplings_of};
use bake_train::maps::{CELLS, Charts, Job, compute};
use bake_train::training::curve::Curve;
use bake_train::transport::Solver;
use bake_train::{database, places};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// How the flow is trained: what `--resume` goes on with; beside its maps and checkpoints in [`CHECKPOINTS`].
const BUDGET_FILE: &str = "budget.json";
/// Fewest steps of a flow: the rise of its learning rate, and as many again.
const STEPS_MIN: u64 = 100;

/// Most slices that a flow learns from: each is made anew, at the cost that it had for the model itself.
const SLICES_MAX: usize = 4096;

/// How long the flow should be trained.
#[derive(Clone, Debug, PartialEq)]
pub enum Wanted {
    /// As many steps.
    Steps(u64),
    /// About as many seconds.
    Seconds(Time),
    /// As an interrupted run had it.
    Resumed(Budget),
}

/// Seconds of a training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Time {
    /// Wall time.
    pub seconds: f64,
    /// Where that is from.
    pub from: String,
}

/// How a flow is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Budget {
    /// Its couplings.
    pub couplings: usize,
    /// Slices that it learns from.
    pub slices: usize,
    /// Steps.
    pub steps: u64,
    /// Samples per step.
    pub batch: usize,
    /// Seed of everything.
    pub seed: u64,
    /// Seconds that a step took when the number of steps was chosen.
    pub step_seconds: Option<f64>,
    /// What that number was chosen for.
    pub wanted: Option<Time>,
}

/// A trained flow.
pub struct Trained {
    /// The flow.
    pub flow: RealNvp,
    /// How it was trained.
    pub budget: Budget,
    /// Seconds that it took, over all pieces of the run.
    pub seconds: Option<f64>,
}

/// How long the sampling network of `model` was trained, as far as anything tells.
pub fn sampling_time(model: &Model) -> Option<Time> {
    let curve = model
        .folder
        .join(CHECKPOINTS)
        .join(Curve::file_name(Stage::Sample.key()));
    let cost = model.card.as_ref().and_then(|card| card.training.as_ref());
    match (curve_seconds(&curve), cost) {
        (Some(seconds), _) => Some(Time {
            seconds,
            from: "the learning curve of the sampling network".into(),
        }),
        (None, Some(cost)) => Some(Time {
            seconds: cost.seconds * step_share(cost)?,
            from: "the card, by the sampling network's share of all steps".into(),
        }),
        (None, None) => None,
    }
}

/// Seconds that the training with the learning curve at `path` took; `None` where there is no such curve.
fn curve_seconds(path: &Path) -> Option<f64> {
    let curve = Curve::read(path).ok()?;
    curve.rows.last().map(|row| row.seconds)
}

/// Share of the steps of the three networks that the sampling network took.
fn step_share(cost: &TrainingCost) -> Option<f64> {
    let steps = |name: &str| cost.networks.get(name).map(|recipe| recipe.steps as f64);
    let sample = steps("sample")?;
    let all = sample + steps("eval")? + steps("pdf")?;
    (all > 0.0).then_some(sample / all)
}

/// What `options` ask of the flow beside `model`, or what an interrupted run in `out` that is to go on was asked.
///
/// # Errors
/// Where nothing says how long to train.
pub fn wanted(model: &Model, options: &RivalsOptions, out: &Path) -> Result<Wanted> {
    let file = out.join(CHECKPOINTS).join(BUDGET_FILE);
    if options.resume && file.exists() {
        return Ok(Wanted::Resumed(read_budget(&file)?));
    }
    match (options.steps, options.seconds) {
        (Some(steps), _) => Ok(Wanted::Steps(steps)),
        (None, Some(seconds)) => Ok(Wanted::Seconds(Time {
            seconds,
            from: "--seconds".into(),
        })),
        (None, None) => match sampling_time(model) {
            Some(time) => Ok(Wanted::Seconds(time)),
            None => bail!(
                "{}: nothing says how long its sampling network was trained, neither a card nor a learning curve; give \
                 --seconds or --steps",
                model.folder.display()
            ),
        },
    }
}

/// Trains the flow of the material of `model`; maps, checkpoints and the learning curve go into `out`.
pub fn train(
    model: &Model,
    wanted: Wanted,
    out: &Path,
    options: &RivalsOptions,
    stages: &Stages,
) -> Result<Trained> {
    let material = &model.networks.sample.spec.material;
    let work = out.join(CHECKPOINTS);
    if !options.resume && work.exists() {
        std::fs::remove_dir_all(&work).with_context(|| format!("{}: cannot start over", work.display()))?;
    }
    prepare_folder(&work)?;
    let (slices, seed) = match &wanted {
        Wanted::Resumed(budget) => (budget.slices, budget.seed),
        _ => (slices_of(model, options.quick), options.seed),
    };
    let places = places::draw(material, slices, seed);
    let job = Job {
        material,
        places: &places,
        drawn: &format!("training places, seed {seed}"),
        charts: Charts::Fitted,
        solver: Solver::Frame,
        cells: CELLS,
        seed,
    };
    compute(&job, &work, &|done, total| {
        stages.report("importance maps", done, total)
    })?;
    let fingerprint = job.fingerprint();
    let set = FlowSet::new(material, &database::load(&work, slices, &fingerprint)?);
    stages.finish();

    let couplings = couplings_of(model.networks.sample.spec.parameters(), set.features());
    let budget = |steps: u64, step_seconds: Option<f64>, wanted: Option<Time>| Budget {
        couplings,
        slices,
        steps,
        batch: training::BATCH,
        seed,
        step_seconds,
        wanted,
    };
    let budget = match wanted {
        Wanted::Resumed(budget) => budget,
        Wanted::Steps(steps) => budget(steps, None, None),
        Wanted::Seconds(time) => {
            let step = training::step_seconds(&set, couplings)?;
            let steps = ((time.seconds / step).round() as u64).max(STEPS_MIN);
            budget(steps, Some(step), Some(time))
        }
    };
    write_json(&work.join(BUDGET_FILE), &budget)?;
    if !options.json {
        say(&budget);
    }
    let context = format!("{} slices of {fingerprint}", budget.slices);
    let plan = training::plan(budget.steps, budget.seed);
    let flow = training::train(&set, budget.couplings, plan, &work, &context, &|done, total| {
        stages.report("RealNVP", done, total)
    })?;
    stages.finish();
    Ok(Trained {
        flow,
        seconds: curve_seconds(&work.join(Curve::file_name(STAGE))),
        budget,
    })
}

/// As many slices as the model learned from, up to [`SLICES_MAX`]; fewer for a quick look.
fn slices_of(model: &Model, quick: bool) -> usize {
    let effort = |quick| Effort::of(model.preset(), &model.networks.sample.spec.material, quick).slices;
    let cost = model.card.as_ref().and_then(|card| card.training.as_ref());
    let own = match cost {
        Some(cost) if cost.maps.slices > 0 => cost.maps.slices,
        _ => effort(false),
    };
    own.min(if quick { effort(true) } else { SLICES_MAX })
}

fn read_budget(file: &Path) -> Result<Budget> {
    let text = std::fs::read_to_string(file).with_context(|| file.display().to_string())?;
    let reason = || {
        format!(
            "{}: not of this version; start over without --resume",
            file.display()
        )
    };
    serde_json::from_str(&text).with_context(reason)
}

/// Says how many steps were chosen, and why.
fn say(budget: &Budget) {
    let why = match (&budget.wanted, budget.step_seconds) {
        (Some(time), Some(step)) => format!(
            ": {:.0} s, from {}, at {:.1} ms a step",
            time.seconds,
            time.from,
            1e3 * step
        ),
        _ => String::new(),
    };
    output::line(&format!(
        "RealNVP of {} couplings on {} slices: {} steps of {} samples{why}",
        budget.couplings, budget.slices, budget.steps, budget.batch
    ));
}
