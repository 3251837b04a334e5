//! How much light an interface mirrors, by the cosine between light and normal: Schlick's approximation, complex
//! indices of refraction (metals) and real ones (dielectrics). All unpolarised.

use crate::real::{Real, Vec3};

/// The reflectance of a metal, RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MetalFresnel {
    /// Schlick 1994, *An Inexpensive BRDF Model for Physically-based Rendering*, from F0 in `[0, 1]`.
    Schlick(Vec3),
    /// Exact for the relative index of refraction η + i·k per channel.
    Complex {
        /// Real parts, > 0.
        eta: Vec3,
        /// Extinction coefficients, ≥ 0.
        k: Vec3,
    },
}

impl MetalFresnel {
    /// Reflectance at an angle whose cosine is `cos`, RGB, in `[0, 1]`.
    #[inline]
    pub fn at(&self, cos: Real) -> Vec3 {
        match *self {
            MetalFresnel::Schlick(f0) => schlick(f0, cos),
            MetalFresnel::Complex { eta, k } => Vec3::new(
                complex(cos, eta.x, k.x),
                complex(cos, eta.y, k.y),
                complex(cos, eta.z, k.z),
            ),
        }
    }

    /// Reflectance at normal incidence (F0), RGB.
    pub fn normal(&self) -> Vec3 {
        self.at(1.0)
    }
}

/// (1 − cos)⁵: the weight of white in Schlick's approximation.
#[inline]
pub(crate) fn schlick_weight(cos: Real) -> Real {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    let m2 = m * m;
    m2 * m2 * m
}

/// Schlick's reflectance at the angle whose cosine is `cos`, for the reflectance `f0` at normal incidence.
#[inline]
pub(crate) fn schlick(f0: Vec3, cos: Real) -> Vec3 {
    f0 + (Vec3::ONE - f0) * schlick_weight(cos)
}

/// Reflectance of a metal with the relative index of refraction `eta` + i·`k`, in `[0, 1]`.
///
/// Born and Wolf 1999, *Principles of Optics*, §14.2, in the real form with a² + b² and a of the refracted
/// wave's normal component.
#[inline]
pub(crate) fn complex(cos: Real, eta: Real, k: Real) -> Real {
    let cos = cos.clamp(0.0, 1.0);
    let cos2 = cos * cos;
    let sin2 = 1.0 - cos2;
    // η² − k² − sin², without the cancellation of sin² next to the horizon.
    let real = (eta - 1.0) * (eta + 1.0) - k * k + cos2;
    let modulus = real.hypot(2.0 * eta * k);
    let a2 = 0.5 * (modulus + real);
    // Where the real part is negative, the sum cancels; the product of both roots does not.
    let a2 = if real >= 0.0 {
        a2
    } else {
        2.0 * (eta * k) * (eta * k) / (modulus - real)
    };
    let across = 2.0 * a2.max(0.0).sqrt() * cos;
    let s = (modulus + cos2 - across) / (modulus + cos2 + across);
    let (even, odd) = (cos2 * modulus + sin2 * sin2, across * sin2);
    // At grazing incidence on k = 0, η = 1, both are 0: nothing is mirrored but at the very horizon.
    let p = if even + odd > 0.0 {
        s * (even - odd) / (even + odd)
    } else {
        s
    };
    let mean = 0.5 * (s + p);
    if mean.is_nan() { 0.0 } else { mean.clamp(0.0, 1.0) }
}

/// How light meets an interface between two dielectrics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Dielectric {
    /// Share that is mirrored, in `[0, 1]`; 1 under total reflection.
    pub reflectance: Real,
    /// Cosine of the refracted light with the normal, ≥ 0; 0 under total reflection.
    pub cos_refracted: Real,
}

/// Light whose cosine with the normal is `cos` ≥ 0 meets a medium `eta` times as dense as its own.
///
/// Born and Wolf 1999, *Principles of Optics*, §1.5. For `eta` = 1 exactly nothing is mirrored.
#[inline]
pub(crate) fn dielectric(cos: Real, eta: Real) -> Dielectric {
    let cos = cos.clamp(0.0, 1.0);
    // cos_t² = (cos² + η² − 1)/η², with η² − 1 as a product that is exact for η next to 1.
    let excess = (eta - 1.0) * (eta + 1.0);
    let squared = cos * cos + excess;
    if squared <= 0.0 {
        // At η = 1 light along the interface passes by.
        let reflectance = if eta == 1.0 { 0.0 } else { 1.0 };
        return Dielectric {
            reflectance,
            cos_refracted: 0.0,
        };
    }
    let cos_t = squared.sqrt() / eta;
    // (cos − η·cos_t)/(cos + η·cos_t) and (η·cos − cos_t)/(η·cos + cos_t), their differences of nearly equal numbers
    // multiplied out.
    let (across, along) = (cos + eta * cos_t, eta * cos + cos_t);
    let s = -excess / (across * across);
    let p = excess * ((eta * eta + 1.0) * cos * cos - 1.0) / (eta * eta * along * along);
    Dielectric {
        reflectance: (0.5 * (s * s + p * p)).min(1.0),
        cos_refracted: cos_t,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Round-off of formulas without large cancellation.
    const ROUND_OFF: Real = 1e-12;
    /// 1 − cos² at cos = 1e-6 leaves this much of the small differences from 1.
    const GRAZING_TOL: Real = 1e-9;

    #[test]
    fn complex_without_extinction_is_dielectric() {
        for eta in [1.2, 1.5, 2.5] {
            for cos in [1e-6, 0.05, 0.4, 0.9, 1.0] {
                let difference = complex(cos, eta, 0.0) - dielectric(cos, eta).reflectance;
                assert!(difference.abs() < GRAZING_TOL, "{difference} at {cos}, {eta}");
            }
        }
    }

    #[test]
    fn known_values() {
        assert!((dielectric(1.0, 1.5).reflectance - 0.04).abs() < ROUND_OFF);
        assert!((dielectric(0.0, 1.5).reflectance - 1.0).abs() < ROUND_OFF);
        assert_eq!(dielectric(0.2, 1.0 / 1.5).reflectance, 1.0);
        // ((η − 1)² + k²)/((η + 1)² + k²) at normal incidence.
        let (eta, k) = (0.2, 3.9);
        let normal = ((eta - 1.0) * (eta - 1.0) + k * k) / ((eta + 1.0) * (eta + 1.0) + k * k);
        assert!((complex(1.0, eta, k) - normal).abs() < ROUND_OFF);
        assert!((complex(0.0, eta, k) - 1.0).abs() < ROUND_OFF);
    }

    #[test]
    fn no_interface_mirrors_nothing() {
        for cos in [0.0, 1e-9, 0.3, 1.0] {
            let d = dielectric(cos, 1.0);
            assert_eq!((d.reflectance, d.cos_refracted), (0.0, cos));
            assert_eq!(complex(cos, 1.0, 0.0), 0.0);
        }
    }

    #[test]
    fn refraction_is_reversible() {
        for eta in [0.7, 1.0 + 1e-6, 1.3, 2.0] {
            for cos in [0.02, 0.3, 0.99] {
                let forth = dielectric(cos, eta);
                if forth.reflectance < 1.0 {
                    let back = dielectric(forth.cos_refracted, 1.0 / eta);
                    assert!((back.reflectance - forth.reflectance).abs() < GRAZING_TOL);
                    assert!((back.cos_refracted - cos).abs() < GRAZING_TOL);
                }
            }
        }
    }
}
