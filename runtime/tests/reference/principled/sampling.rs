//! The sampler: it draws from its pdf, and its weights vary little.

use super::quadrature::alpha;
use super::{bound, direction, settings};
use crate::support::chi_square::SIGNIFICANCE;
use crate::support::chi_square::{chi_square, sidak};
use bake_runtime::principled::{Principled, PrincipledParameters};
use bake_runtime::{Bsdf, Rng};
use glam::DVec3;
use std::f64::consts::TAU;

/// Bins of directions by the normal that mirrors `wo` there: rings of its slope over the roughness of the narrowest
/// lobe, and sectors.
///
/// With s the length of that ratio, rings are equal steps of ln(1 + s²): even in s² within the lobe, and in
/// ratios of s beyond it, so that no lobe is too narrow or too wide for them.
struct Bins {
    wo: DVec3,
    alpha: [f64; 2],
    /// ln(1 + s²) of the outermost slope.
    end: f64,
}

impl Bins {
    const RINGS: usize = 32;
    const SECTORS: usize = 16;
    /// Points per side of a bin. Where the horizon cuts a bin, they err by some 40^-1.5 of it, or half a percent;
    /// its count of a few thousand spreads by two percent.
    const STEPS: usize = 40;

    fn new(bsdf: &Principled, wo: DVec3) -> Bins {
        let p = bsdf.parameters();
        let coat = if p.clearcoat > 0.0 {
            0.1 - 0.099 * p.clearcoat_gloss
        } else {
            1.0
        };
        let alpha = alpha(bsdf).map(|a| a.min(coat));
        // A normal halfway between two directions above the horizon is no steeper than this.
        let slope = (1.0 + (1.0 - wo.z * wo.z).sqrt()) / wo.z;
        let s = slope / alpha[0].min(alpha[1]);
        Bins {
            wo,
            alpha,
            end: (s * s).ln_1p(),
        }
    }

    fn index(&self, wi: DVec3) -> usize {
        let m = self.wo + wi;
        let (x, y) = (m.x / (self.alpha[0] * m.z), m.y / (self.alpha[1] * m.z));
        let ring = (x * x + y * y).ln_1p() / self.end * Bins::RINGS as f64;
        let sector = y.atan2(x).rem_euclid(TAU) / TAU * Bins::SECTORS as f64;
        (ring as usize).min(Bins::RINGS - 1) * Bins::SECTORS + (sector as usize).min(Bins::SECTORS - 1)
    }

    /// The integral of `pdf` over each bin, by midpoints.
    fn masses(&self, pdf: impl Fn(DVec3) -> f64) -> Vec<f64> {
        let n = Bins::STEPS;
        let (ring_step, sector_step) = (
            self.end / (Bins::RINGS * n) as f64,
            TAU / (Bins::SECTORS * n) as f64,
        );
        let mut masses = vec![0.0; Bins::RINGS * Bins::SECTORS];
        for i in 0..Bins::RINGS * n {
            let v = (i as f64 + 0.5) * ring_step;
            let s = v.exp_m1().sqrt();
            for j in 0..Bins::SECTORS * n {
                let (y, x) = ((j as f64 + 0.5) * sector_step).sin_cos();
                let m = DVec3::new(self.alpha[0] * s * x, self.alpha[1] * s * y, 1.0).normalize();
                let cos = self.wo.dot(m);
                let wi = 2.0 * cos * m - self.wo;
                if cos > 0.0 && wi.z > 0.0 {
                    // s ds = ½ eᵛ dv, dm = cos³ of its slope's area, and dω_i = 4 (wo·m) dm.
                    let area = 0.5 * v.exp() * self.alpha[0] * self.alpha[1] * ring_step * sector_step;
                    masses[i / n * Bins::SECTORS + j / n] += pdf(wi) * 4.0 * cos * m.z.powi(3) * area;
                }
            }
        }
        masses
    }
}

#[test]
fn propose_draws_from_the_pdf() {
    const SAMPLES: usize = 1_000_000;
    let thetas = [0.0, 50.0, 82.0];
    let settings = settings();
    let least = sidak(SIGNIFICANCE, settings.len() * thetas.len());
    for (k, (name, bsdf)) in settings.iter().enumerate() {
        for (j, theta) in thetas.into_iter().enumerate() {
            let wo = direction(theta, 215.0);
            let bins = Bins::new(bsdf, wo);
            let mut rng = Rng::new(&[0xc41, k as u64, j as u64]);
            let mut counts = vec![0u64; Bins::RINGS * Bins::SECTORS];
            for _ in 0..SAMPLES {
                counts[bins.index(bsdf.propose(wo, rng.pair()).expect("above"))] += 1;
            }
            let masses = bins.masses(|wi| bsdf.pdf(wo, wi));
            let expected: Vec<f64> = masses.iter().map(|m| m * SAMPLES as f64).collect();
            let p = chi_square(&expected, &counts);
            assert!(p > least, "{name} at {theta}°: p {p:.1e}");
        }
    }
}

/// What the estimates of energy and the uniform lobe are for: weights stay near their mean all over the domain.
#[test]
fn weights_vary_little() {
    const SURFACES: u64 = 400;
    const SAMPLES: u32 = 2000;
    /// Mean over surfaces of the weights' relative variance, by the angle of `wo`; a tenth above those measured. The
    /// best probabilities of these four lobes would leave some three quarters of it.
    const RELVAR_MAX: [(f64, f64); 4] = [(0.0, 0.042), (45.0, 0.045), (75.0, 0.071), (89.0, 0.154)];
    /// Largest weight over the mean weight; measured 10.4, of a faint sheen alone.
    const PEAK_MAX: f64 = 15.0;
    let luminance = DVec3::new(0.2126, 0.7152, 0.0722);
    for (theta, allowed) in RELVAR_MAX {
        let mut rng = Rng::new(&[0x3e1, theta as u64]);
        let mut relvar = 0.0;
        for _ in 0..SURFACES {
            // One value in eight at 0, one in eight at 1.
            let mut value = || {
                let v = 4.0 / 3.0 * rng.uniform() - 1.0 / 6.0;
                v.clamp(0.0, 1.0)
            };
            let parameters = PrincipledParameters {
                base_color: DVec3::new(value(), value(), value()),
                metallic: value(),
                roughness: value(),
                specular: value(),
                specular_tint: value(),
                anisotropic: value(),
                sheen: value(),
                sheen_tint: value(),
                clearcoat: value(),
                clearcoat_gloss: value(),
                flatness: value(),
            };
            let bsdf = bound(parameters);
            let wo = direction(theta, 360.0 * rng.uniform());
            let (mut sum, mut square, mut peak) = (0.0, 0.0, 0.0f64);
            for _ in 0..SAMPLES {
                let u = rng.pair();
                let sample = bsdf.sample(wo, u, &mut rng).expect("above");
                let weight = luminance.dot(sample.weight);
                sum += weight;
                square += weight * weight;
                peak = peak.max(weight);
            }
            // Without any light there is no variance.
            if sum > 0.0 {
                let mean = sum / f64::from(SAMPLES);
                relvar += (square / f64::from(SAMPLES) / (mean * mean) - 1.0) / SURFACES as f64;
                assert!(
                    peak < PEAK_MAX * mean,
                    "weight {} times the mean: {parameters:?}",
                    peak / mean
                );
            }
        }
        assert!(relvar < allowed, "relative variance {relvar} at {theta}°");
    }
}
