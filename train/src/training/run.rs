//! The course of a training run: steps down a gradient that the caller computes, on a schedule, with checkpoints,
//! a learning curve, and a stop before anything that is not finite is taken over.

use super::checkpoint::{self, Identity, State};
use super::curve::{Curve, Row};
use super::schedule::Schedule;
use crate::Tick;
use crate::error::{Error, Result};
use crate::optimiser::{Block, Optimiser, Rule};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Steps between checkpoints, and between measurements of held-out errors.
pub const CHECKPOINT_STEPS: u64 = 500;
/// Steps between rows of the learning curve; a divisor of [`CHECKPOINT_STEPS`].
pub const CURVE_STEPS: u64 = 100;

/// How one network is trained.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Name of the stage, e.g. `sample`; also in the names of the checkpoint and of the learning curve.
    pub stage: &'static str,
    /// Number of steps.
    pub steps: u64,
    /// Samples per step, over all shards.
    pub batch: usize,
    /// Peak learning rate.
    pub rate: f64,
    /// How the learning rate changes.
    pub schedule: Schedule,
    /// How parameters follow their gradients.
    pub rule: Rule,
    /// Seed of initialisation and batches.
    pub seed: u64,
}

/// Errors on held-out data for the learning curve, measured at every checkpoint.
#[derive(Clone, Copy)]
pub struct HeldOut<'a> {
    /// Their names: columns of the curve.
    pub names: &'a [&'a str],
    /// Measures them for given parameters, in the order of the names.
    pub measure: &'a dyn Fn(&[f32]) -> Result<Vec<f64>>,
}

impl HeldOut<'_> {
    /// Nothing to measure.
    pub const NONE: HeldOut<'static> = HeldOut {
        names: &[],
        measure: &|_| Ok(Vec::new()),
    };
}

/// A run at some step.
pub struct Run {
    plan: Plan,
    identity: Identity,
    state: State,
    checkpoint: PathBuf,
    curve: PathBuf,
    /// Steps behind the checkpoint on disk.
    kept: Option<u64>,
}

impl Run {
    /// A run from the parameters `value`, which hold the tensors `blocks`, or from its checkpoint in `folder` where
    /// there is one of the same plan, tensors and `context` (a text that names everything else the training
    /// depends on).
    ///
    /// # Errors
    /// [`Error::Checkpoint`] for a checkpoint that cannot be read, or of another run: it says what differs.
    pub fn new(plan: Plan, blocks: Vec<Block>, value: Vec<f32>, folder: &Path, context: &str) -> Result<Run> {
        let tensors: Vec<String> = blocks
            .iter()
            .map(|b| format!("{}×{}", b.rows, b.columns))
            .collect();
        let identity = Identity::new(&[
            ("stage", plan.stage.to_string()),
            ("steps", plan.steps.to_string()),
            ("batch", plan.batch.to_string()),
            ("rate", plan.rate.to_string()),
            ("schedule", format!("{:?}", plan.schedule)),
            ("rule", format!("{:?}", plan.rule)),
            ("seed", plan.seed.to_string()),
            ("tensors", tensors.join(" ")),
            ("context", context.to_string()),
        ]);
        let checkpoint = folder.join(format!("train-{}.safetensors", plan.stage));
        let mut state = State {
            optimiser: Optimiser::new(plan.rule, blocks, value),
            loss_sum: 0.0,
            seconds: 0.0,
        };
        let found = checkpoint::load(&checkpoint, &identity, &mut state)?;
        Ok(Run {
            kept: found.then_some(state.optimiser.step),
            curve: folder.join(Curve::file_name(plan.stage)),
            plan,
            identity,
            state,
            checkpoint,
        })
    }

    /// Whether all steps are done.
    pub fn is_finished(&self) -> bool {
        self.state.optimiser.step >= self.plan.steps
    }

    /// Goes on to the end and returns the parameters. `slope` gets the step, the parameters and a gradient of
    /// zeros, fills in the gradient and returns the loss.
    ///
    /// # Errors
    /// [`Error::Interrupted`] when `tick` breaks, after a checkpoint. [`Error::Diverged`] when the loss or the
    /// gradient is not finite, or a step of the optimiser leaves the range of f32: the checkpoint stays the one
    /// before, the learning curve goes up to here. What `slope` and `held_out` return.
    pub fn descend(
        mut self,
        mut slope: impl FnMut(u64, &[f32], &mut [f32]) -> Result<f64>,
        held_out: HeldOut,
        tick: Tick,
    ) -> Result<Vec<f32>> {
        let steps = self.plan.steps;
        let mut curve = Curve::resume(&self.curve, held_out.names, self.state.optimiser.step)?;
        let mut gradient = vec![0.0; self.state.optimiser.value.len()];
        while self.state.optimiser.step < steps {
            let step = self.state.optimiser.step;
            if tick(step, steps).is_break() {
                self.save(&curve)?;
                return Err(Error::Interrupted);
            }
            let started = Instant::now();
            let rate = self.plan.schedule.rate(self.plan.rate, step, steps);
            gradient.fill(0.0);
            let loss = slope(step, &self.state.optimiser.value, &mut gradient)?;
            if let Err(what) = self.take(loss, &gradient, rate) {
                curve.save(&self.curve)?;
                return Err(Error::Diverged {
                    stage: self.plan.stage.into(),
                    what,
                    step,
                    loss,
                    checkpoint: self.kept,
                });
            }
            self.state.loss_sum += loss;
            self.state.seconds += started.elapsed().as_secs_f64();

            let done = step + 1;
            let due = done.is_multiple_of(CHECKPOINT_STEPS) || done == steps;
            if due || done.is_multiple_of(CURVE_STEPS) {
                let count = step % CURVE_STEPS + 1;
                curve.rows.push(Row {
                    step: done,
                    seconds: self.state.seconds,
                    learning_rate: rate,
                    loss: self.state.loss_sum / count as f64,
                    errors: match due {
                        true => (held_out.measure)(&self.state.optimiser.value)?,
                        false => Vec::new(),
                    },
                });
                self.state.loss_sum = 0.0;
            }
            if due {
                self.save(&curve)?;
            }
        }
        Ok(self.state.optimiser.value)
    }

    /// Takes one step, or says what is not finite. The state is spoilt only when a step began that left f32.
    fn take(&mut self, loss: f64, gradient: &[f32], rate: f64) -> std::result::Result<(), &'static str> {
        if !loss.is_finite() {
            return Err("the loss is");
        }
        if !gradient.iter().all(|g| g.is_finite()) {
            return Err("the gradient is");
        }
        self.state.optimiser.descend(gradient, rate);
        match self.state.optimiser.is_finite() {
            true => Ok(()),
            false => Err("the optimiser's next state is"),
        }
    }

    /// Writes the curve, then the checkpoint: rows without a checkpoint can be dropped, missing ones not made up.
    fn save(&mut self, curve: &Curve) -> Result<()> {
        curve.save(&self.curve)?;
        checkpoint::save(&self.checkpoint, &self.identity, &self.state)?;
        self.kept = Some(self.state.optimiser.step);
        Ok(())
    }
}
