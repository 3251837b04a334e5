//! The sampler: one of four lobes, chosen by the light that each is expected to carry.
//!
//! Deviation: Mitsuba chooses between three lobes at fixed rates, and loses what a facet mirrors below the horizon.
//! Here the probabilities follow from [`super::energy`], nothing is lost, and a uniform lobe joins the cosine lobe:
//! sheen and subsurface scattering send light along the surface, where a cosine lobe has so few samples that their
//! weights would grow without limit towards the horizon.

use super::Principled;
use super::energy::Energies;
use crate::bsdf::usable;
use crate::microfacet::{mirror_pdf, sample_mirror};
use crate::real::consts::{FRAC_1_PI, TAU};
use crate::real::{Real, Vec3};

/// Smallest probability of the cosine and the uniform lobe together, where they should carry any light: the light of
/// a faint base is then not left to a few heavy samples.
const SPREAD_MIN: Real = 0.02;

/// The lobes seen from one `wo`, with their probabilities, which sum to 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mixture<'a> {
    bsdf: &'a Principled,
    wo: Vec3,
    cosine: Real,
    uniform: Real,
    specular: Real,
    coat: Real,
}

impl<'a> Mixture<'a> {
    /// `None` when `wo` is no direction above the horizon.
    #[inline]
    pub fn new(bsdf: &'a Principled, wo: Vec3) -> Option<Mixture<'a>> {
        if !usable(wo) {
            return None;
        }
        let e = Energies::new(bsdf, wo);
        let (spread, mirrored) = (e.cosine + e.uniform, e.specular + e.coat);
        let total = spread + mirrored;
        let mut mixture = Mixture {
            bsdf,
            wo,
            cosine: 1.0,
            uniform: 0.0,
            specular: 0.0,
            coat: 0.0,
        };
        // A surface that sends back no light at all, or too little to divide by, is sampled like a diffuse one.
        if total >= Real::MIN_POSITIVE {
            let (mut out, mut back) = (1.0 / total, 1.0 / total);
            if spread >= Real::MIN_POSITIVE && spread < SPREAD_MIN * total {
                (out, back) = (SPREAD_MIN / spread, (1.0 - SPREAD_MIN) / mirrored);
            }
            mixture.cosine = e.cosine * out;
            mixture.uniform = e.uniform * out;
            mixture.specular = e.specular * back;
            mixture.coat = e.coat * back;
        }
        Some(mixture)
    }

    /// Draws `wi`: `u[0]` picks the lobe, and what is left of it serves the lobe, so that stratification is kept.
    #[inline]
    pub fn propose(&self, u: [Real; 2]) -> Vec3 {
        let mut rest = u[0];
        if rest < self.cosine {
            // Malley's method: uniform over the disk below.
            return over_disk(u[1].sqrt(), rest / self.cosine, (1.0 - u[1]).sqrt());
        }
        rest -= self.cosine;
        if rest < self.uniform {
            return over_disk((u[1] * (2.0 - u[1])).sqrt(), rest / self.uniform, 1.0 - u[1]);
        }
        rest -= self.uniform;
        if rest < self.coat {
            return self.bsdf.gtr1.sample_mirror(self.wo, [rest / self.coat, u[1]]);
        }
        rest -= self.coat;
        // Round-off of the sum may leave a little too much, or anything at all where this lobe has no probability.
        let turn = (rest / self.specular).min(1.0);
        sample_mirror(self.wo, self.bsdf.alpha, [turn, u[1]]).unwrap_or(self.wo)
    }

    /// Density of [`Mixture::propose`], sr⁻¹; zero unless `wi` is above the horizon.
    #[inline]
    pub fn pdf(&self, wi: Vec3) -> Real {
        if !usable(wi) {
            return 0.0;
        }
        let mut sum = self.cosine * FRAC_1_PI * wi.z + self.uniform / TAU;
        if self.specular > 0.0 {
            sum += self.specular * mirror_pdf(self.wo, wi, self.bsdf.alpha);
        }
        if self.coat > 0.0 {
            sum += self.coat * self.bsdf.gtr1.mirror_pdf(self.wo, wi);
        }
        sum
    }
}

/// The direction at height `z` over the point of the unit disk with radius `r`, `turn` full turns from x.
#[inline]
fn over_disk(r: Real, turn: Real, z: Real) -> Vec3 {
    let (sin, cos) = (TAU * turn).sin_cos();
    Vec3::new(r * cos, r * sin, z)
}
