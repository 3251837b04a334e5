//! The training loop: a network as one flat variable of candle, a loss that the fused kernel computes with its gradient,
//! our optimiser; stopped by step count; checkpointed with the whole state.

use super::mlp::Mlp;
use super::schedule::Schedule;
use crate::Tick;
use crate::error::{Error, Result};
use crate::fused::{Fused, FusedLoss, Nonlinearity, Shape, TileLoss};
use crate::optimiser::{Optimiser, Rule, layout};
use crate::tensors;
use bake_runtime::Rng;
use bake_runtime::network::write_atomically;
use bake_runtime::simd::Tier;
use bake_runtime::spec::Activation;
use candle_core::{Device, Var};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Steps between checkpoints.
const CHECKPOINT_STEPS: u64 = 500;
/// Metadata key of the checkpoint's fingerprint.
const FINGERPRINT_KEY: &str = "bake.checkpoint";

/// How one network is trained.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Name of the stage, e.g. `sample`; also the stem of the checkpoint.
    pub stage: &'static str,
    /// Number of steps.
    pub steps: u64,
    /// Samples per step.
    pub batch: usize,
    /// Peak learning rate.
    pub rate: f64,
    /// How it changes.
    pub schedule: Schedule,
    /// How parameters follow their gradients.
    pub rule: Rule,
    /// Seed of initialisation and batches.
    pub seed: u64,
}

/// A network with its optimiser.
pub struct Trainer {
    plan: Plan,
    layers: Vec<(usize, usize)>,
    activation: Activation,
    optimiser: Optimiser,
    checkpoint: PathBuf,
    fingerprint: String,
}

/// The kernel's shape of a network of `layers`.
///
/// # Errors
/// [`Error::Runtime`] for an empty layer.
pub fn shape(layers: &[(usize, usize)], activation: Activation) -> Result<Shape> {
    let mut widths: Vec<usize> = layers.iter().map(|(inputs, _)| *inputs).collect();
    widths.extend(layers.last().map(|(_, outputs)| *outputs));
    let nonlinearity = match activation {
        Activation::Silu => Nonlinearity::Silu,
        Activation::Relu => Nonlinearity::Relu,
    };
    Shape::new(widths, nonlinearity)
}

impl Trainer {
    /// A network of `layers` (inputs, outputs), taken up from its checkpoint in `folder` where there is one with
    /// the same plan and `context` (a text that names everything else the training depends on).
    ///
    /// # Errors
    /// [`Error::Checkpoint`] for a checkpoint that is there but cannot be used.
    pub fn new(
        plan: Plan,
        layers: &[(usize, usize)],
        activation: Activation,
        folder: &Path,
        context: &str,
    ) -> Result<Trainer> {
        let mlp = Mlp::random(layers, &mut Rng::new(&[plan.seed, hash(plan.stage), 0]));
        let optimiser = Optimiser::new(plan.rule, layout(layers), mlp.values);
        let mut trainer = Trainer {
            fingerprint: format!("{plan:?} {layers:?} {activation:?} {context}"),
            checkpoint: folder.join(format!("train-{}.safetensors", plan.stage)),
            plan,
            layers: mlp.layers,
            activation,
            optimiser,
        };
        trainer.take_up_checkpoint()?;
        Ok(trainer)
    }

    /// Whether all steps are done.
    pub fn is_finished(&self) -> bool {
        self.optimiser.step >= self.plan.steps
    }

    /// The network as it is now.
    pub fn finish(self) -> Mlp {
        Mlp {
            layers: self.layers,
            values: self.optimiser.value,
        }
    }

    /// Trains until `end` steps, or the plan's, are done. `loss` draws the batch of a step from its own random stream;
    /// its queries have `columns` rows each.
    ///
    /// # Errors
    /// [`Error::Interrupted`] when `tick` breaks, [`Error::Diverged`] when the loss or a gradient is not finite; both
    /// after writing the last good state.
    pub fn run_to<L: TileLoss + Send + 'static>(
        &mut self,
        end: u64,
        columns: usize,
        mut loss: impl FnMut(&mut Rng) -> Result<L>,
        tick: Tick,
    ) -> Result<()> {
        let shape = shape(&self.layers, self.activation)?;
        let kernel = Arc::new(Mutex::new(Fused::new(Tier::best(), shape, columns)?));
        while self.optimiser.step < end.min(self.plan.steps) {
            let step = self.optimiser.step;
            if tick(step, self.plan.steps).is_break() {
                self.save()?;
                return Err(Error::Interrupted);
            }
            let key = [self.plan.seed, hash(self.plan.stage), 1 + step];
            let batch = loss(&mut Rng::new(&key))?;
            let (value, gradient) = self.gradient(&kernel, batch)?;
            if !value.is_finite() || !gradient.iter().all(|g| g.is_finite()) {
                self.save()?;
                return Err(Error::Diverged {
                    stage: self.plan.stage.into(),
                    step,
                    loss: value,
                });
            }
            let rate = self.plan.schedule.rate(self.plan.rate, step, self.plan.steps);
            self.optimiser.descend(&gradient, rate);
            if self.optimiser.step.is_multiple_of(CHECKPOINT_STEPS) {
                self.save()?;
            }
        }
        self.save()
    }

    /// Mean loss of a batch, and its gradient by every parameter.
    fn gradient<L: TileLoss + Send + 'static>(
        &self,
        kernel: &Arc<Mutex<Fused>>,
        batch: L,
    ) -> Result<(f64, Vec<f32>)> {
        let count = self.optimiser.value.len();
        let parameters = Var::from_slice(&self.optimiser.value, count, &Device::Cpu)?;
        let operation = FusedLoss::new(kernel.clone(), self.plan.batch, batch);
        let loss = parameters.as_tensor().apply_op1(operation)?;
        let store = loss.backward()?;
        let gradient = match store.get(&parameters) {
            Some(gradient) => gradient.to_vec1::<f32>()?,
            None => vec![0.0; count],
        };
        Ok((f64::from(loss.to_scalar::<f32>()?), gradient))
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
        Ok(())
    }
}

/// FNV-1a of a stage's name: part of the key of its random numbers.
fn hash(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |h, b| {
        (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3)
    })
}
