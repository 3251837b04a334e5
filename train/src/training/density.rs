//! Training of the evaluation and the pdf network of the warp preset.
//!
//! Both see the light's direction in the frames of the charts and give the logarithm of a density relative to a frame's
//! own: the six decades that f_cos spans become numbers of order one.
//!
//! **Noise.** Values of the stochastic models are estimates. A loss whose gradient is not linear in its target, as that of
//! every L1 or logarithmic one, leads to another number than their mean: to the median or to the mean logarithm. Here the
//! loss is ((f̂ − f)/s)² with a scale s that does not know f (Lehtinen et al. 2018, *Noise2Noise*, §3.1, has the same loss
//! for rendered pictures). s is made of f̂, but counts as a constant in the gradient, which is therefore linear in f and
//! vanishes on average where f̂ is the mean of f, and only there. With s differentiated as well the minimum would lie at
//! E f²/E f, above the mean.

use super::data::{Pick, TrainingSet};
use super::fresh::{Evaluation, Evaluations, Fresh};
use super::mlp::Mlp;
use super::run::Plan;
use super::sample::{Warp, u_features};
use super::trainer::Trainer;
use crate::Tick;
use crate::charts::ChartsNetwork;
use crate::error::Result;
use crate::fused::{Features, Fused, Outputs, OutputsMut, TileLoss};
use bake_runtime::concentric::square_to_hemisphere;
use bake_runtime::encoding::Quantity;
use bake_runtime::simd::{Simd, Tier};
use bake_runtime::spec::{CHARTS_MAX, EXPONENT_MAX};
use bake_runtime::{Material, NetworkSpec, Rng};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

#[cfg(test)]
mod tests;

/// Share of the level of the light that the scale of an error never falls below.
const LEVEL_SHARE: f32 = 0.1;
/// Share of the brightest channel that the scale of another never falls below.
const GREY_SHARE: f32 = 0.1;
/// Weight of the logarithmic error of the pdf beside the linear one: it holds the tails, which carry few samples.
const LOG_WEIGHT: f64 = 0.1;
/// Densities of the sampler above this, relative to its frame, count as this: a fold has none.
const DET_MIN: f64 = 1e-3;

/// Trains the evaluation network of `spec`: output 3i + c is ln of lobe i's f_cos_c over the density of its frame.
///
/// # Errors
/// As [`Trainer::run`].
pub fn train_eval(
    spec: &NetworkSpec,
    plan: Plan,
    material: &Material,
    charts: &ChartsNetwork,
    folder: &Path,
    context: &str,
    tick: Tick,
) -> Result<Mlp> {
    let size = plan.batch;
    let fresh = Fresh {
        material,
        spec,
        network: charts,
    };
    let trainer = Trainer::new(plan, &spec.layers(), spec.activation, folder, context)?;
    let loss = |_: u64, rng: &mut Rng| {
        let batch = EvalLoss {
            charts: charts.spec.anchors.len(),
            width: spec.input_features(),
            batch: fresh.draw(size, rng)?,
        };
        Ok((1, batch))
    };
    trainer.run(loss, tick)
}

/// Squared error of every lobe and channel over the scale of the light at wi.
struct EvalLoss {
    charts: usize,
    width: usize,
    batch: Evaluations,
}

impl EvalLoss {
    /// Loss of one evaluation and its gradient by the outputs, the scale a constant.
    fn of(&self, value: &Evaluation, outputs: &[f32], gradient: &mut [f32]) -> f64 {
        let mut predicted = [[0f32; 3]; CHARTS_MAX];
        let mut total = [LEVEL_SHARE * value.level; 3];
        for i in 0..self.charts {
            for c in 0..3 {
                let max = EXPONENT_MAX as f32;
                predicted[i][c] = value.density[i] * outputs[3 * i + c].clamp(-max, max).exp();
                total[c] += predicted[i][c];
            }
        }
        let brightest = total.iter().fold(0f32, |a, b| a.max(*b));
        let mut loss = 0.0;
        for i in 0..self.charts {
            for c in 0..3 {
                let scale = 1.0 / total[c].max(GREY_SHARE * brightest);
                let error = (predicted[i][c] - value.f_cos[i][c]) * scale;
                loss += f64::from(error * error);
                gradient[3 * i + c] = 2.0 * error * predicted[i][c] * scale;
            }
        }
        loss
    }
}

impl TileLoss for EvalLoss {
    #[inline(always)]
    fn features<S: Simd>(&self, _: S, queries: Range<usize>, rows: &mut Features) {
        for (i, k) in queries.enumerate() {
            let own = &self.batch.features[k * self.width..(k + 1) * self.width];
            rows.row(0, i).copy_from_slice(own);
        }
    }

    fn loss<S: Simd>(
        &self,
        _: S,
        queries: Range<usize>,
        outputs: &Outputs,
        gradient: &mut OutputsMut,
    ) -> f64 {
        let count = 3 * self.charts;
        let mut loss = 0.0;
        for (i, k) in queries.enumerate() {
            let (mut own, mut slope) = ([0.0; 3 * CHARTS_MAX], [0.0; 3 * CHARTS_MAX]);
            for (o, own) in own.iter_mut().enumerate().take(count) {
                *own = outputs.plane(0, o)[i];
            }
            loss += self.of(&self.batch.values[k], &own, &mut slope);
            for (o, slope) in slope.iter().enumerate().take(count) {
                gradient.plane(0, o)[i] = *slope;
            }
        }
        loss
    }
}

/// Trains the pdf network of `spec` on the density of the sampling network `sampler` itself: the output of the drawn chart
/// is −ln det Dh at the position h(u), for uniform u.
///
/// # Errors
/// As [`Trainer::run`].
pub fn train_pdf(
    spec: &NetworkSpec,
    plan: Plan,
    set: &Arc<TrainingSet>,
    (sampler_spec, sampler): (&NetworkSpec, &Mlp),
    folder: &Path,
    context: &str,
    tick: Tick,
) -> Result<Mlp> {
    let size = plan.batch;
    let places = Arc::new(set.place_features(spec));
    let sampler_places = set.place_features(sampler_spec);
    let shape = super::trainer::shape(&sampler.layers, sampler_spec.activation)?;
    let mut kernel = Fused::new(Tier::chosen()?, shape, 3)?;
    let locals = spec
        .inputs
        .iter()
        .filter(|i| matches!(i.quantity, Quantity::Local(_)))
        .count();
    let trainer = Trainer::new(plan, &spec.layers(), spec.activation, folder, context)?;
    let loss = |_: u64, rng: &mut Rng| {
        let picks = set.draw(size, rng);
        let outputs = kernel.forward(&sampler.values, &u_features(&picks, &sampler_places))?;
        let width = outputs.len() / (3 * size);
        let at = |column: usize, i: usize, c: usize| outputs[(column * size + i) * width + c];
        let targets = picks.iter().enumerate().map(|(i, pick)| {
            let slopes = [0, 1].map(|c| [at(1, i, c), at(2, i, c)]);
            let warp = Warp::new(pick.at, [at(0, i, 0), at(0, i, 1)], slopes);
            let entry = &set.entries[pick.entry];
            let mut local = [[0f32; 3]; CHARTS_MAX];
            let (_, own) = entry.own_chart();
            let here = square_to_hemisphere(warp.h, warp.complement);
            let (wi, _) = own.square_to_direction(warp.h);
            for (k, (_, chart)) in entry.charts.iter().enumerate() {
                let v = if k == entry.chart {
                    here
                } else {
                    chart.to_local(wi).0
                };
                local[k] = v.map(|v| v as f32);
            }
            (local, -warp.det().abs().max(DET_MIN).ln())
        });
        let targets = targets.collect();
        let batch = PdfLoss {
            set: set.clone(),
            places: places.clone(),
            locals,
            targets,
            picks,
        };
        Ok((1, batch))
    };
    trainer.run(loss, tick)
}

/// Drawn with the density itself, the mean of |p̂/p − 1| is the L1 error of the pdf.
struct PdfLoss {
    set: Arc<TrainingSet>,
    places: Arc<Vec<Vec<f32>>>,
    /// Number of charts whose local directions come first.
    locals: usize,
    targets: Vec<([[f32; 3]; CHARTS_MAX], f64)>,
    picks: Vec<Pick>,
}

impl TileLoss for PdfLoss {
    #[inline(always)]
    fn features<S: Simd>(&self, _: S, queries: Range<usize>, rows: &mut Features) {
        for (i, k) in queries.enumerate() {
            let row = rows.row(0, i);
            let (local, rest) = row.split_at_mut(3 * self.locals);
            local.copy_from_slice(self.targets[k].0[..self.locals].as_flattened());
            rest.copy_from_slice(&self.places[self.picks[k].entry]);
        }
    }

    fn loss<S: Simd>(
        &self,
        _: S,
        queries: Range<usize>,
        outputs: &Outputs,
        gradient: &mut OutputsMut,
    ) -> f64 {
        let mut loss = 0.0;
        for (i, k) in queries.enumerate() {
            let chart = self.set.entries[self.picks[k].entry].chart;
            let log =
                f64::from(outputs.plane(0, chart)[i]).clamp(-EXPONENT_MAX, EXPONENT_MAX) - self.targets[k].1;
            let ratio = log.exp();
            loss += (ratio - 1.0).abs() + LOG_WEIGHT * log.abs();
            gradient.plane(0, chart)[i] = ((ratio - 1.0).signum() * ratio + LOG_WEIGHT * log.signum()) as f32;
        }
        loss
    }
}
