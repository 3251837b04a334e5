//! Directional albedos of the reference models, with their standard errors: by quadrature what is exact, by walks the rest.

use super::quadrature::{both, integral};
use bake_runtime::bsdf::shifted_r2;
use bake_runtime::chart::Chart;
use bake_runtime::conductor::Conductor;
use bake_runtime::moments::Moments;
use bake_runtime::{Bsdf, Estimate, Rng};
use glam::DVec3;

/// Walks behind the share of a conductor's higher orders that its reflectance keeps.
const CONDUCTOR_WALKS: u64 = 1 << 17;
/// Directions behind the first estimate of a body, and the most behind the last: at about 1.2 µs each, a second.
const BODY_DIRECTIONS: [u64; 2] = [1 << 15, 1 << 20];
/// Relative standard error at which there are enough.
const BODY_ERROR: f64 = 2e-4;
/// Keys of the walks, and of the shift of the directions.
const CONDUCTOR_KEY: u64 = 103;
const BODY_KEY: u64 = 104;

/// The part of a conductor's albedo that scatters more than once.
///
/// A white surface loses nothing, so of light that falls on it exactly 1 − (single scattering of the white surface) scatters
/// on; walks only tell which share of it the reflectance keeps.
pub fn scattered(bsdf: &Conductor, wo: DVec3, chart: &Chart) -> Estimate {
    let white = bsdf.white();
    let single = integral(chart, |wi| white.single(wo, wi));
    let on = (1.0 - single.mean.x).max(0.0);
    let mut kept = Moments::default();
    let mut count = 0;
    for i in 0..CONDUCTOR_WALKS {
        let mut orders = 1;
        let mut rng = Rng::new(&[CONDUCTOR_KEY, i]);
        let sample = bsdf.walk(wo, shifted_r2(i, [0.0; 2]), &mut rng, |_| orders += 1);
        if orders > 1 {
            kept.add(sample.map_or(DVec3::ZERO, |s| s.weight));
            count += 1;
        }
    }
    if count < 2 {
        // So little that it may as well all be kept, or none.
        return Estimate {
            mean: DVec3::ZERO,
            se: DVec3::splat(on),
        };
    }
    let kept = kept.estimate();
    both(
        Estimate {
            mean: kept.mean * on,
            se: kept.se * on,
        },
        Estimate {
            mean: DVec3::ZERO,
            se: kept.mean * single.se,
        },
    )
}

/// The albedo of the rest of a stochastic model ([`Bsdf::eval_lobes`]), which is about even over the square of `chart`:
/// one evaluation each at R2 points, as many as bring the error of the albedo down to [`BODY_ERROR`], `known` of which is
/// known already.
///
/// The standard error is that of random directions; those of low discrepancy can only have a smaller one.
pub fn rest(bsdf: &dyn Bsdf, wo: DVec3, chart: &Chart, known: DVec3) -> Estimate {
    let shift = Rng::new(&[BODY_KEY]).pair();
    let mut moments = Moments::default();
    let [mut count, most] = BODY_DIRECTIONS;
    let mut done = 0;
    loop {
        for i in done..count {
            let (wi, area) = chart.square_to_direction(shifted_r2(i, shift));
            let mut rng = Rng::new(&[BODY_KEY, i]);
            let [_, rest] = bsdf.eval_lobes(wo, DVec3::from_array(wi), &mut rng);
            moments.add(rest * area);
        }
        let found = moments.estimate();
        let allowed = (known + found.mean) * BODY_ERROR;
        if count >= most || found.se.cmple(allowed).all() {
            return found;
        }
        done = count;
        count *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::card::truth::Truth;
    use bake_runtime::Reference;
    use bake_runtime::bsdf::direction;
    use bake_runtime::layered::Layered;
    use bake_runtime::principled::{Principled, PrincipledParameters};

    /// Standard errors allowed: 21 comparisons exceed 4.5 by chance once in 7000 runs.
    const SIGMAS: f64 = 4.5;
    /// Samples of the slow truth: the mean weight of the reference's own sampling.
    const SAMPLES: u64 = 1 << 18;
    /// Error of an albedo of a channel, over the brightest, that every family keeps to.
    const ERROR_MAX: f64 = 1e-3;

    #[test]
    fn albedos_are_the_mean_weights_of_samples() {
        let metal = |alpha| Conductor::new(alpha, [1.0, 0.782, 0.344]).expect("valid parameters");
        let layered = |alpha, sigma_t| {
            let bsdf = Layered::new(alpha, 1.5, sigma_t, [0.9, 0.5, 0.1], [0.5; 3], 0.0);
            Reference::Layered(bsdf.expect("valid parameters"))
        };
        let plastic = |roughness, clearcoat| {
            let bsdf = Principled::new(PrincipledParameters {
                roughness,
                clearcoat,
                ..Default::default()
            });
            Reference::Principled(bsdf.expect("valid parameters"))
        };
        for (reference, theta) in [
            (Reference::Conductor(metal([0.3, 0.1])), 60.0),
            (Reference::Conductor(metal([0.9, 0.9])), 88.0),
            (layered(0.02, 1.0), 30.0),
            (layered(0.4, 3.0), 87.0),
            (plastic(0.1, 0.0), 50.0),
            (plastic(0.5, 1.0), 86.0),
        ] {
            let wo = direction(theta, 25.0);
            let found = Truth::new(&reference, wo).expect("bright").albedo;
            let slow = reference.albedo(wo, SAMPLES, 9);
            for c in 0..3 {
                let allowed = SIGMAS * found.se[c].hypot(slow.se[c]);
                let difference = (found.mean[c] - slow.mean[c]).abs();
                assert!(
                    difference < allowed,
                    "{reference:?} at {theta}: {found:?} {slow:?}"
                );
                let limit = ERROR_MAX * found.mean.max_element();
                assert!(found.se[c] < limit, "{reference:?} at {theta}: {found:?}");
            }
        }
    }
}
