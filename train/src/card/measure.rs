//! The errors of a baked material over the held-out directions, as the definitions of [`StratumErrors`] say.

use super::batch::{BATCH, Buffers, Moments};
use super::bins::{Bins, SIDE, l1};
use super::heldout;
use super::truth::Truth;
use super::{Bias, Spread, StratumErrors};
use crate::Tick;
use crate::error::{Error, Result};
use crate::lobes::LUMINANCE;
use bake_runtime::Rng;
use bake_runtime::backend::Backend;
use bake_runtime::bsdf::shifted_r2;
use bake_runtime::conductor::Conductor;
use bake_runtime::estimator::exact_weight;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};

/// R2 points behind the binning and the learned estimator.
pub const BINNING_POINTS: u64 = 1 << 21;
/// Random points behind the exact estimators and the χ² test.
const EXACT_POINTS: usize = 1 << 18;
/// Points in the chart's square behind the errors of the evaluation and pdf networks.
const EVAL_POINTS: usize = 1 << 12;
/// Midpoints per side of a bin when the pdf network is integrated.
const PDF_SUB: usize = 4;
/// Bins that expect fewer samples are left out of χ², as its distribution asks.
const CHI2_MIN_EXPECTED: f64 = 5.0;
/// Independent blocks behind the standard error of a mean over R2 points.
const BLOCKS: usize = 16;
/// Key of the random points.
const KEY: u64 = 0xca2d;

/// Makes a backend; every worker thread gets its own.
pub type BackendFactory<'a> = &'a (dyn Fn() -> bake_runtime::Result<Box<dyn Backend>> + Sync);

/// Everything measured at one direction.
struct Measured {
    binning_l1: f64,
    binning_floor: f64,
    /// (bias, standard error) RGB of the three estimators.
    bias: [(DVec3, DVec3); 3],
    relvar: f64,
    weight_max: f64,
    fold: f64,
    coverage_loss: f64,
    chi2_effect: f64,
    eval_rel_l1: f64,
    eval_smape: f64,
    pdf_integral: f64,
    pdf_log_l1: f64,
}

/// Measures all strata, on every `every`-th of their directions.
///
/// # Errors
/// [`Error::Interrupted`] when `tick` breaks; whatever the backend reports.
pub fn errors(
    bsdf: &Conductor,
    backend: BackendFactory,
    every: usize,
    tick: Tick,
) -> Result<BTreeMap<String, StratumErrors>> {
    let strata = heldout::strata();
    let all: Vec<(&String, u64, DVec3)> = strata
        .iter()
        .flat_map(|(name, wos)| {
            wos.iter()
                .enumerate()
                .step_by(every)
                .map(move |(i, wo)| (name, i as u64, *wo))
        })
        .collect();
    let done = AtomicU64::new(0);
    let measured: Result<Vec<Measured>> = all
        .par_iter()
        .map(|&(name, i, wo)| {
            let key = name
                .bytes()
                .fold(i, |h, b| h.wrapping_mul(31).wrapping_add(u64::from(b)));
            let result = measure(bsdf, wo, backend()?.as_mut(), key)?;
            let count = done.fetch_add(1, Ordering::Relaxed) + 1;
            if tick(count, all.len() as u64).is_break() {
                Err(Error::Interrupted)
            } else {
                Ok(result)
            }
        })
        .collect();
    let measured = measured?;
    let of = |name: &str| -> Vec<&Measured> {
        all.iter()
            .zip(&measured)
            .filter(|((n, ..), _)| n.as_str() == name)
            .map(|(_, m)| m)
            .collect()
    };
    Ok(strata
        .keys()
        .map(|name| (name.clone(), summarise(&of(name))))
        .collect())
}

fn summarise(rows: &[&Measured]) -> StratumErrors {
    let n = rows.len() as f64;
    let mean = |f: &dyn Fn(&Measured) -> f64| rows.iter().map(|m| f(m)).sum::<f64>() / n;
    let max = |f: &dyn Fn(&Measured) -> f64| rows.iter().map(|m| f(m)).fold(0.0, f64::max);
    let spread = |f: &dyn Fn(&Measured) -> f64| Spread {
        mean: mean(f),
        worst: max(f),
    };
    let bias = |e: usize| {
        let mean_rgb = [0, 1, 2].map(|c: usize| mean(&|m| m.bias[e].0[c]));
        let se =
            [0, 1, 2].map(|c: usize| rows.iter().map(|m| m.bias[e].1[c].powi(2)).sum::<f64>().sqrt() / n);
        let all = rows.iter().flat_map(|m| m.bias[e].0.to_array());
        Bias {
            mean: mean_rgb.iter().sum::<f64>() / 3.0,
            worst: all.fold(0.0, |w: f64, b| if b.abs() > w.abs() { b } else { w }),
            // Channels share their samples, so their errors add up rather than average out.
            se: se.iter().sum::<f64>() / 3.0,
            mean_rgb,
        }
    };
    let farthest =
        rows.iter().map(|m| m.pdf_integral).fold(
            1.0,
            |w: f64, p| if (p - 1.0).abs() > (w - 1.0).abs() { p } else { w },
        );
    StratumErrors {
        binning_l1: spread(&|m| m.binning_l1),
        binning_floor: mean(&|m| m.binning_floor),
        albedo_bias_learned: bias(0),
        albedo_bias_exact: bias(1),
        albedo_bias_exact_baked: bias(2),
        weight_relvar_exact: spread(&|m| m.relvar),
        weight_max_exact: max(&|m| m.weight_max),
        fold_fraction: mean(&|m| m.fold),
        coverage_loss: mean(&|m| m.coverage_loss),
        chi2_effect: spread(&|m| m.chi2_effect),
        eval_rel_l1: spread(&|m| m.eval_rel_l1),
        eval_smape: mean(&|m| m.eval_smape),
        pdf_integral: Spread {
            mean: mean(&|m| m.pdf_integral),
            worst: farthest,
        },
        pdf_log_l1: mean(&|m| m.pdf_log_l1),
    }
}

fn measure(bsdf: &Conductor, wo: DVec3, backend: &mut dyn Backend, key: u64) -> Result<Measured> {
    let truth = Truth::new(bsdf, wo)?;
    let mut buffers = Buffers::new(wo);
    let (binning_l1, coverage_loss, learned) = learned_estimator(&truth, backend, &mut buffers)?;
    let exact = exact_estimators(bsdf, &truth, backend, &mut buffers, key)?;
    let (eval_rel_l1, eval_smape, pdf_integral) = densities(&truth, backend, &mut buffers)?;
    Ok(Measured {
        binning_l1,
        binning_floor: truth.binned.floor(BINNING_POINTS),
        bias: [learned, exact.bias, exact.bias_baked],
        relvar: exact.relvar,
        weight_max: exact.weight_max,
        fold: exact.fold,
        coverage_loss,
        chi2_effect: exact.chi2_effect,
        eval_rel_l1,
        eval_smape,
        pdf_integral,
        pdf_log_l1: exact.pdf_log_l1,
    })
}

/// Binning L1, share of energy in bins without a sample, and the bias of the learned weights.
fn learned_estimator(
    truth: &Truth,
    backend: &mut dyn Backend,
    buffers: &mut Buffers,
) -> Result<(f64, f64, (DVec3, DVec3))> {
    let mut counts = vec![0u64; SIDE * SIDE];
    // Every block of consecutive R2 points is itself of low discrepancy: the spread of their means gives the error.
    let mut blocks = Moments::default();
    let calls = BINNING_POINTS as usize / BATCH;
    let mut block = Moments::default();
    for call in 0..calls {
        for i in 0..BATCH {
            buffers.set_u(i, shifted_r2((call * BATCH + i) as u64, [0.0; 2]));
        }
        buffers.sample_learned(backend)?;
        for i in 0..BATCH {
            counts[truth.binned.bins.index(buffers.wi(i))] += 1;
            block.add(buffers.rgb(i));
        }
        if (call + 1) % (calls / BLOCKS) == 0 {
            blocks.add(block.mean());
            block = Moments::default();
        }
    }
    let total = truth.binned.mass.iter().sum::<f64>();
    let lost = counts
        .iter()
        .zip(&truth.binned.mass)
        .filter(|(c, _)| **c == 0)
        .map(|(_, m)| m / total)
        .sum();
    Ok((l1(&counts, &truth.binned.mass), lost, blocks.bias(truth)))
}

struct Exact {
    bias: (DVec3, DVec3),
    bias_baked: (DVec3, DVec3),
    relvar: f64,
    weight_max: f64,
    fold: f64,
    chi2_effect: f64,
    pdf_log_l1: f64,
}

fn exact_estimators(
    bsdf: &Conductor,
    truth: &Truth,
    backend: &mut dyn Backend,
    buffers: &mut Buffers,
    key: u64,
) -> Result<Exact> {
    let mut rng = Rng::new(&[KEY, key]);
    let (mut exact, mut baked, mut luminance) = (Moments::default(), Moments::default(), Moments::default());
    let mut counts = vec![0u64; SIDE * SIDE];
    let (mut folds, mut weight_max, mut log_l1) = (0u64, 0.0f64, 0.0);
    for call in 0..EXACT_POINTS / BATCH {
        for i in 0..BATCH {
            let u = rng.pair();
            buffers.set_u(i, u);
        }
        buffers.sample_jacobian(backend)?;
        let jacobian = buffers.scalar.clone();
        buffers.eval(backend)?;
        buffers.pdf(backend)?;
        for (i, &jacobian) in jacobian.iter().enumerate() {
            let jacobian = f64::from(jacobian);
            let wi = buffers.wi(i);
            counts[truth.binned.bins.index(wi)] += 1;
            folds += u64::from(jacobian < 0.0);
            let mut walk = Rng::new(&[KEY, key, call as u64, i as u64]);
            let weight = exact_weight(bsdf, truth.wo, wi, jacobian, &mut walk);
            exact.add(weight);
            luminance.add(DVec3::splat(weight.dot(LUMINANCE)));
            weight_max = weight_max.max(weight.dot(LUMINANCE));
            baked.add(buffers.rgb(i) * jacobian);
            let density = 1.0 / jacobian.abs().max(f64::MIN_POSITIVE);
            log_l1 += (f64::from(buffers.scalar[i]).ln_1p() - density.ln_1p()).abs();
        }
    }
    let mean = luminance.mean().x;
    Ok(Exact {
        bias: exact.bias(truth),
        bias_baked: baked.bias(truth),
        relvar: (luminance.square.x / luminance.count - mean * mean) / (mean * mean),
        weight_max,
        fold: folds as f64 / EXACT_POINTS as f64,
        chi2_effect: chi2_effect(truth.wo, &truth.binned.bins, &counts, backend)?,
        pdf_log_l1: log_l1 / EXACT_POINTS as f64,
    })
}

/// sqrt(max(0, χ² − dof) / (N·mass)) of `counts` against the pdf network.
fn chi2_effect(wo: DVec3, bins: &Bins, counts: &[u64], backend: &mut dyn Backend) -> Result<f64> {
    let nodes: Vec<(usize, DVec3, f64)> = bins.nodes(PDF_SUB).collect();
    let mut mass = vec![0.0; SIDE * SIDE];
    let mut buffers = Buffers::new(wo);
    for chunk in nodes.chunks(BATCH) {
        for (i, (_, wi, _)) in chunk.iter().enumerate() {
            buffers.set_wi(i, *wi);
        }
        buffers.pdf(backend)?;
        for ((bin, _, solid_angle), pdf) in chunk.iter().zip(&buffers.scalar) {
            mass[*bin] += f64::from(*pdf) * solid_angle;
        }
    }
    let n = counts.iter().sum::<u64>() as f64;
    let (mut chi2, mut dof, mut covered) = (0.0, 0.0, 0.0);
    for (count, mass) in counts.iter().zip(&mass) {
        let expected = n * mass;
        if expected >= CHI2_MIN_EXPECTED {
            chi2 += (*count as f64 - expected).powi(2) / expected;
            dof += 1.0;
            covered += mass;
        }
    }
    Ok(((chi2 - dof).max(0.0) / (n * covered)).sqrt())
}

/// Relative L1 and SMAPE of the evaluation network, and the integral of the pdf network, over the square of the
/// reference's chart.
fn densities(truth: &Truth, backend: &mut dyn Backend, buffers: &mut Buffers) -> Result<(f64, f64, f64)> {
    let chart = &truth.chart;
    let (mut error, mut energy, mut smape, mut integral) = (0.0, 0.0, 0.0, 0.0);
    for call in 0..EVAL_POINTS / BATCH {
        let mut measures = Vec::with_capacity(BATCH);
        for i in 0..BATCH {
            let s = shifted_r2((call * BATCH + i) as u64, [0.0; 2]);
            let (w, area) = chart.square_to_direction(s);
            buffers.set_wi(i, DVec3::from_array(w));
            measures.push(area);
        }
        buffers.eval(backend)?;
        buffers.pdf(backend)?;
        for (i, measure) in measures.iter().enumerate() {
            let f = truth.binned.f_cos(buffers.wi(i));
            let difference = (buffers.rgb(i) - f).abs();
            error += difference.element_sum() * measure;
            energy += f.element_sum() * measure;
            let both = (buffers.rgb(i) + f).max(DVec3::splat(f64::MIN_POSITIVE));
            smape += (difference / both).element_sum() / 3.0;
            integral += f64::from(buffers.scalar[i]) * measure;
        }
    }
    Ok((
        error / energy,
        smape / EVAL_POINTS as f64,
        integral / EVAL_POINTS as f64,
    ))
}
