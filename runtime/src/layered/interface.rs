//! The rough dielectric on top: GGX facets that mirror or refract once, with separable masking.
//!
//! Source: Walter et al. 2007, *Microfacet Models for Refraction through Rough Surfaces*, with visible normals drawn
//! as Dupuy and Benyoub 2023 do. The same facets are seen from both sides, so one description serves both: directions
//! point away from the facet, with z > 0 on the side they start from.
//! Deviation: for eta = 1 there is no interface, and light passes straight on, unmasked.

use crate::fresnel::{Dielectric, dielectric};
use crate::microfacet::{HalfVector, Stretched};
use crate::real::{Real, Vec3};

/// Light at a facet, and what becomes of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scattered {
    /// Unit direction after it, away from the facet: z > 0 when mirrored, z < 0 when refracted.
    pub direction: Vec3,
    /// Fresnel share that goes this way.
    pub share: Real,
    /// Masking G1 of `direction`: with visible normals, f·cos / pdf is `share` times this.
    pub masking: Real,
}

/// A rough interface between a medium and one that is `eta` times as dense.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Interface {
    /// GGX roughness, both axes.
    pub alpha: Real,
    /// Index of refraction of the far side over that of the near side.
    pub eta: Real,
}

/// A facet seen from `from`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facet {
    from: Vec3,
    normal: Vec3,
    cos: Real,
    dielectric: Dielectric,
}

impl Interface {
    /// The interface seen from the other side.
    pub fn reversed(&self) -> Interface {
        Interface {
            alpha: self.alpha,
            eta: 1.0 / self.eta,
        }
    }

    /// Whether there is nothing there.
    pub fn is_absent(&self) -> bool {
        self.eta == 1.0
    }

    /// Masking G1 of a direction with z ≠ 0.
    #[inline]
    pub fn masking(&self, w: Vec3) -> Real {
        let z = w.z.abs();
        z / Stretched::new(w.with_z(z), [self.alpha; 2]).projected_area()
    }

    /// A facet visible from `from` (unit, z > 0), drawn with `u` in `[0,1)²`.
    #[inline]
    pub fn facet(&self, from: Vec3, u: [Real; 2]) -> Facet {
        let normal = match self.is_absent() {
            true => Vec3::Z,
            false => Stretched::new(from, [self.alpha; 2])
                .visible_normal([self.alpha; 2], u)
                .normalize(),
        };
        let cos = from.dot(normal).clamp(0.0, 1.0);
        Facet {
            from,
            normal,
            cos,
            dielectric: dielectric(cos, self.eta),
        }
    }

    /// What `facet` mirrors; `None` where it leads through the surface.
    #[inline]
    pub fn mirror(&self, facet: &Facet) -> Option<Scattered> {
        let direction = 2.0 * facet.cos * facet.normal - facet.from;
        (direction.z > 0.0 && facet.dielectric.reflectance > 0.0).then(|| Scattered {
            direction,
            share: facet.dielectric.reflectance,
            masking: self.masking(direction),
        })
    }

    /// What `facet` refracts; `None` under total reflection or where it leads back out of the surface.
    #[inline]
    pub fn refract(&self, facet: &Facet) -> Option<Scattered> {
        if self.is_absent() {
            return Some(Scattered {
                direction: -facet.from,
                share: 1.0,
                masking: 1.0,
            });
        }
        let share = 1.0 - facet.dielectric.reflectance;
        let along = facet.cos / self.eta - facet.dielectric.cos_refracted;
        let direction = (along * facet.normal - facet.from / self.eta).normalize();
        (direction.z < 0.0 && share > 0.0).then(|| Scattered {
            direction,
            share,
            masking: self.masking(direction),
        })
    }

    /// `f_cos` of mirroring `wo` to `wi` (unit, both z > 0), sr⁻¹: F·D·G1(wo)·G1(wi) / (4 cos θ_o), written without
    /// the quotient of cosines.
    #[inline]
    pub fn reflection(&self, wo: Vec3, wi: Vec3) -> Real {
        self.mirrored(wo, wi) * self.masking(wi)
    }

    /// Density of mirroring `wo` to `wi` at a visible facet, Fresnel share included, sr⁻¹.
    #[inline]
    pub fn mirrored(&self, wo: Vec3, wi: Vec3) -> Real {
        if self.is_absent() {
            return 0.0;
        }
        let half = HalfVector::new(wo, wi, [self.alpha; 2]);
        let area = Stretched::new(wo, [self.alpha; 2]).projected_area();
        dielectric(half.cos, self.eta).reflectance * half.density / (4.0 * area)
    }
}

impl Facet {
    /// Share of the light that is mirrored.
    pub fn reflectance(&self) -> Real {
        self.dielectric.reflectance
    }
}
