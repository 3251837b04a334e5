//! What the estimators of one slice score: the learned one on points of low discrepancy, the exact ones on random points,
//! as χ² and standard errors ask.

use super::Mixture;
use super::batch::{BATCH, Buffers};
use super::bins::{SIDE, l1};
use super::judgement::relative;
use super::measure::Samples;
use super::truth::Truth;
use crate::lobes::LUMINANCE;
use bake_runtime::bsdf::shifted_r2;
use bake_runtime::estimator::exact_weight;
use bake_runtime::moments::Moments;
use bake_runtime::{Backend, Estimate, Reference, Result, Rng};
use glam::DVec3;

/// Independent blocks behind the standard error of a mean over R2 points.
const BLOCKS: usize = 64;
/// Of the exact points, every so many are evaluated with a layered reference: it costs microseconds, and its own noise and
/// that of the true albedo make more of them no use. The map alone is judged on all.
const LAYERED_EVERY: usize = 4;
/// Key of the random points.
const KEY: u64 = 0xca2d;

/// Scores of the learned estimator.
pub(super) struct Learned {
    pub binning_l1: f64,
    /// Share of energy in bins without a sample.
    pub coverage_loss: f64,
    /// Relative, of the albedo.
    pub bias: Estimate,
}

/// Measures the learned estimator.
pub(super) fn learned(
    truth: &Truth,
    samples: &Samples,
    backend: &dyn Backend,
    buffers: &mut Buffers,
) -> Result<Learned> {
    let mut counts = vec![0u64; SIDE * SIDE];
    // Every block of consecutive R2 points is itself of low discrepancy: the spread of their means gives the error.
    let mut blocks = Moments::default();
    let calls = samples.binning as usize / BATCH;
    let per_block = (calls / BLOCKS).max(1);
    let mut block = DVec3::ZERO;
    for call in 0..calls {
        for i in 0..BATCH {
            buffers.set_u(i, shifted_r2((call * BATCH + i) as u64, [0.0; 2]));
        }
        buffers.sample_learned(backend)?;
        for i in 0..BATCH {
            counts[truth.binned.bins.index(buffers.wi(i))] += 1;
            block += buffers.rgb(i);
        }
        if (call + 1) % per_block == 0 {
            blocks.add(block / (per_block * BATCH) as f64);
            block = DVec3::ZERO;
        }
    }
    let mass = &truth.binned.mass;
    let lost: f64 = counts
        .iter()
        .zip(mass)
        .filter(|(c, _)| **c == 0)
        .map(|(_, m)| m)
        .sum();
    Ok(Learned {
        binning_l1: l1(&counts, mass),
        coverage_loss: lost / mass.iter().sum::<f64>(),
        bias: relative(blocks.estimate(), truth.albedo),
    })
}

/// Luminance weights: their relative variance, and the largest.
#[derive(Default)]
struct Luminance {
    moments: Moments,
    count: f64,
    max: f64,
}

impl Luminance {
    fn add(&mut self, weight: DVec3) {
        let luminance = weight.dot(LUMINANCE);
        self.moments.add(DVec3::splat(luminance));
        self.count += 1.0;
        self.max = self.max.max(luminance);
    }

    /// Variance over squared mean.
    fn relvar(&self) -> f64 {
        let Estimate { mean, se } = self.moments.estimate();
        se.x * se.x * self.count / (mean.x * mean.x).max(f64::MIN_POSITIVE)
    }
}

/// Scores of the exact estimators; biases are relative.
pub(super) struct Exact {
    pub bias: Estimate,
    pub bias_map: Estimate,
    pub bias_baked: Estimate,
    pub relvar: f64,
    pub relvar_map: f64,
    pub weight_max: f64,
    pub weight_max_map: f64,
    pub fold: f64,
    pub pdf_log_l1: f64,
    /// Samples in the bins of the truth.
    pub counts: Vec<u64>,
}

/// Measures the exact estimators; `key` tells the slice from others.
pub(super) fn exact(
    reference: &Reference,
    truth: &Truth,
    samples: &Samples,
    backend: &dyn Backend,
    buffers: &mut Buffers,
    key: u64,
) -> Result<Exact> {
    let mut rng = Rng::new(&[KEY, key]);
    let [mut with_reference, mut alone, mut baked] = [Moments::default(); 3];
    let (mut luminance, mut luminance_alone) = (Luminance::default(), Luminance::default());
    let mut counts = vec![0u64; SIDE * SIDE];
    let (mut folds, mut log_l1, mut dense) = (0u64, 0.0, 0u64);
    let every = reference_every(reference);
    let calls = samples.exact / BATCH;
    for call in 0..calls {
        for i in 0..BATCH {
            buffers.set_u(i, rng.pair());
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
            if i % every == 0 {
                let mut walk = Rng::new(&[KEY, key, call as u64, i as u64]);
                let weight = exact_weight(reference, truth.wo, wi, jacobian, &mut walk);
                with_reference.add(weight);
                luminance.add(weight);
            }
            let weight = truth.f_cos(wi) * jacobian;
            alone.add(weight);
            luminance_alone.add(weight);
            baked.add(buffers.rgb(i) * jacobian);
            if jacobian != 0.0 {
                let density = 1.0 / jacobian.abs();
                log_l1 += (f64::from(buffers.scalar[i]).ln_1p() - density.ln_1p()).abs();
                dense += 1;
            }
        }
    }
    Ok(Exact {
        bias: relative(with_reference.estimate(), truth.albedo),
        bias_map: relative(alone.estimate(), truth.lobes_albedo),
        bias_baked: relative(baked.estimate(), truth.albedo),
        relvar: luminance.relvar(),
        relvar_map: luminance_alone.relvar(),
        weight_max: luminance.max,
        weight_max_map: luminance_alone.max,
        fold: folds as f64 / (calls * BATCH) as f64,
        pdf_log_l1: log_l1 / dense.max(1) as f64,
        counts,
    })
}

fn reference_every(reference: &Reference) -> usize {
    match reference {
        Reference::Layered(_) => LAYERED_EVERY,
        _ => 1,
    }
}

/// Scores of the exact mixture of two charts.
pub(super) struct Mixed {
    /// Relative, of the albedo, with the reference's f_cos.
    pub bias: Estimate,
    /// On f_cos without noise.
    pub relvar: f64,
    /// On f_cos without noise.
    pub weight_max: f64,
    /// Share of samples whose map could not be inverted.
    pub unconverged: f64,
}

/// Measures the mixture; `key` tells the slice from others.
pub(super) fn mixed(
    reference: &Reference,
    truth: &Truth,
    samples: &Samples,
    mixture: &Mixture,
    buffers: &mut Buffers,
    key: u64,
) -> Result<Mixed> {
    let mut rng = Rng::new(&[KEY, key, 1]);
    let mut with_reference = Moments::default();
    let mut luminance = Luminance::default();
    let mut unconverged = 0;
    let every = reference_every(reference);
    let calls = samples.mixture / BATCH;
    for call in 0..calls {
        for i in 0..BATCH {
            buffers.set_u(i, rng.pair());
        }
        unconverged += buffers.sample_mixture(mixture)?;
        for i in 0..BATCH {
            let (wi, jacobian) = (buffers.wi(i), f64::from(buffers.scalar[i]));
            if i % every == 0 {
                let mut walk = Rng::new(&[KEY, key, 1, call as u64, i as u64]);
                with_reference.add(exact_weight(reference, truth.wo, wi, jacobian, &mut walk));
            }
            luminance.add(truth.f_cos(wi) * jacobian);
        }
    }
    Ok(Mixed {
        bias: relative(with_reference.estimate(), truth.albedo),
        relvar: luminance.relvar(),
        weight_max: luminance.max,
        unconverged: unconverged as f64 / (calls * BATCH) as f64,
    })
}
