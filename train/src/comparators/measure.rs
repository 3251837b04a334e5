//! What a sampler of one slice is compared by, with the definitions of the model card.

use super::SliceSampler;
use crate::card::binned::BinnedSlice;
use crate::card::bins::l1;
use crate::card::measure::BINNING_POINTS;
use crate::card::truth::Truth;
use crate::lobes::LUMINANCE;
use crate::transport::measure::count;
use bake_runtime::conductor::Conductor;
use bake_runtime::moments::Moments;
use bake_runtime::{Bsdf, Estimate, Rng};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Random points behind bias and variance, and those of them that one task draws.
const EXACT_POINTS: u64 = 1 << 18;
const BLOCK: u64 = 1 << 14;
/// Key of the random points.
const KEY: u64 = 0xc0de;

/// The slice that samplers are held against.
#[derive(Clone, Copy)]
pub struct Target<'a> {
    /// The reference model.
    pub bsdf: &'a dyn Bsdf,
    /// Camera direction.
    pub wo: DVec3,
    /// The slice in bins.
    pub binned: &'a BinnedSlice<'a>,
    /// Directional albedo, RGB.
    pub albedo: Estimate,
}

impl<'a> Target<'a> {
    /// The slice of a conductor that `truth` was measured of.
    pub fn of_conductor(bsdf: &'a Conductor, truth: &'a Truth<'a>) -> Target<'a> {
        Target {
            bsdf,
            wo: truth.wo,
            binned: &truth.binned,
            albedo: Estimate {
                mean: truth.albedo,
                se: truth.albedo_se,
            },
        }
    }
}

/// The errors of a sampler on one slice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Σ over bins of |share of samples − true mass|; what is lost below the horizon is one more bin, without mass.
    pub binning_l1: f64,
    /// What a perfect sampler would score.
    pub binning_floor: f64,
    /// Share of u that gives no direction.
    pub lost: f64,
    /// Variance over squared mean of the luminance of f_cos / pdf; the noise of a stochastic reference is no part of it.
    pub weight_relvar: f64,
    /// Largest luminance weight found; the noise of a stochastic reference is part of it.
    pub weight_max: f64,
    /// Mean weight over albedo − 1, RGB.
    pub albedo_bias: DVec3,
    /// Its standard error, with that of the albedo.
    pub albedo_bias_se: DVec3,
}

/// Measures `sampler`; `seed` tells slices apart.
pub fn measure(sampler: &dyn SliceSampler, target: &Target, seed: u64) -> Errors {
    let (binning_l1, lost) = binning(sampler, target.binned);
    let weights = weights(sampler, target, seed);
    let Estimate { mean, se } = weights.moments.estimate();
    let albedo = target.albedo;
    let square = weights.square / EXACT_POINTS as f64;
    let both = [0, 1, 2].map(|c: usize| se[c].hypot(albedo.se[c]));
    Errors {
        binning_l1,
        binning_floor: target.binned.floor(BINNING_POINTS),
        lost,
        weight_relvar: square / mean.dot(LUMINANCE).powi(2) - 1.0,
        weight_max: weights.max,
        albedo_bias: mean / albedo.mean - DVec3::ONE,
        albedo_bias_se: DVec3::from_array(both) / albedo.mean,
    }
}

/// Binning L1 over R2 points, and the share of them that is lost.
fn binning(sampler: &dyn SliceSampler, slice: &BinnedSlice) -> (f64, f64) {
    let lost = AtomicU64::new(0);
    let mut counts = count(BINNING_POINTS, |u| match sampler.sample(u) {
        Some((wi, _)) => slice.bins.index(wi),
        None => {
            lost.fetch_add(1, Ordering::Relaxed);
            0
        }
    });
    let lost = lost.into_inner();
    counts[0] -= lost;
    counts.push(lost);
    let mass: Vec<f64> = slice.mass.iter().copied().chain([0.0]).collect();
    (l1(&counts, &mass), lost as f64 / BINNING_POINTS as f64)
}

/// Weights of random points.
#[derive(Default)]
struct Weights {
    moments: Moments,
    /// Sum of squared luminance weights, without the reference's noise.
    square: f64,
    max: f64,
}

fn weights(sampler: &dyn SliceSampler, target: &Target, seed: u64) -> Weights {
    let block = |block: u64| {
        let mut weights = Weights::default();
        let mut rng = Rng::new(&[KEY, seed, block]);
        for _ in 0..BLOCK {
            let Some((wi, pdf)) = sampler.sample(rng.pair()) else {
                weights.moments.add(DVec3::ZERO);
                continue;
            };
            // The product of two independent estimates has the square of the truth as its mean.
            let mut eval = || target.bsdf.eval(target.wo, wi, &mut rng) / pdf;
            let first = eval();
            let second = if target.bsdf.is_stochastic() {
                eval()
            } else {
                first
            };
            let mean = 0.5 * (first + second);
            weights.moments.add(mean);
            weights.square += first.dot(LUMINANCE) * second.dot(LUMINANCE);
            weights.max = weights.max.max(mean.dot(LUMINANCE));
        }
        weights
    };
    let blocks: Vec<Weights> = (0..EXACT_POINTS / BLOCK).into_par_iter().map(block).collect();
    blocks
        .into_iter()
        .reduce(|a, b| Weights {
            moments: a.moments.merged(b.moments),
            square: a.square + b.square,
            max: a.max.max(b.max),
        })
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::card::bins::Bins;
    use crate::comparators::blinn_phong::BlinnPhong;
    use crate::lobes::direction_at;
    use crate::spline::{edge_cell_centre, edge_cell_weight};
    use bake_runtime::bsdf::direction;

    /// Standard errors allowed: three comparisons exceed it by chance once in 50 000 runs.
    const SIGMAS: f64 = 4.5;
    /// Relative noise of a variance over 2¹⁸ weights of at most a few times their mean, and of the quadrature.
    const RELVAR_TOL: f64 = 0.02;
    /// Nodes per side of the quadrature: each costs the walks of the slice.
    const NODES: usize = 64;
    /// Binning L1 between the sampler's density and the slice by midpoints, and by samples.
    const BINNING_TOL: f64 = 5e-3;

    #[test]
    fn errors_of_a_cosine_lobe_are_those_of_quadrature() {
        let bsdf = Conductor::new([0.6, 0.5], [0.9, 0.5, 0.2]).expect("valid parameters");
        let wo = direction(30.0, 20.0);
        let truth = Truth::new(&bsdf, wo).expect("a bright slice");
        let cosine = BlinnPhong {
            wo,
            exponent: 1.0,
            share: 0.0,
        };
        let found = measure(&cosine, &Target::of_conductor(&bsdf, &truth), 0);
        assert_eq!(found.lost, 0.0);
        for c in 0..3 {
            let sigma = found.albedo_bias[c] / found.albedo_bias_se[c];
            assert!(sigma.abs() < SIGMAS, "{found:?}");
        }
        let (mut square, mut mean) = (0.0, 0.0);
        for k in 0..NODES * NODES {
            let (wi, area) = direction_at(&truth.chart, edge_cell_centre(k, NODES));
            let f = truth.binned.f_cos(wi).dot(LUMINANCE);
            let solid_angle = area * edge_cell_weight(k, NODES) / (NODES * NODES) as f64;
            mean += f * solid_angle;
            square += f * f / cosine.pdf(wi) * solid_angle;
        }
        let expected = square / (mean * mean) - 1.0;
        assert!(
            (found.weight_relvar / expected - 1.0).abs() < RELVAR_TOL,
            "{expected} {found:?}"
        );
        let own = Bins::Disk.integrate(12, |wi| cosine.pdf(wi));
        let total = truth.binned.mass.iter().sum::<f64>();
        let expected: f64 = own
            .iter()
            .zip(&truth.binned.mass)
            .map(|(a, b)| (a - b / total).abs())
            .sum();
        assert!(
            (found.binning_l1 - expected).abs() < BINNING_TOL,
            "{expected} {found:?}"
        );
    }

    /// A sampler that loses a part of its samples is as far from the truth as if it put them where no light is.
    #[test]
    fn lost_samples_count() {
        struct Half(BlinnPhong);
        impl SliceSampler for Half {
            fn sample(&self, [u, v]: [f64; 2]) -> Option<(DVec3, f64)> {
                let (wi, pdf) = self.0.sample([2.0 * u % 1.0, v])?;
                (u < 0.5).then_some((wi, 0.5 * pdf))
            }
            fn pdf(&self, wi: DVec3) -> f64 {
                0.5 * self.0.pdf(wi)
            }
        }
        let bsdf = Conductor::new([0.6, 0.5], [0.9, 0.5, 0.2]).expect("valid parameters");
        let wo = direction(30.0, 20.0);
        let truth = Truth::new(&bsdf, wo).expect("a bright slice");
        let half = Half(BlinnPhong {
            wo,
            exponent: 1.0,
            share: 0.0,
        });
        let found = measure(&half, &Target::of_conductor(&bsdf, &truth), 0);
        assert!((found.lost - 0.5).abs() < BINNING_TOL, "{found:?}");
        assert!(found.binning_l1 > 0.5 + found.lost - BINNING_TOL, "{found:?}");
        let sigma = found.albedo_bias / found.albedo_bias_se;
        assert!(sigma.abs().max_element() < SIGMAS, "{found:?}");
    }
}
