//! Training of one network: its parameters are one flat variable of candle, its loss is an operation whose gradient the
//! fused kernel finds on the way.

use super::mlp::Mlp;
use super::run::{HeldOut, Plan, Run};
use crate::Tick;
use crate::error::Result;
use crate::fused::{Fused, FusedLoss, Nonlinearity, Shape, TileLoss};
use crate::optimiser::layout;
use bake_runtime::Rng;
use bake_runtime::simd::Tier;
use bake_runtime::spec::Activation;
use candle_core::{Device, Var};
use std::path::Path;
use std::sync::{Arc, Mutex};

/// A network under training.
pub struct Trainer {
    plan: Plan,
    layers: Vec<(usize, usize)>,
    shape: Shape,
    run: Run,
}

/// The kernel's shape of a network of `layers`.
///
/// # Errors
/// [`crate::Error::Runtime`] for an empty layer.
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
    /// As [`Run::new`].
    pub fn new(
        plan: Plan,
        layers: &[(usize, usize)],
        activation: Activation,
        folder: &Path,
        context: &str,
    ) -> Result<Trainer> {
        let mlp = Mlp::random(layers, &mut Rng::new(&[plan.seed, hash(plan.stage), 0]));
        let context = format!("{activation:?} {context}");
        Ok(Trainer {
            run: Run::new(plan.clone(), layout(layers), mlp.values, folder, &context)?,
            shape: shape(layers, activation)?,
            layers: mlp.layers,
            plan,
        })
    }

    /// Whether nothing is left to do.
    pub fn is_finished(&self) -> bool {
        self.run.is_finished()
    }

    /// Trains to the end and returns the network. `loss` draws the batch of a step from its own random stream, and says
    /// how many rows its queries have: 1, or 3 with two tangents.
    ///
    /// # Errors
    /// As [`Run::descend`], and what `loss` returns.
    pub fn run<L: TileLoss + Send + 'static>(
        self,
        mut loss: impl FnMut(u64, &mut Rng) -> Result<(usize, L)>,
        tick: Tick,
    ) -> Result<Mlp> {
        let Trainer {
            plan,
            layers,
            shape,
            run,
        } = self;
        let kernel = |columns: usize| -> Result<Arc<Mutex<Fused>>> {
            Ok(Arc::new(Mutex::new(Fused::new(
                Tier::chosen()?,
                shape.clone(),
                columns,
            )?)))
        };
        let mut kernels: Vec<(usize, Arc<Mutex<Fused>>)> = Vec::new();
        let slope = |step: u64, values: &[f32], gradient: &mut [f32]| -> Result<f64> {
            let key = [plan.seed, hash(plan.stage), 1 + step];
            let (columns, batch) = loss(step, &mut Rng::new(&key))?;
            if kernels.iter().all(|(own, _)| *own != columns) {
                kernels.push((columns, kernel(columns)?));
            }
            let own = kernels.iter().find(|(own, _)| *own == columns);
            let (_, kernel) = own.unwrap_or_else(|| unreachable!("it has just been made"));
            let parameters = Var::from_slice(values, values.len(), &Device::Cpu)?;
            let operation = FusedLoss::new(kernel.clone(), plan.batch, batch);
            let loss = parameters.as_tensor().apply_op1(operation)?;
            if let Some(found) = loss.backward()?.get(&parameters) {
                gradient.copy_from_slice(&found.to_vec1::<f32>()?);
            }
            Ok(f64::from(loss.to_scalar::<f32>()?))
        };
        let values = run.descend(slope, HeldOut::NONE, tick)?;
        Ok(Mlp { layers, values })
    }
}

/// FNV-1a of a stage's name: part of the key of its random numbers.
fn hash(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |h, b| {
        (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3)
    })
}
