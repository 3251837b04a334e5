//! What the model and its sampler must integrate to, and the largest albedo of the domain.

use super::quadrature::integrate;
use super::{bound, direction, eval, settings};
use crate::support::chi_square::SIGNIFICANCE;
use crate::support::chi_square::{normal_tail, sidak};
use bake_runtime::principled::PrincipledParameters;
use bake_runtime::{Bsdf, Rng};
use glam::DVec3;

/// Error of the quadrature, relative; 8e-5 was the largest seen, at 89.9° from a narrow lobe.
const QUADRATURE_TOL: f64 = 3e-4;

#[test]
fn the_pdf_integrates_to_one() {
    for (name, bsdf) in settings() {
        for theta in [0.0, 45.0, 80.0, 89.0, 89.9] {
            let wo = direction(theta, 25.0);
            let [integral] = integrate(&bsdf, wo, |wi| [bsdf.pdf(wo, wi)]);
            assert!(
                (integral - 1.0).abs() < QUADRATURE_TOL,
                "{name} at {theta}°: {integral}"
            );
        }
    }
}

#[test]
fn the_mean_weight_is_the_integral_of_eval() {
    const SAMPLES: usize = 100_000;
    let thetas = [5.0, 60.0, 85.0];
    let settings = settings();
    let least = sidak(SIGNIFICANCE, 3 * thetas.len() * settings.len());
    for (k, (name, bsdf)) in settings.iter().enumerate() {
        for (j, theta) in thetas.into_iter().enumerate() {
            let wo = direction(theta, 130.0);
            let integral = integrate(bsdf, wo, |wi| eval(bsdf, wo, wi).to_array());
            let mut rng = Rng::new(&[0x3ea, k as u64, j as u64]);
            let (mut sum, mut square) = (DVec3::ZERO, DVec3::ZERO);
            for _ in 0..SAMPLES {
                let u = rng.pair();
                let weight = bsdf.sample(wo, u, &mut rng).expect("above").weight;
                sum += weight;
                square += weight * weight;
            }
            let n = SAMPLES as f64;
            let mean = sum / n;
            let se = ((square / n - mean * mean).max(DVec3::ZERO) / n).map(f64::sqrt);
            for c in 0..3 {
                let beyond = (mean[c] - integral[c]).abs() - QUADRATURE_TOL * integral[c];
                // No light at all is no light on either side.
                let p = if beyond <= 0.0 {
                    1.0
                } else {
                    2.0 * normal_tail(beyond / se[c])
                };
                assert!(
                    p > least,
                    "{name} at {theta}°, channel {c}: mean weight {} ± {}, integral {}, p {p:.1e}",
                    mean[c],
                    se[c],
                    integral[c]
                );
            }
        }
    }
}

/// A point of the domain: the parameters in the order of [`PrincipledParameters`], θ_o over 89.99°, and φ_o over 90°.
type Point = [f64; 15];

/// The largest albedo of any channel that long searches found, and where: a saturated blue, whose tints are brightened
/// to the luminance of white, seen along the surface.
const BRIGHTEST: (f64, Point) = (
    3.475,
    [
        0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.329, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0,
    ],
);
/// The same for surfaces whose base colour is white: a coated subsurface with sheen, at 86.5°.
const BRIGHTEST_WHITE: (f64, Point) = (
    1.846,
    [
        1.0, 1.0, 1.0, 0.0, 0.16, 1.0, 1.0, 1.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.9616, 1.0,
    ],
);

/// Albedo of the brightest channel.
fn albedo(x: &Point, samples: u64) -> f64 {
    let parameters = PrincipledParameters {
        base_color: DVec3::new(x[0], x[1], x[2]),
        metallic: x[3],
        roughness: x[4],
        specular: x[5],
        specular_tint: x[6],
        anisotropic: x[7],
        sheen: x[8],
        sheen_tint: x[9],
        clearcoat: x[10],
        clearcoat_gloss: x[11],
        flatness: x[12],
    };
    let wo = direction(89.99 * x[13], 90.0 * x[14]);
    bound(parameters).albedo(wo, samples, 0).mean.max_element()
}

/// The best of many points: at corners and between them, then steps from the best, less and less far. Only the
/// coordinates from `first_free` on are searched; the others are 1.
fn search(first_free: usize) -> Point {
    const DRAWN: usize = 1500;
    const STEPS: usize = 1500;
    /// Noise must not decide: these many leave 2 % of it.
    const SAMPLES: u64 = 2048;
    let mut rng = Rng::new(&[0xa1b, first_free as u64]);
    let mut best = (0.0, [1.0; 15]);
    for step in 0..DRAWN + STEPS {
        let mut x = if step < DRAWN { [1.0; 15] } else { best.1 };
        for v in &mut x[first_free..] {
            let (kind, value) = (rng.uniform(), rng.uniform());
            if step < DRAWN {
                *v = if kind < 0.4 { value.round() } else { value };
            } else if kind < 0.2 {
                let reach = (DRAWN + STEPS - step) as f64 / STEPS as f64;
                *v = (*v + reach * (value - 0.5)).clamp(0.0, 1.0);
            }
        }
        let found = albedo(&x, SAMPLES);
        if found > best.0 {
            best = (found, x);
        }
    }
    best.1
}

#[test]
fn albedo_exceeds_one_by_as_much_as_recorded() {
    const SAMPLES: u64 = 1 << 17;
    /// The recorded numbers have four digits, and their points are rounded.
    const RECORD_TOL: f64 = 2e-3;
    /// What a short search may find beyond the longer ones.
    const SEARCH_TOL: f64 = 0.01;
    for (first_free, (recorded, point)) in [(0, BRIGHTEST), (3, BRIGHTEST_WHITE)] {
        let there = albedo(&point, SAMPLES);
        assert!(
            (there / recorded - 1.0).abs() < RECORD_TOL,
            "{there}, recorded {recorded}"
        );
        let point = search(first_free);
        let found = albedo(&point, SAMPLES);
        eprintln!("largest albedo found: {found:.4} at {point:.3?}; recorded: {recorded}");
        assert!(
            found < recorded * (1.0 + SEARCH_TOL),
            "{found} at {point:?}, recorded {recorded}"
        );
    }
}
