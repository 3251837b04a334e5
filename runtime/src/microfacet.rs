//! A Smith microsurface with GGX normals: masking, which normals a ray meets, how light mirrors there, and how far
//! it flies between two of them. Shared by the reference models.
//!
//! Sources: Heitz et al. 2016, *Multiple-Scattering Microfacet BSDFs with the Smith Model*; Dupuy and Benyoub
//! 2023, *Sampling Visible GGX Normals with Spherical Caps*.
//! Deviation: heights appear only as the logarithm of C1, the share of the surface that lies below. A flight
//! then adds an exponential variate over Λ, which needs no inverse of C1 and never overflows, and the BSDF does
//! not depend on the distribution of heights. Every difference of nearly equal numbers is written as a quotient,
//! so that directions next to the horizon and next to ±z keep their relative precision.

use crate::bsdf::usable;
use crate::random::Uniforms;
use crate::real::consts::{FRAC_1_PI, TAU};
use crate::real::{Real, Vec3};

/// Smallest free flight, in mean free paths.
///
/// A uniform number of exactly 0 (probability 2⁻⁵³) would let a vertical ray stop at once, where the density of
/// visible normals is infinite; half of a uniform's spacing keeps every vertex finite.
const FLIGHT_MIN: Real = 0.25 * Real::EPSILON;

/// A unit direction beside its image on the stretched surface, whose roughness is 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stretched {
    /// The direction itself.
    pub direction: Vec3,
    /// x and y of the stretched direction: alpha times those of the direction.
    xy: [Real; 2],
    /// Squared length of `xy`.
    xy2: Real,
    /// Length of the stretched direction.
    length: Real,
}

impl Stretched {
    /// Stretches the unit vector `direction`.
    #[inline]
    pub fn new(direction: Vec3, alpha: [Real; 2]) -> Stretched {
        let xy = [alpha[0] * direction.x, alpha[1] * direction.y];
        let xy2 = xy[0] * xy[0] + xy[1] * xy[1];
        Stretched {
            direction,
            xy,
            xy2,
            length: (direction.z * direction.z + xy2).sqrt(),
        }
    }

    /// The opposite direction.
    #[inline]
    pub fn reversed(&self) -> Stretched {
        Stretched {
            direction: -self.direction,
            xy: [-self.xy[0], -self.xy[1]],
            ..*self
        }
    }

    /// Length of the stretched direction, for the height-correlated masking of [`crate::conductor::Conductor::single`].
    #[inline]
    pub fn length(&self) -> Real {
        self.length
    }

    /// Twice the projected area of the surface seen from this direction per unit of base area:
    /// z + √(z² + |αxy|²), which is 2 z·(1 + Λ). Positive from above and from below.
    #[inline]
    fn doubled_area(&self) -> Real {
        let z = self.direction.z;
        if z >= 0.0 {
            self.length + z
        } else {
            self.xy2 / (self.length - z)
        }
    }

    /// Projected area per unit of base area, of the surface seen from this direction; cos θ when smooth.
    #[inline]
    pub fn projected_area(&self) -> Real {
        0.5 * self.doubled_area()
    }

    /// Λ of this direction, which must point up: G1 from the height `log_c` is exp(Λ·`log_c`).
    #[inline]
    pub fn lambda_up(&self) -> Real {
        self.xy2 / (2.0 * self.direction.z * self.doubled_area())
    }

    /// ln C1 of where a ray along this direction that starts at ln C1 = `log_c` ends; 0 or more, or NaN, when it
    /// leaves the surface.
    ///
    /// The chance to pass from C1 to C1' is (C1/C1')^Λ, where Λ ≤ −1 for a direction that points down.
    #[inline]
    pub fn fly(&self, log_c: Real, rng: &mut impl Uniforms) -> Real {
        let flight = (-(1.0 - rng.uniform()).ln()).max(FLIGHT_MIN);
        let z = self.direction.z;
        let inverse_lambda = if z > 0.0 {
            2.0 * z * (self.length + z) / self.xy2
        } else {
            2.0 * z / (self.length - z)
        };
        log_c + flight * inverse_lambda
    }

    /// A normal seen from this direction, not normalised: density max(0, w·m)·D(m) / projected area, sr⁻¹.
    ///
    /// On the stretched surface, a hemisphere, the mirrored directions fill the cap z > −w.z uniformly;
    /// `u[0]` is its azimuth, `u[1]` the distance from its pole (Dupuy and Benyoub 2023).
    #[inline]
    pub fn visible_normal(&self, alpha: [Real; 2], u: [Real; 2]) -> Vec3 {
        let inverse_length = 1.0 / self.length;
        let cap = self.doubled_area() * inverse_length;
        let from_pole = u[1] * cap;
        let sin_theta = (from_pole * (2.0 - from_pole)).max(0.0).sqrt();
        let (sin_phi, cos_phi) = (TAU * u[0]).sin_cos();
        Vec3::new(
            alpha[0] * (sin_theta * cos_phi + self.xy[0] * inverse_length),
            alpha[1] * (sin_theta * sin_phi + self.xy[1] * inverse_length),
            cap - from_pole,
        )
    }

    /// This direction mirrored at a normal of any length that it sees, and the cosine between the two.
    #[inline]
    pub fn mirror(&self, normal: Vec3) -> (Vec3, Real) {
        let along = self.direction.dot(normal);
        let scale = along / normal.length_squared();
        (2.0 * scale * normal - self.direction, (along * scale).sqrt())
    }
}

/// The normal that mirrors one unit vector into another, as shading needs it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HalfVector {
    /// GGX density D of the normal, per solid angle and base area, sr⁻¹; zero for a normal that points down, and
    /// between directions so nearly opposite that the squared length of their sum underflows.
    pub density: Real,
    /// Cosine between the normal and either vector.
    pub cos: Real,
}

impl HalfVector {
    /// The half vector of the unit vectors `a` and `b`.
    #[inline]
    pub fn new(a: Vec3, b: Vec3, alpha: [Real; 2]) -> HalfVector {
        let sum = a + b;
        let length2 = sum.length_squared();
        if sum.z <= 0.0 || length2 < Real::MIN_POSITIVE {
            return HalfVector {
                density: 0.0,
                cos: 0.0,
            };
        }
        // Reciprocals of what stays the same in a loop leave the loop.
        let inverse = [1.0 / alpha[0], 1.0 / alpha[1]];
        let (x, y) = (sum.x * inverse[0], sum.y * inverse[1]);
        let ratio = length2 / (x * x + y * y + sum.z * sum.z);
        HalfVector {
            density: ratio * ratio * (inverse[0] * inverse[1] * FRAC_1_PI),
            cos: 0.5 * length2.sqrt(),
        }
    }
}

/// Draws `wi` by mirroring `wo` at a visible normal; a direction below the horizon is mirrored up.
///
/// `u` in `[0,1)²`. The density of `wi` is exactly [`mirror_pdf`]. `None` when `wo` is no direction above the horizon.
#[inline]
pub fn sample_mirror(wo: Vec3, alpha: [Real; 2], u: [Real; 2]) -> Option<Vec3> {
    if !usable(wo) {
        return None;
    }
    let eye = Stretched::new(wo, alpha);
    let (wi, _) = eye.mirror(eye.visible_normal(alpha, u));
    Some(wi.with_z(wi.z.abs().max(Real::MIN_POSITIVE)))
}

/// Density of [`sample_mirror`], sr⁻¹: that of mirroring at a visible normal, D(h)/(4 σ(wo)), at `wi` and at its
/// image below the horizon. It integrates to exactly 1 over the hemisphere.
#[inline]
pub fn mirror_pdf(wo: Vec3, wi: Vec3, alpha: [Real; 2]) -> Real {
    if !usable(wo) || !usable(wi) {
        return 0.0;
    }
    let density = |w: Vec3| HalfVector::new(wo, w, alpha).density;
    let area = Stretched::new(wo, alpha).projected_area();
    (density(wi) + density(wi.with_z(-wi.z))) / (4.0 * area)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Rng;

    /// Round-off of a handful of operations, none of which cancels.
    const ROUND_OFF: Real = 1e-12;

    /// Walks seldom travel next to ±z or to the horizon, so that tests of their means do not see these cases.
    #[test]
    fn extreme_directions_keep_their_precision() {
        for alpha in [[1e-4, 1e-4], [1.0, 0.01], [1.0, 1.0]] {
            for small in [1e-15, 1e-12, 1e-8, 1e-4] {
                for w in [Vec3::new(small, 0.0, 1.0), Vec3::new(0.6, 0.8, small)].map(Vec3::normalize) {
                    let (up, down) = (Stretched::new(w, alpha), Stretched::new(-w, alpha));
                    // σ(w)·σ(−w) = |αxy|²/4 and Λ(w) = σ(−w)/z, neither of which subtracts.
                    let product = 4.0 * up.projected_area() * down.projected_area();
                    assert!(
                        (product / up.xy2 - 1.0).abs() < ROUND_OFF,
                        "{product} at {w}, {alpha:?}"
                    );
                    let lambda = down.projected_area() / w.z;
                    assert!(
                        (up.lambda_up() / lambda - 1.0).abs() < ROUND_OFF,
                        "{lambda} at {w}, {alpha:?}"
                    );
                    for eye in [up, down] {
                        let mut rng = Rng::new(&[1]);
                        for _ in 0..100 {
                            let normal = eye.visible_normal(alpha, rng.pair());
                            let (mirrored, cos) = eye.mirror(normal);
                            assert!(
                                normal.z > 0.0 && (0.0..=1.0 + ROUND_OFF).contains(&cos),
                                "{normal} at {w}"
                            );
                            assert!(
                                (mirrored.length() - 1.0).abs() < ROUND_OFF,
                                "{mirrored} at {w}, {alpha:?}"
                            );
                        }
                    }
                }
            }
        }
    }
}
