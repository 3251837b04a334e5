//! Training of the warp sampling network.
//!
//! First the map: L1 distance to the importance map. Then the density: with h the network's position in the
//! frame's square, the ratio r = q(h)·det Dh of target to sampled density should be 1 everywhere, so |ln r|
//! is driven to zero, with both tangents carried through the network. The three remaining outputs learn the
//! weight that the network's own map needs, f_cos·jacobian, by least squares (whose optimum is its mean).

use super::data::{Batch, TrainingSet};
use super::trainer::{Plan, Trainer};
use crate::Tick;
use crate::error::Result;
use crate::nn::lookup::Lookup;
use crate::nn::mlp::Mlp;
use bake_runtime::encoding::GRAZING_FEATURES;
use bake_runtime::spec::{NetworkSpec, WARP_SHIFT_MAX};
use candle_core::{Device, Tensor};
use candle_nn::ops::sigmoid;
use std::path::Path;

/// Share of the steps spent on the map alone.
pub const MAP_SHARE: f64 = 0.3;
/// Weight of the map's distance while the density is trained: it keeps the map from wandering into folds.
const MAP_WEIGHT: f64 = 0.3;
/// Weight of the learned weight's squared error, relative to the albedo.
const WEIGHT_WEIGHT: f64 = 0.3;
/// Ratios below this count linearly, so that a fold is pushed out instead of giving NaN.
const RATIO_FLOOR: f64 = 1e-2;
/// Learned weights aim at most at this many albedos: what exceeds it is rare, and would only add noise.
const WEIGHT_MAX: f32 = 5.0;
/// Features of u in front of those of wo.
const U_FEATURES: usize = 2;

/// Trains the network of `spec` on `set`.
///
/// # Errors
/// As [`Trainer::run`].
pub fn train(
    spec: &NetworkSpec,
    plan: Plan,
    set: &TrainingSet,
    folder: &Path,
    context: &str,
    tick: Tick,
) -> Result<Mlp> {
    let map_steps = (plan.steps as f64 * MAP_SHARE) as u64;
    let trainer = Trainer::new(plan, &spec.layers(), folder, context)?;
    trainer.run(
        |mlp, step, size, rng| {
            let batch = set.draw(size, rng);
            if step < map_steps {
                map_loss(mlp, set, &batch)
            } else {
                density_loss(mlp, set, &batch)
            }
        },
        tick,
    )
}

/// Rows of features: values, and with `tangents` the two blocks of derivatives by u.
pub fn features(set: &TrainingSet, batch: &Batch, tangents: bool) -> Result<Tensor> {
    let width = U_FEATURES + GRAZING_FEATURES;
    let size = batch.positions.len();
    let mut rows = Vec::with_capacity(3 * size * width);
    for (k, u) in batch.slices.iter().zip(&batch.positions) {
        rows.extend(u.map(|v| 2.0 * v - 1.0));
        rows.extend(set.features[*k]);
    }
    if tangents {
        rows.resize(3 * size * width, 0.0);
        for i in 0..size {
            rows[(size + i) * width] = 2.0;
            rows[(2 * size + i) * width + 1] = 2.0;
        }
    }
    let columns = if tangents { 3 } else { 1 };
    Ok(Tensor::from_vec(rows, (columns * size, width), &Device::Cpu)?)
}

/// Position h = σ(logit u + g) `[B, 2]` from rows of outputs.
fn positions(batch: &Batch, output: &Tensor) -> Result<Tensor> {
    let size = batch.positions.len();
    let logits = batch
        .positions
        .iter()
        .flat_map(|u| u.map(|v| (v / (1.0 - v)).ln()))
        .collect();
    let logits = Tensor::from_vec(logits, (size, 2), &Device::Cpu)?;
    let shift = output
        .narrow(0, 0, size)?
        .narrow(1, 0, 2)?
        .clamp(-WARP_SHIFT_MAX, WARP_SHIFT_MAX)?;
    Ok(sigmoid(&(logits + shift)?)?)
}

fn map_distance(set: &TrainingSet, batch: &Batch, h: &Tensor) -> Result<Tensor> {
    let targets: Vec<f32> = batch
        .slices
        .iter()
        .zip(&batch.positions)
        .flat_map(|(k, u)| set.map_at(*k, *u))
        .collect();
    let targets = Tensor::from_vec(targets, (batch.positions.len(), 2), &Device::Cpu)?;
    Ok(((h - targets)?.abs()?.mean_all()? * 2.0)?)
}

fn map_loss(mlp: &Mlp, set: &TrainingSet, batch: &Batch) -> Result<Tensor> {
    let output = mlp.forward(&features(set, batch, false)?, 1)?;
    map_distance(set, batch, &positions(batch, &output)?)
}

/// Position and determinant of the map at every sample: `[B, 2]` and `[B]`.
pub fn warp(mlp: &Mlp, set: &TrainingSet, batch: &Batch) -> Result<(Tensor, Tensor, Tensor)> {
    let size = batch.positions.len();
    let output = mlp.forward(&features(set, batch, true)?, 3)?;
    let h = positions(batch, &output)?;
    // ∂h_c/∂u_j = h_c(1 − h_c)/v_c · (δ_cj + v_c·∂g_c/∂u_j) with v = u(1 − u).
    let spread: Vec<f32> = batch
        .positions
        .iter()
        .flat_map(|u| u.map(|v| v * (1.0 - v)))
        .collect();
    let spread = Tensor::from_vec(spread, (size, 2), &Device::Cpu)?;
    let slope = ((&h * (1.0 - &h)?)? / &spread)?;
    let tangent =
        |t: usize| -> Result<Tensor> { Ok((output.narrow(0, t * size, size)?.narrow(1, 0, 2)? * &spread)?) };
    let (by_x, by_y) = (tangent(1)?, tangent(2)?);
    let column = |t: &Tensor, c: usize| -> Result<Tensor> { Ok(t.narrow(1, c, 1)?.squeeze(1)?) };
    let diagonal = ((column(&by_x, 0)? + 1.0)? * (column(&by_y, 1)? + 1.0)?)?;
    let crossed = (column(&by_x, 1)? * column(&by_y, 0)?)?;
    let det = ((diagonal - crossed)? * (column(&slope, 0)? * column(&slope, 1)?)?)?;
    Ok((h, det, output.narrow(0, 0, size)?))
}

fn density_loss(mlp: &Mlp, set: &TrainingSet, batch: &Batch) -> Result<Tensor> {
    let (h, det, output) = warp(mlp, set, batch)?;
    let h = h.contiguous()?;
    let log_q = h.apply_op1(Lookup {
        splines: set.log_luminance.clone(),
        indices: batch.slices.clone(),
    })?;
    let ratio = (log_q.exp()? * &det)?;
    let linear = ((&ratio * (1.0 / RATIO_FLOOR))? + (RATIO_FLOOR.ln() - 1.0))?;
    let small = ratio.lt(RATIO_FLOOR)?;
    let log_ratio = small.where_cond(&linear, &ratio.maximum(RATIO_FLOOR)?.log()?)?;
    let density = log_ratio.abs()?.mean_all()?;

    let detached = h.detach();
    let mut targets = Vec::new();
    for splines in &set.log_density {
        let lookup = Lookup {
            splines: splines.clone(),
            indices: batch.slices.clone(),
        };
        targets.push((detached.apply_op1_no_bwd(&lookup)?.exp()? * det.detach())?);
    }
    let per_albedo = batch
        .slices
        .iter()
        .flat_map(|k| set.albedo[*k].to_array().map(|a| 1.0 / a as f32));
    let per_albedo = Tensor::from_vec(per_albedo.collect(), (batch.slices.len(), 3), &Device::Cpu)?;
    let targets = (Tensor::stack(&targets, 1)? * &per_albedo)?.clamp(0f32, WEIGHT_MAX)?;
    let weights = (output.narrow(1, 2, 3)?.exp()? * per_albedo)?;
    let weight = (weights - targets)?.sqr()?.mean_all()?;
    let map = map_distance(set, batch, &h)?;
    Ok(((density + (map * MAP_WEIGHT)?)? + (weight * WEIGHT_WEIGHT)?)?)
}
