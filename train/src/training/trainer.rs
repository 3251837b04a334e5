//! The training loop: data-parallel over fixed shards, so that its result does not depend on the number of
//! threads; stopped by step count; checkpointed with the whole state of the optimiser.

use crate::Tick;
use crate::error::{Error, Result};
use crate::nn::mlp::Mlp;
use crate::optimiser::{Optimiser, Parameter};
use crate::tensors;
use bake_runtime::Rng;
use bake_runtime::network::write_atomically;
use candle_core::{Tensor, Var};
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

fn is_hidden(index: usize, layers: usize) -> bool {
    // Parameters come weight, bias, weight, bias…; the first and the last weight are Adam's.
    let layer = index / 2;
    index.is_multiple_of(2) && layer > 0 && layer + 1 < layers
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
        let count = mlp.layers.len();
        let parameters = mlp.vars().into_iter().enumerate().map(|(i, var)| {
            let shape = (var.dim(0)?, var.dims().get(1).copied().unwrap_or(1));
            Ok((shape, var.flatten_all()?.to_vec1::<f32>()?, is_hidden(i, count)))
        });
        let optimiser = Optimiser::new(parameters.collect::<candle_core::Result<_>>()?);
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
            let shards: Result<Vec<(f64, Vec<Vec<f32>>)>> = (0..SHARDS)
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
            let mut total: Vec<Vec<f32>> = self
                .optimiser
                .parameters
                .iter()
                .map(|p| vec![0.0; p.value.len()])
                .collect();
            for (_, gradient) in &shards {
                for (sum, part) in total.iter_mut().zip(gradient) {
                    sum.iter_mut()
                        .zip(part)
                        .for_each(|(s, g)| *s += g / SHARDS as f32);
                }
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

    fn rate(&self, step: u64) -> f32 {
        let progress = step as f64 / self.plan.steps as f64;
        let cosine = 0.5 * (1.0 + (std::f64::consts::PI * progress).cos());
        let warm_up = ((step + 1) as f64 / WARM_UP_STEPS as f64).min(1.0);
        (self.plan.rate * warm_up * (cosine + FINAL_RATE)) as f32
    }

    /// Copies the optimiser's values into the network.
    fn publish(&self) -> Result<()> {
        for (var, parameter) in self.mlp.vars().into_iter().zip(&self.optimiser.parameters) {
            var.set(&Tensor::from_slice(&parameter.value, var.shape(), var.device())?)?;
        }
        Ok(())
    }

    fn save(&self) -> Result<()> {
        let mut tensors: Vec<(String, Vec<usize>, Vec<u8>)> = Vec::new();
        for (i, p) in self.optimiser.parameters.iter().enumerate() {
            for (name, values) in [("value", &p.value), ("first", &p.first), ("second", &p.second)] {
                let data = values.iter().flat_map(|v| v.to_le_bytes()).collect();
                tensors.push((format!("{name}.{i:02}"), vec![values.len()], data));
            }
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
        let read = |name: String, length: usize| {
            tensors::read(&file, &name, Dtype::F32, length, f32::from_le_bytes).map_err(broken)
        };
        let load = |(i, p): (usize, &Parameter)| -> Result<Parameter> {
            let n = p.value.len();
            Ok(Parameter {
                value: read(format!("value.{i:02}"), n)?,
                first: read(format!("first.{i:02}"), n)?,
                second: read(format!("second.{i:02}"), n)?,
                ..p.clone()
            })
        };
        let parameters = self
            .optimiser
            .parameters
            .iter()
            .enumerate()
            .map(load)
            .collect::<Result<Vec<_>>>()?;
        let step = tensors::read(&file, "step", Dtype::U64, 1, u64::from_le_bytes).map_err(broken)?[0];
        self.optimiser = Optimiser { parameters, step };
        self.publish()
    }
}

/// Value of a loss and its gradient by every variable of `mlp`.
fn gradients(mlp: &Mlp, loss: &Tensor) -> Result<(f64, Vec<Vec<f32>>)> {
    let store = loss.backward()?;
    let gradient = |var: &Var| match store.get(var) {
        Some(g) => Ok(g.flatten_all()?.to_vec1::<f32>()?),
        None => Ok(vec![0.0; var.elem_count()]),
    };
    let all = mlp
        .vars()
        .into_iter()
        .map(gradient)
        .collect::<candle_core::Result<_>>()?;
    Ok((f64::from(loss.to_scalar::<f32>()?), all))
}

/// FNV-1a of a stage's name: part of the key of its random numbers.
fn hash(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |h, b| {
        (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3)
    })
}
