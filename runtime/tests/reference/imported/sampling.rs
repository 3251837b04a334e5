//! Sampling: the pdf integrates to 1 and is that of `propose`, the mean weight is the albedo, weights are bounded.

use super::{At, Grid, bound, circle, direction, eval, lobe, spaced};
use crate::support::chi_square::{SIGNIFICANCE, chi_square, sidak};
use bake_runtime::imported::Imported;
use bake_runtime::{Bsdf, Rng};
use glam::DVec3;
use std::f64::consts::TAU;

/// Midpoint quadrature of a density with steps at the edges of cells.
const QUADRATURE_TOL: f64 = 1e-3;

/// Standard errors allowed between a mean and a quadrature.
const SIGMAS: f64 = 3.0;

/// A BSDF and a direction, with the words for messages.
struct Case {
    name: &'static str,
    bsdf: Imported,
    wo: DVec3,
}

/// Between and at tabulated directions, isotropic and not, coarse, oblong, with black parts and black slices.
fn cases() -> Vec<Case> {
    let fine = Grid {
        theta: spaced(85.0, 18),
        phi: vec![0.0],
        height: 32,
        width: 32,
        ..Grid::default()
    };
    let coarse = Grid {
        theta: vec![0.0, 35.0, 70.0],
        phi: circle(5),
        height: 5,
        width: 9,
        ..Grid::default()
    };
    let striped = |at: &At| {
        // Sharp edges, and nothing at all on one side of the disk.
        let lit = at.wi.x > 0.1 && (at.phi < 100.0 || at.wi.y > 0.0);
        [if lit { 1.0 + at.wi.y } else { 0.0 }, 0.0, 0.0]
    };
    let black_below = |at: &At| {
        if at.theta < 20.0 {
            [0.0; 3]
        } else {
            [0.1, 0.2, 4.0 * at.wi.z]
        }
    };
    let smooth = bound(&fine, &[], |at| lobe(0.15, at));
    let case = |name, bsdf, theta, phi| Case {
        name,
        bsdf,
        wo: direction(theta, phi),
    };
    vec![
        case("lobe, normal", smooth.clone(), 0.0, 0.0),
        case("lobe, between slices", smooth.clone(), 52.3, 211.0),
        case("lobe, beyond the table", smooth, 89.9, 77.0),
        case("stripes, four slices", bound(&coarse, &[], striped), 50.0, 300.0),
        case("blue over black", bound(&coarse, &[], black_below), 12.0, 36.0),
        case("black", bound(&coarse, &[], |_| [0.0; 3]), 20.0, 20.0),
    ]
}

/// Direction over the point of the disk with squared radius `r2` and azimuth `phi`, radians.
fn over_disk(r2: f64, phi: f64) -> DVec3 {
    let (y, x) = phi.sin_cos();
    DVec3::new(r2.sqrt() * x, r2.sqrt() * y, (1.0 - r2).sqrt())
}

/// Midpoint quadrature over `r2` in [r2.0, r2.1] and `phi` in [phi.0, phi.1] of `g` times the disk's area element,
/// which is dω·cos θ.
fn integrate<T: std::iter::Sum + std::ops::Mul<f64, Output = T>>(
    steps: [usize; 2],
    r2: (f64, f64),
    phi: (f64, f64),
    g: impl Fn(DVec3) -> T,
) -> T {
    let at = |(from, to): (f64, f64), k: usize, n: usize| from + (to - from) * (k as f64 + 0.5) / n as f64;
    let points = (0..steps[0]).flat_map(|i| (0..steps[1]).map(move |j| (i, j)));
    let sum: T = points
        .map(|(i, j)| g(over_disk(at(r2, i, steps[0]), at(phi, j, steps[1]))))
        .sum();
    sum * (0.5 * (r2.1 - r2.0) * (phi.1 - phi.0) / (steps[0] * steps[1]) as f64)
}

#[test]
fn the_pdf_integrates_to_one() {
    for Case { name, bsdf, wo } in cases() {
        let integral = integrate([500, 1000], (0.0, 1.0), (0.0, TAU), |wi| bsdf.pdf(wo, wi) / wi.z);
        assert!((integral - 1.0).abs() < QUADRATURE_TOL, "{name}: {integral}");
    }
}

#[test]
fn propose_draws_from_the_pdf() {
    const SAMPLES: usize = 1_000_000;
    /// Rings of equal area on the disk, and sectors.
    const BINS: [usize; 2] = [12, 24];
    /// Points per side of a bin. Steps of the density at cells err by a thousandth of a bin, where counts of some
    /// 3500 spread by 17 thousandths.
    const STEPS: [usize; 2] = [60, 60];
    let cases = cases();
    let tests = cases.len();
    for (k, Case { name, bsdf, wo }) in cases.into_iter().enumerate() {
        let mut rng = Rng::new(&[0xc41, k as u64]);
        let mut counts = vec![0u64; BINS[0] * BINS[1]];
        for _ in 0..SAMPLES {
            let wi = bsdf.propose(wo, rng.pair()).expect("wo is above the horizon");
            let ring = ((wi.x * wi.x + wi.y * wi.y) * BINS[0] as f64) as usize;
            let sector = (wi.y.atan2(wi.x).rem_euclid(TAU) / TAU * BINS[1] as f64) as usize;
            counts[ring.min(BINS[0] - 1) * BINS[1] + sector.min(BINS[1] - 1)] += 1;
        }
        let expected: Vec<f64> = (0..counts.len())
            .map(|bin| {
                let edges = |i: usize, n: usize, size: f64| {
                    (i as f64 * size / n as f64, (i + 1) as f64 * size / n as f64)
                };
                let ring = edges(bin / BINS[1], BINS[0], 1.0);
                let sector = edges(bin % BINS[1], BINS[1], TAU);
                SAMPLES as f64 * integrate(STEPS, ring, sector, |wi| bsdf.pdf(wo, wi) / wi.z)
            })
            .collect();
        let p = chi_square(&expected, &counts);
        assert!(p > sidak(SIGNIFICANCE, tests), "{name}: p {p:.2e}");
    }
}

#[test]
fn the_mean_weight_is_the_integral_of_eval() {
    const SAMPLES: u32 = 200_000;
    /// Relative error of the quadrature of a bilinear function with edges a pixel wide.
    const SLACK: f64 = 2e-4;
    /// Two ways of computing one quotient of a dozen roundings each; both divide by cosines of 1e-3 at least.
    const WEIGHT_TOL: f64 = 1e-12;
    for (k, Case { name, bsdf, wo }) in cases().into_iter().enumerate() {
        let albedo = integrate([800, 1600], (0.0, 1.0), (0.0, TAU), |wi| {
            eval(&bsdf, wo, wi) / wi.z
        });
        let mut rng = Rng::new(&[0xa1b, k as u64]);
        let (mut sum, mut square) = (DVec3::ZERO, DVec3::ZERO);
        for _ in 0..SAMPLES {
            let u = rng.pair();
            let Some(s) = bsdf.sample(wo, u, &mut rng) else {
                continue;
            };
            let ratio = eval(&bsdf, wo, s.wi) / bsdf.pdf(wo, s.wi);
            assert!(
                (ratio - s.weight).abs().max_element() <= WEIGHT_TOL * s.weight.max_element(),
                "{name}: weight {} is not {ratio}",
                s.weight
            );
            sum += s.weight;
            square += s.weight * s.weight;
        }
        let n = f64::from(SAMPLES);
        let mean = sum / n;
        let variance = (square / n - mean * mean).max(DVec3::ZERO) / n;
        for c in 0..3 {
            let tolerance = SIGMAS * variance[c].sqrt() + SLACK * albedo[c];
            assert!(
                (mean[c] - albedo[c]).abs() <= tolerance,
                "{name}, channel {c}: mean weight {}, integral {} ± {tolerance}",
                mean[c],
                albedo[c]
            );
        }
    }
}

/// The density follows the slice, so that weights hardly vary: what sampling a table is good for.
#[test]
fn weights_of_smooth_slices_are_nearly_constant() {
    const SAMPLES: u32 = 100_000;
    /// Relative variance and largest weight over the mean, of the mean channel; measured 0.002 and 1.3.
    const RELVAR_MAX: f64 = 0.01;
    const PEAK_MAX: f64 = 2.0;
    for Case { name, bsdf, wo } in cases().into_iter().take(3) {
        let mut rng = Rng::new(&[0x3e1]);
        let (mut sum, mut square, mut peak) = (0.0, 0.0, 0.0f64);
        for _ in 0..SAMPLES {
            let u = rng.pair();
            let weight = bsdf
                .sample(wo, u, &mut rng)
                .map_or(0.0, |s| s.weight.element_sum());
            sum += weight;
            square += weight * weight;
            peak = peak.max(weight);
        }
        let mean = sum / f64::from(SAMPLES);
        let relvar = square / f64::from(SAMPLES) / (mean * mean) - 1.0;
        assert!(relvar < RELVAR_MAX, "{name}: relative variance {relvar}");
        assert!(peak < PEAK_MAX * mean, "{name}: largest weight {}", peak / mean);
    }
}

/// Stratified points stay stratified: the map from `u` is monotone in `u[1]` across rows and in `u[0]` within.
#[test]
fn one_stratum_gives_one_patch() {
    /// Strata per side.
    const STRATA: usize = 16;
    /// Largest extent on the disk, of 2, of what one of 256 strata gives; a mixture that chooses a slice first
    /// tears patches apart, over the whole disk.
    const EXTENT_MAX: f64 = 0.8;
    for Case { name, bsdf, wo } in cases().into_iter().take(3) {
        for stratum in 0..STRATA * STRATA {
            let corner = [stratum % STRATA, stratum / STRATA];
            let points = [[0.01, 0.01], [0.99, 0.01], [0.01, 0.99], [0.99, 0.99], [0.5, 0.5]].map(|t| {
                let u = [0, 1].map(|c| (corner[c] as f64 + t[c]) / STRATA as f64);
                bsdf.propose(wo, u).expect("wo is above the horizon").truncate()
            });
            for p in points {
                let extent = (p - points[4]).length();
                assert!(extent < EXTENT_MAX, "{name}: {extent} in stratum {corner:?}");
            }
        }
    }
}

/// The worst resolution: as many pixels as cells, and one of them lit.
#[test]
fn the_weight_is_bounded_where_the_slice_is_a_single_pixel() {
    const SAMPLES: u32 = 100_000;
    /// Nine where a cell is lit at one corner alone; the tent has kinks inside cells, which are left a tenth.
    const WEIGHT_MAX: f64 = 10.0;
    /// Five standard errors of weights that vary as much as that.
    const MEAN_TOL: f64 = 0.02;
    let grid = Grid {
        theta: vec![0.0],
        phi: vec![0.0],
        height: 255,
        width: 255,
        ..Grid::default()
    };
    let f = 1e6;
    let bsdf = bound(&grid, &[], |at| [if at.wi.z > 0.999_999 { f } else { 0.0 }; 3]);
    let wo = DVec3::Z;
    let peak = eval(&bsdf, wo, DVec3::Z).x;
    assert!((peak / f - 1.0).abs() < f64::from(f32::EPSILON), "{peak}");
    // A pixel's bilinear tent holds the volume of the pixel.
    let albedo = f * (2.0 / 255.0) * (2.0 / 255.0);
    let (mut rng, mut sum) = (Rng::new(&[0xb0d]), 0.0);
    for _ in 0..SAMPLES {
        let u = rng.pair();
        let weight = bsdf.sample(wo, u, &mut rng).map_or(0.0, |s| s.weight.x);
        assert!(weight < WEIGHT_MAX * albedo, "{weight}, albedo {albedo}");
        sum += weight;
    }
    assert!((sum / f64::from(SAMPLES) / albedo - 1.0).abs() < MEAN_TOL);
}
