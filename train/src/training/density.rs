//! Training of the evaluation and the pdf network.
//!
//! Both see the light's direction in the lobe frame and give the logarithm of a density relative to the
//! frame's own: the six decades that f_cos spans become numbers of order one. Targets are free of noise (the
//! slice tables average walks before any logarithm is taken), so logarithmic and L1 losses do not bias them.

use super::data::TrainingSet;
use super::sample::warp;
use super::trainer::{Plan, Trainer};
use crate::Tick;
use crate::error::Result;
use crate::nn::mlp::Mlp;
use bake_runtime::concentric::square_to_hemisphere;
use bake_runtime::encoding::GRAZING_FEATURES;
use bake_runtime::spec::{EXPONENT_MAX, NetworkSpec};
use candle_core::{Device, Tensor};
use std::path::Path;

/// Weight of the logarithmic error beside the linear one: it holds the tails, which carry little energy.
const LOG_WEIGHT: f64 = 0.1;
/// Densities of the sampler below this count as this: a fold has no density.
const DET_MIN: f64 = 1e-3;
/// Scalars of the local direction in front of the features of wo.
const LOCAL_FEATURES: usize = 3;

fn features(
    set: &TrainingSet,
    slices: &[usize],
    positions: impl Iterator<Item = [f32; 2]>,
) -> Result<Tensor> {
    let width = LOCAL_FEATURES + GRAZING_FEATURES;
    let mut rows = Vec::with_capacity(slices.len() * width);
    for (k, s) in slices.iter().zip(positions) {
        let s = s.map(f64::from);
        rows.extend(square_to_hemisphere(s, [1.0 - s[0], 1.0 - s[1]]).map(|v| v as f32));
        rows.extend(set.features[*k]);
    }
    Ok(Tensor::from_vec(rows, (slices.len(), width), &Device::Cpu)?)
}

/// Trains the evaluation network of `spec`: output c is ln(f_cos_c·dω/ds) in the frame's square.
///
/// The loss is the relative L1 error of the slice plus [`LOG_WEIGHT`] times the logarithmic one.
///
/// # Errors
/// As [`Trainer::run`].
pub fn train_eval(
    spec: &NetworkSpec,
    plan: Plan,
    set: &TrainingSet,
    folder: &Path,
    context: &str,
    tick: Tick,
) -> Result<Mlp> {
    let trainer = Trainer::new(plan, &spec.layers(), folder, context)?;
    trainer.run(
        |mlp, _, size, rng| {
            let batch = set.draw(size, rng);
            let output = mlp.forward(&features(set, &batch.slices, batch.positions.iter().copied())?, 1)?;
            let mut targets = Vec::with_capacity(3 * size);
            let mut scale = Vec::with_capacity(3 * size);
            for (k, s) in batch.slices.iter().zip(&batch.positions) {
                let s = s.map(f64::from);
                targets.extend(set.log_density.iter().map(|splines| splines[*k].at(s).0 as f32));
                scale.extend(set.albedo[*k].to_array().map(|a| 1.0 / a as f32));
            }
            let targets = Tensor::from_vec(targets, (size, 3), &Device::Cpu)?;
            let scale = Tensor::from_vec(scale, (size, 3), &Device::Cpu)?;
            let output = output.clamp(-EXPONENT_MAX, EXPONENT_MAX)?;
            let linear = ((output.exp()? - targets.exp()?)?.abs()? * scale)?.mean_all()?;
            let log = (output - targets)?.abs()?.mean_all()?;
            Ok((linear + (log * LOG_WEIGHT)?)?)
        },
        tick,
    )
}

/// Trains the pdf network of `spec` on the density of the sampling network `sampler` itself: the output is
/// −ln det Dh at the position h(u), for uniform u.
///
/// # Errors
/// As [`Trainer::run`].
pub fn train_pdf(
    spec: &NetworkSpec,
    plan: Plan,
    set: &TrainingSet,
    sampler: &Mlp,
    folder: &Path,
    context: &str,
    tick: Tick,
) -> Result<Mlp> {
    let trainer = Trainer::new(plan, &spec.layers(), folder, context)?;
    trainer.run(
        |mlp, _, size, rng| {
            let batch = set.draw(size, rng);
            let (h, det, _) = warp(sampler, set, &batch)?;
            let positions = h.detach().to_vec2::<f32>()?;
            let target = det.detach().abs()?.maximum(DET_MIN)?.log()?.neg()?;
            let x = features(set, &batch.slices, positions.iter().map(|p| [p[0], p[1]]))?;
            let output = mlp.forward(&x, 1)?.squeeze(1)?;
            // Drawn with the density itself, so the mean of |p̂/p − 1| is the L1 error of the pdf.
            let log = (output.clamp(-EXPONENT_MAX, EXPONENT_MAX)? - target)?;
            Ok(((log.exp()? - 1.0)?.abs()?.mean_all()? + (log.abs()?.mean_all()? * LOG_WEIGHT)?)?)
        },
        tick,
    )
}
