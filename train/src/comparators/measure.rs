//! What a sampler of one slice is compared by, with the definitions of the model card.

use super::{Drawn, SliceSampler};
use crate::card::batch::BATCH;
use crate::card::bins::{SIDE, l1};
use crate::card::judgement::relative;
use crate::card::measure::BINNING_POINTS;
use crate::card::truth::Truth;
use crate::error::Result;
use crate::lobes::LUMINANCE;
use bake_runtime::bsdf::shifted_r2;
use bake_runtime::estimator::exact_weight;
use bake_runtime::moments::Moments;
use bake_runtime::{Estimate, Reference, Rng};
use glam::DVec3;

/// Random points behind bias and variance.
const EXACT_POINTS: u64 = 1 << 18;
/// Key of the random points.
const KEY: u64 = 0xc0de;

/// The errors of a sampler on one slice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Σ over bins of |share of samples − true mass|; what is lost below the horizon is one more bin, without mass.
    pub binning_l1: f64,
    /// What a perfect sampler would score.
    pub binning_floor: f64,
    /// Share of u that gives no direction.
    pub lost: f64,
    /// Variance over squared mean of the luminance weight, on f_cos without noise: of the sampler alone.
    pub weight_relvar: f64,
    /// Largest luminance weight found, on f_cos without noise.
    pub weight_max: f64,
    /// Mean weight with f_cos of the reference itself over the true albedo − 1, RGB, with the standard error of both.
    pub albedo_bias: Estimate,
}

/// Measures `sampler` on the slice of `reference` that `truth` was measured of; `seed` tells slices apart.
///
/// # Errors
/// What `sampler` returns.
pub fn measure(
    sampler: &mut dyn SliceSampler,
    reference: &Reference,
    truth: &Truth,
    seed: u64,
) -> Result<Errors> {
    let Histogram { counts, lost } = histogram(sampler, truth, BINNING_POINTS)?;
    let weights = weights(sampler, reference, truth, seed)?;
    let mass: Vec<f64> = truth.binned.mass.iter().copied().chain([0.0]).collect();
    Ok(Errors {
        binning_l1: l1(&[&counts[..], &[lost]].concat(), &mass),
        binning_floor: truth.binned.floor(BINNING_POINTS),
        lost: lost as f64 / BINNING_POINTS as f64,
        weight_relvar: weights.relvar(),
        weight_max: weights.max,
        albedo_bias: relative(weights.exact.estimate(), truth.albedo),
    })
}

/// Samples in bins.
pub(super) struct Histogram {
    /// In every bin of the truth.
    pub counts: Vec<u64>,
    /// Without a direction.
    pub lost: u64,
}

/// Counts `points` R2 points, a multiple of [`BATCH`], in the bins of `truth`.
pub(super) fn histogram(sampler: &mut dyn SliceSampler, truth: &Truth, points: u64) -> Result<Histogram> {
    let mut histogram = Histogram {
        counts: vec![0; SIDE * SIDE],
        lost: 0,
    };
    let mut drawn = vec![None; BATCH];
    for first in (0..points).step_by(BATCH) {
        let u: Vec<[f64; 2]> = (first..first + BATCH as u64)
            .map(|i| shifted_r2(i, [0.0; 2]))
            .collect();
        sampler.draw(&u, &mut drawn)?;
        for drawn in &drawn {
            match drawn {
                Some(Drawn { wi, .. }) => histogram.counts[truth.binned.bins.index(*wi)] += 1,
                None => histogram.lost += 1,
            }
        }
    }
    Ok(histogram)
}

/// Weights of random points.
#[derive(Default)]
struct Weights {
    /// With f_cos of the reference, RGB.
    exact: Moments,
    /// Sums of luminance weights without noise and of their squares.
    sum: f64,
    squares: f64,
    max: f64,
}

impl Weights {
    fn add(&mut self, exact: DVec3, without_noise: f64) {
        self.exact.add(exact);
        self.sum += without_noise;
        self.squares += without_noise * without_noise;
        self.max = self.max.max(without_noise);
    }

    /// Variance over squared mean.
    fn relvar(&self) -> f64 {
        let mean = self.sum / EXACT_POINTS as f64;
        self.squares / EXACT_POINTS as f64 / (mean * mean).max(f64::MIN_POSITIVE) - 1.0
    }
}

fn weights(
    sampler: &mut dyn SliceSampler,
    reference: &Reference,
    truth: &Truth,
    seed: u64,
) -> Result<Weights> {
    let mut weights = Weights::default();
    let mut rng = Rng::new(&[KEY, seed]);
    let mut walks = Rng::new(&[KEY, seed, 1]);
    let mut drawn = vec![None; BATCH];
    for _ in (0..EXACT_POINTS).step_by(BATCH) {
        let u: Vec<[f64; 2]> = (0..BATCH).map(|_| rng.pair()).collect();
        sampler.draw(&u, &mut drawn)?;
        for drawn in &drawn {
            match *drawn {
                Some(Drawn { wi, jacobian }) => weights.add(
                    exact_weight(reference, truth.wo, wi, jacobian, &mut walks),
                    truth.f_cos(wi).dot(LUMINANCE) * jacobian,
                ),
                None => weights.add(DVec3::ZERO, 0.0),
            }
        }
    }
    Ok(weights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::card::bins::Bins;
    use crate::comparators::KnownDensity;
    use crate::comparators::blinn_phong::BlinnPhong;
    use crate::lobes::direction_at;
    use crate::spline::{edge_cell_centre, edge_cell_weight};
    use bake_runtime::bsdf::direction;
    use bake_runtime::conductor::Conductor;

    /// Standard errors allowed: three comparisons exceed it by chance once in 50 000 runs.
    const SIGMAS: f64 = 4.5;
    /// Relative noise of a variance over 2¹⁸ weights of at most a few times their mean, and of the quadrature.
    const RELVAR_TOL: f64 = 0.02;
    /// Nodes per side of the quadrature: each costs the walks of the slice.
    const NODES: usize = 64;
    /// Binning L1 between the sampler's density and the slice by midpoints, and by samples.
    const BINNING_TOL: f64 = 5e-3;

    fn metal() -> Reference {
        let conductor = Conductor::new([0.6, 0.5], [0.9, 0.5, 0.2]);
        Reference::Conductor(conductor.expect("valid parameters"))
    }

    #[test]
    fn errors_of_a_cosine_lobe_are_those_of_quadrature() {
        let bsdf = metal();
        let wo = direction(30.0, 20.0);
        let truth = Truth::new(&bsdf, wo).expect("a bright slice");
        let mut cosine = BlinnPhong {
            wo,
            exponent: 1.0,
            share: 0.0,
        };
        let found = measure(&mut cosine, &bsdf, &truth, 0).expect("it knows its density");
        assert_eq!(found.lost, 0.0);
        for c in 0..3 {
            let sigma = found.albedo_bias.mean[c] / found.albedo_bias.se[c];
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
        impl KnownDensity for Half {
            fn sample(&self, [u, v]: [f64; 2]) -> Option<(DVec3, f64)> {
                let (wi, pdf) = self.0.sample([2.0 * u % 1.0, v])?;
                (u < 0.5).then_some((wi, 0.5 * pdf))
            }
            fn pdf(&self, wi: DVec3) -> f64 {
                0.5 * self.0.pdf(wi)
            }
        }
        let bsdf = metal();
        let wo = direction(30.0, 20.0);
        let truth = Truth::new(&bsdf, wo).expect("a bright slice");
        let mut half = Half(BlinnPhong {
            wo,
            exponent: 1.0,
            share: 0.0,
        });
        let found = measure(&mut half, &bsdf, &truth, 0).expect("it knows its density");
        assert!((found.lost - 0.5).abs() < BINNING_TOL, "{found:?}");
        assert!(found.binning_l1 > 0.5 + found.lost - BINNING_TOL, "{found:?}");
        let sigma = found.albedo_bias.mean / found.albedo_bias.se;
        assert!(sigma.abs().max_element() < SIGMAS, "{found:?}");
    }
}
