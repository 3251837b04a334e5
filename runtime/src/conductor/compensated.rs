//! A baseline beside the full model: single scattering, scaled up to the energy that multiple scattering would add.
//!
//! Source: Turquin 2019, *Practical Multiple Scattering Compensation for Microfacet Models*:
//! f = f₁·(1 + F0·(1 − E)/E) with E the albedo of white single scattering at `wo`. Deviation: E is tabulated for the
//! surface's own roughness, anisotropic or not, when the parameters are bound.
//! It has the energy of multiple scattering but neither its directions nor, for colours, its saturation; and it is not
//! reciprocal.

use super::Conductor;
use crate::bsdf::{Bsdf, BsdfSample, DirectSlice, Slice, shifted_r2, usable};
use crate::random::Rng;
use crate::real::consts::FRAC_PI_2;
use crate::real::{Real, Vec3};

/// Nodes over the square root of cos θ_o, crowded towards the horizon, where E changes fastest.
const COS_NODES: usize = 32;
/// Nodes over a quarter turn of azimuth, for an anisotropic surface.
const PHI_NODES: usize = 7;
/// Points of the R2 sequence behind each node: the table's error is a few tenths of a percent.
const POINTS: u64 = 512;
/// cos θ_o of the first node: the horizon itself has no direction above it.
const COS_MIN: Real = 1e-4;

/// Single scattering with compensated energy; deterministic.
#[derive(Clone, Debug, PartialEq)]
pub struct CompensatedConductor {
    conductor: Conductor,
    /// E, row by row of constant azimuth.
    albedo: Vec<Real>,
    rows: usize,
}

impl CompensatedConductor {
    /// Tabulates E for `conductor`.
    pub fn new(conductor: Conductor) -> CompensatedConductor {
        let white = conductor.white();
        let rows = if conductor.alpha[0] == conductor.alpha[1] {
            1
        } else {
            PHI_NODES
        };
        let mut albedo = Vec::with_capacity(rows * COS_NODES);
        for row in 0..rows {
            let (y, x) = (FRAC_PI_2 * row as Real / (PHI_NODES - 1) as Real).sin_cos();
            for node in 0..COS_NODES {
                let root = node as Real / (COS_NODES - 1) as Real;
                let cos = (root * root).max(COS_MIN);
                let sin = ((1.0 - cos) * (1.0 + cos)).sqrt();
                albedo.push(single_albedo(&white, Vec3::new(sin * x, sin * y, cos)));
            }
        }
        CompensatedConductor {
            conductor,
            albedo,
            rows,
        }
    }

    /// E at `wo`, in `(0, 1]`: bilinear in √cos θ_o and azimuth.
    fn albedo_of_white(&self, wo: Vec3) -> Real {
        let x = wo.z.clamp(0.0, 1.0).sqrt() * (COS_NODES - 1) as Real;
        let i = (x as usize).min(COS_NODES - 2);
        let along = |row: usize| {
            let row = &self.albedo[row * COS_NODES..];
            row[i] + (row[i + 1] - row[i]) * (x - i as Real)
        };
        if self.rows == 1 {
            return along(0);
        }
        let y = wo.y.abs().atan2(wo.x.abs()) / FRAC_PI_2 * (self.rows - 1) as Real;
        let j = (y as usize).min(self.rows - 2);
        along(j) + (along(j + 1) - along(j)) * (y - j as Real)
    }

    fn scale(&self, wo: Vec3) -> Vec3 {
        let albedo = self.albedo_of_white(wo);
        Vec3::ONE + self.conductor.fresnel.normal() * ((1.0 - albedo) / albedo)
    }
}

/// Albedo of the single scattering of `white` at `wo`.
fn single_albedo(white: &Conductor, wo: Vec3) -> Real {
    let mut sum = 0.0;
    for i in 0..POINTS {
        if let Some(wi) = white.propose(wo, shifted_r2(i, [0.0; 2])) {
            let pdf = white.pdf(wo, wi);
            if pdf > 0.0 {
                sum += white.single(wo, wi).x / pdf;
            }
        }
    }
    sum / POINTS as Real
}

impl Bsdf for CompensatedConductor {
    fn eval(&self, wo: Vec3, wi: Vec3, _: &mut Rng) -> Vec3 {
        if !usable(wo) {
            return Vec3::ZERO;
        }
        self.conductor.single(wo, wi) * self.scale(wo)
    }

    /// Visible normals.
    fn sample(&self, wo: Vec3, u: [Real; 2], rng: &mut Rng) -> Option<BsdfSample> {
        let wi = self.propose(wo, u)?;
        let pdf = self.pdf(wo, wi);
        (pdf > 0.0).then(|| BsdfSample {
            wi,
            weight: self.eval(wo, wi, rng) / pdf,
        })
    }

    fn pdf(&self, wo: Vec3, wi: Vec3) -> Real {
        self.conductor.pdf(wo, wi)
    }

    fn propose(&self, wo: Vec3, u: [Real; 2]) -> Option<Vec3> {
        self.conductor.propose(wo, u)
    }

    fn is_stochastic(&self) -> bool {
        false
    }

    fn slice(&self, wo: Vec3, _: usize, _: u64) -> Box<dyn Slice + '_> {
        Box::new(DirectSlice { bsdf: self, wo })
    }
}
