//! The value of each lobe: main specular, clearcoat, and the base with its sheen.
//!
//! Sources as in [`super`]. Every quotient that is finite in the limit of grazing angles is written so that it is
//! finite there; Mitsuba's cut-off of lobes below 1e-20 is left out.

use super::{Principled, PrincipledParameters};
use crate::bsdf::usable;
use crate::fresnel::{dielectric, schlick_weight};
use crate::microfacet::{HalfVector, Stretched};
use crate::real::{Real, Vec3};

/// Roughness of the clearcoat as far as its masking goes, whatever its gloss.
const CLEARCOAT_MASKING_ALPHA: Real = 0.25;

/// Reflectance of the clearcoat at normal incidence.
const CLEARCOAT_F0: Real = 0.04;

/// Reflectance of the dielectric at normal incidence for `specular` = 1.
const SPECULAR_F0: Real = 0.08;

/// Fresnel term of the main specular lobe: a mix of an exact dielectric, a tinted one and a metal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fresnel {
    /// Share of the exact dielectric.
    exact: Real,
    /// Its relative index of refraction, > 1.
    eta: Real,
    /// Share of what follows Schlick's approximation.
    schlick: Real,
    /// Reflectance of that share at normal incidence, times the share.
    schlick_f0: Vec3,
}

impl Fresnel {
    /// `tint`: the base colour at luminance 1.
    pub fn new(p: &PrincipledParameters, tint: Vec3) -> Fresnel {
        let f0 = SPECULAR_F0 * p.specular;
        let untinted = (1.0 - p.metallic) * (1.0 - p.specular_tint);
        let tinted = (1.0 - p.metallic) * p.specular_tint;
        Fresnel {
            exact: untinted,
            eta: 2.0 / (1.0 - f0.sqrt()) - 1.0,
            schlick: p.metallic + tinted,
            schlick_f0: p.metallic * p.base_color + tinted * f0 * tint,
        }
    }

    /// Reflectance at an angle to the normal whose cosine is `cos`, RGB.
    #[inline]
    pub fn at(&self, cos: Real) -> Vec3 {
        let mut sum = Vec3::ZERO;
        if self.exact > 0.0 {
            sum += Vec3::splat(self.exact * dielectric(cos, self.eta).reflectance);
        }
        if self.schlick > 0.0 {
            let white = schlick_weight(cos);
            sum += self.schlick_f0 * (1.0 - white) + Vec3::splat(self.schlick * white);
        }
        sum
    }
}

impl Principled {
    /// f·cos θ_i, RGB, sr⁻¹; zero unless both directions are above the horizon.
    #[inline]
    pub(super) fn f_cos(&self, wo: Vec3, wi: Vec3) -> Vec3 {
        if !usable(wo) || !usable(wi) {
            return Vec3::ZERO;
        }
        let [specular, coat, base] = self.lobes(wo, wi);
        specular + base + coat
    }

    /// Main specular lobe, clearcoat and base, RGB, sr⁻¹; both directions are above the horizon.
    #[inline]
    pub(super) fn lobes(&self, wo: Vec3, wi: Vec3) -> [Vec3; 3] {
        let half = HalfVector::new(wo, wi, self.alpha);
        [
            self.specular(wo, wi, &half),
            Vec3::splat(self.coat(wo, wi, half.cos)),
            self.base(wo, wi, half.cos),
        ]
    }

    /// Main specular lobe: F·D·G1(wo)·G1(wi) / (4 cos θ_o), where G1(w) is cos θ over the projected area.
    #[inline]
    fn specular(&self, wo: Vec3, wi: Vec3, half: &HalfVector) -> Vec3 {
        match &self.fresnel {
            Some(fresnel) => {
                let area = Stretched::new(wo, self.alpha).projected_area();
                fresnel.at(half.cos) * (half.density * masking(wi, self.alpha) / (4.0 * area))
            }
            None => Vec3::ZERO,
        }
    }

    /// Clearcoat: F·D·G1(wo)·G1(wi)·cos θ_i, without the 1/(4 cos θ_i cos θ_o) of a microfacet model.
    #[inline]
    fn coat(&self, wo: Vec3, wi: Vec3, cos: Real) -> Real {
        let clearcoat = self.parameters.clearcoat;
        if clearcoat == 0.0 {
            return 0.0;
        }
        let fresnel = CLEARCOAT_F0 + (1.0 - CLEARCOAT_F0) * schlick_weight(cos);
        let masking = |w: Vec3| masking(w, [CLEARCOAT_MASKING_ALPHA; 2]);
        0.25 * clearcoat * fresnel * self.gtr1.half_density(wo, wi) * masking(wo) * masking(wi) * wi.z
    }

    /// Diffuse and retro-reflecting base as Burley 2015 separates them, or the subsurface approximation and sheen of
    /// Burley 2012; `cos` of the difference angle.
    #[inline]
    fn base(&self, wo: Vec3, wi: Vec3, cos: Real) -> Vec3 {
        if self.parameters.metallic == 1.0 {
            return Vec3::ZERO;
        }
        // Burley's F_V, F_L and R_R.
        let (o, i) = (schlick_weight(wo.z), schlick_weight(wi.z));
        let retro = 2.0 * self.parameters.roughness * cos * cos;
        let flatness = self.parameters.flatness;
        let mut base = (1.0 - flatness)
            * ((1.0 - 0.5 * o) * (1.0 - 0.5 * i) + retro * (o + i + o * i * (retro - 1.0)))
            * wi.z;
        if flatness > 0.0 {
            let grazing = 0.5 * retro - 1.0;
            let flattened = (1.0 + grazing * o) * (1.0 + grazing * i);
            // cos θ_i/(cos θ_i + cos θ_o) is a share, however small both are.
            let share = wi.z / (wi.z + wo.z);
            base += flatness * 1.25 * (flattened * (share - 0.5 * wi.z) + 0.5 * wi.z);
        }
        let mut value = self.diffuse * base;
        if self.parameters.sheen > 0.0 {
            value += self.sheen * (schlick_weight(cos) * wi.z);
        }
        value
    }
}

/// Smith's masking G1 of the unit vector `w` above the horizon.
#[inline]
fn masking(w: Vec3, alpha: [Real; 2]) -> Real {
    w.z / Stretched::new(w, alpha).projected_area()
}
