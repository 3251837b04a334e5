//! Training of an [`Mlp`] with candle: data-parallel over fixed shards, so that its result does not depend on the
//! number of threads.

pub use super::run::Plan;

use super::run::{HeldOut, Run};
use crate::Tick;
use crate::error::Result;
use crate::nn::mlp::Mlp;
use crate::optimiser::layout;
use bake_runtime::Rng;
use candle_core::Tensor;
use rayon::prelude::*;
use std::path::Path;

/// Batches are split into this many shards whatever the number of threads; gradients add up in their order.
///
/// With batches of 4096 a shard's largest tensor, three columns of 512 × 32, stays below the 65 536 elements
/// from which candle hands element-wise work to its own pool of spinning threads.
pub const SHARDS: usize = 8;

/// A network under training.
pub struct Trainer {
    plan: Plan,
    mlp: Mlp,
    run: Run,
}

impl Trainer {
    /// A network of `shapes` (inputs, outputs), taken up from its checkpoint in `folder` where there is one with
    /// the same plan and `context` (a text that names everything else the training depends on).
    ///
    /// # Errors
    /// As [`Run::new`].
    pub fn new(plan: Plan, shapes: &[(usize, usize)], folder: &Path, context: &str) -> Result<Trainer> {
        // candle would split every product over all cores; the shards already use them.
        gemm::set_threading_threshold(usize::MAX);
        let mlp = Mlp::random(shapes, &mut Rng::new(&[plan.seed, hash(plan.stage), 0]))?;
        let mut value = Vec::new();
        for var in mlp.vars() {
            value.extend(var.flatten_all()?.to_vec1::<f32>()?);
        }
        let run = Run::new(plan.clone(), layout(shapes), value, folder, context)?;
        Ok(Trainer { plan, mlp, run })
    }

    /// Trains to the end and returns the network. `loss` builds the loss of one shard of `batch / SHARDS`
    /// samples at a step from its own random stream; shards run side by side.
    ///
    /// # Errors
    /// As [`Run::descend`].
    pub fn run(
        self,
        loss: impl Fn(&Mlp, u64, usize, &mut Rng) -> Result<Tensor> + Sync,
        tick: Tick,
    ) -> Result<Mlp> {
        let Trainer { plan, mlp, run } = self;
        let shard_size = plan.batch / SHARDS;
        let slope = |step: u64, value: &[f32], gradient: &mut [f32]| {
            publish(value, &mlp)?;
            let shards: Vec<(f64, Vec<f32>)> = (0..SHARDS)
                .into_par_iter()
                .map(|shard| {
                    let key = [plan.seed, hash(plan.stage), 1 + step, shard as u64];
                    gradient_of(&loss(&mlp, step, shard_size, &mut Rng::new(&key))?, &mlp)
                })
                .collect::<Result<_>>()?;
            for (_, part) in &shards {
                let pairs = gradient.iter_mut().zip(part);
                pairs.for_each(|(sum, g)| *sum += g / SHARDS as f32);
            }
            Ok(shards.iter().map(|(value, _)| value).sum::<f64>() / SHARDS as f64)
        };
        let value = run.descend(slope, HeldOut::NONE, tick)?;
        publish(&value, &mlp)?;
        Ok(mlp)
    }
}

/// Copies the optimiser's values into the network.
fn publish(value: &[f32], mlp: &Mlp) -> Result<()> {
    let mut rest = value;
    for var in mlp.vars() {
        let (own, others) = rest.split_at(var.elem_count());
        var.set(&Tensor::from_slice(own, var.shape(), var.device())?)?;
        rest = others;
    }
    Ok(())
}

/// Value of a loss and its gradient by all variables of `mlp`.
fn gradient_of(loss: &Tensor, mlp: &Mlp) -> Result<(f64, Vec<f32>)> {
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
