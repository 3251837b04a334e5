//! The training loop: data-parallel over fixed shards, so that its result does not depend on the number of
//! threads; stopped by step count; checkpointed with the whole state of the optimiser.

use crate::Tick;
use crate::error::{Error, Result};
use crate::nn::mlp::Mlp;
use crate::optimiser::{Optimiser, Rule, layout};
use crate::tensors;
use bake_runtime::Rng;
use bake_runtime::network::write_atomically;
use candle_core::Tensor;
use rayon::prelude::*;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Batches are split into this many shards whatever the number of threads; gradients add up in their order.
///
/// With batches of 4096 a shard's largest tensor, three columns of 512 × 32, stays below the 65 536 elements
/// from which candle hands element-wise work to its own pool of spinning threads.
pub const SHARDS: usize = 8;
/// Steps between checkpoints.
const CHECKPOINT_STEPS: u64 = 500;
/// Share of the rate that is left at the last step of the cosine schedule.
const FINAL_RATE: f64 = 1e-3;
/// Steps over which the rate rises from 0.
const WARM_UP_STEPS: u64 = 50;
/// Metadata key of the checkpoint's fingerprint.
const FINGERPRINT_KEY: &str = "bake.checkpoint";

/// How one network is trained.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Name of the stage, e.g. `sample`; also the stem of the checkpoint.
    pub stage: &'static str,
    /// Number of steps.
    pub steps: u64,
    /// Samples per step, over all shards.
    pub batch: usize,
    /// Peak learning rate; follows a cosine to zero.
    pub rate: f64,
    /// How parameters follow their gradients.
    pub rule: Rule,
    /// Seed of initialisation and batches.
    pub seed: u64,
}

/// A network with its optimiser.
pub struct Trainer {
    plan: Plan,
    mlp: Mlp,
    optimiser: Optimiser,
    checkpoint: PathBuf,
    fingerprint: String,
}

impl Trainer {
    /// A network of `shapes` (inputs, outputs), taken up from its checkpoint in `folder` where there is one with
    /// the same plan and `context` (a text that names everything else the training depends on).
    ///
    /// # Errors
    /// [`Error::Checkpoint`] for a checkpoint that is there but cannot be read.
    pub fn new(plan: Plan, shapes: &[(usize, usize)], folder: &Path, context: &str) -> Result<Trainer> {
        // candle would split every product over all cores; the shards already use them.
        gemm::set_threading_threshold(usize::MAX);
        let mlp = Mlp::random(shapes, &mut Rng::new(&[plan.seed, hash(plan.stage), 0]))?;
        let mut value = Vec::new();
        for var in mlp.vars() {
            value.extend(var.flatten_all()?.to_vec1::<f32>()?);
        }
        let optimiser = Optimiser::new(plan.rule, layout(shapes), value);
        let fingerprint = format!("{plan:?} {shapes:?} {context}");
        let checkpoint = folder.join(format!("train-{}.safetensors", plan.stage));
        let mut trainer = Trainer {
            plan,
            mlp,
            optimiser,
            checkpoint,
            fingerprint,
        };
        trainer.take_up_checkpoint()?;
        Ok(trainer)
    }

    /// Trains to the end and returns the network. `loss` builds the loss of one shard of `batch / SHARDS`
    /// samples at a step from its own random stream; shards run side by side.
    ///
    /// # Errors
    /// [`Error::Interrupted`] when `tick` breaks, [`Error::Diverged`] when the loss is not finite; both after
    /// writing the last good state.
    pub fn run(
        mut self,
        loss: impl Fn(&Mlp, u64, usize, &mut Rng) -> Result<Tensor> + Sync,
        tick: Tick,
    ) -> Result<Mlp> {
        let shard_size = self.plan.batch / SHARDS;
        while self.optimiser.step < self.plan.steps {
            let step = self.optimiser.step;
            if tick(step, self.plan.steps).is_break() {
                self.save()?;
                return Err(Error::Interrupted);
            }
            let shards: Result<Vec<(f64, Vec<f32>)>> = (0..SHARDS)
                .into_par_iter()
                .map(|shard| {
                    let key = [self.plan.seed, hash(self.plan.stage), 1 + step, shard as u64];
                    let value = loss(&self.mlp, step, shard_size, &mut Rng::new(&key))?;
                    gradients(&self.mlp, &value)
                })
                .collect();
            let shards = shards?;
            let mean = shards.iter().map(|(value, _)| value).sum::<f64>() / SHARDS as f64;
            if !mean.is_finite() {
                self.save()?;
                return Err(Error::Diverged {
                    stage: self.plan.stage.into(),
                    step,
                    loss: mean,
                });
            }
            let mut total = vec![0.0f32; self.optimiser.value.len()];
            for (_, gradient) in &shards {
                total
                    .iter_mut()
                    .zip(gradient)
                    .for_each(|(s, g)| *s += g / SHARDS as f32);
            }
            self.optimiser.descend(&total, self.rate(step));
            self.publish()?;
            if self.optimiser.step.is_multiple_of(CHECKPOINT_STEPS) {
                self.save()?;
            }
        }
        self.save()?;
        Ok(self.mlp)
    }

    fn rate(&self, step: u64) -> f64 {
        let progress = step as f64 / self.plan.steps as f64;
        let cosine = 0.5 * (1.0 + (std::f64::consts::PI * progress).cos());
        let warm_up = ((step + 1) as f64 / WARM_UP_STEPS as f64).min(1.0);
        self.plan.rate * warm_up * (cosine + FINAL_RATE)
    }

    /// Copies the optimiser's values into the network.
    fn publish(&self) -> Result<()> {
        let mut rest = self.optimiser.value.as_slice();
        for var in self.mlp.vars() {
            let (own, others) = rest.split_at(var.elem_count());
            var.set(&Tensor::from_slice(own, var.shape(), var.device())?)?;
            rest = others;
        }
        Ok(())
    }

    fn save(&self) -> Result<()> {
        let mut tensors: Vec<(String, Vec<usize>, Vec<u8>)> = Vec::new();
        let Optimiser {
            value,
            first,
            second,
            slow,
            ..
        } = &self.optimiser;
        for (name, values) in [
            ("value", value),
            ("first", first),
            ("second", second),
            ("slow", slow),
        ] {
            let data = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            tensors.push((name.into(), vec![values.len()], data));
        }
        tensors.push(("step".into(), vec![1], self.optimiser.step.to_le_bytes().to_vec()));
        let views = tensors.iter().map(|(name, shape, data)| {
            let dtype = if name == "step" { Dtype::U64 } else { Dtype::F32 };
            (
                name.as_str(),
                TensorView::new(dtype, shape.clone(), data).expect("shape matches data by construction"),
            )
        });
        let metadata = HashMap::from([(FINGERPRINT_KEY.to_string(), self.fingerprint.clone())]);
        let bytes =
            safetensors::serialize(views, Some(metadata)).expect("tensor names are unique by construction");
        Ok(write_atomically(&self.checkpoint, &bytes)?)
    }

    fn take_up_checkpoint(&mut self) -> Result<()> {
        if !self.checkpoint.exists() {
            return Ok(());
        }
        let broken = |reason: String| Error::Checkpoint {
            path: self.checkpoint.clone(),
            reason,
        };
        let bytes = std::fs::read(&self.checkpoint).map_err(|e| broken(e.to_string()))?;
        let file =
            SafeTensors::deserialize(&bytes).map_err(|e| broken(format!("not a whole checkpoint ({e})")))?;
        let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|e| broken(e.to_string()))?;
        let found = header.metadata().as_ref().and_then(|m| m.get(FINGERPRINT_KEY));
        if found != Some(&self.fingerprint) {
            return Err(broken("it belongs to another training run".into()));
        }
        let read = |name: &str, length: usize| {
            tensors::read(&file, name, Dtype::F32, length, f32::from_le_bytes).map_err(broken)
        };
        let step = tensors::read(&file, "step", Dtype::U64, 1, u64::from_le_bytes).map_err(broken)?[0];
        let (count, slow) = (self.optimiser.value.len(), self.optimiser.slow.len());
        self.optimiser = Optimiser {
            value: read("value", count)?,
            first: read("first", count)?,
            second: read("second", count)?,
            slow: read("slow", slow)?,
            step,
            ..self.optimiser.clone()
        };
        self.publish()
    }
}

/// Value of a loss and its gradient by every variable of `mlp`.
fn gradients(mlp: &Mlp, loss: &Tensor) -> Result<(f64, Vec<f32>)> {
    let store = loss.backward()?;
    let mut all = Vec::new();
    for var in mlp.vars() {
        match store.get(var) {
            Some(g) => all.extend(g.flatten_all()?.to_vec1::<f32>()?),
            None => all.resize(all.len() + var.elem_count(), 0.0),
        }
    }
    Ok((f64::from(loss.to_scalar::<f32>()?), all))
}

/// FNV-1a of a stage's name: part of the key of its random numbers.
fn hash(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |h, b| {
        (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3)
    })
}
