//! The normals of the clearcoat: the long-tailed distribution GTR1, isotropic, and how light mirrors there.
//!
//! Source: Burley 2012, *Physically-Based Shading at Disney*. Deviation: Burley draws normals from
//! D·cos, many of which face away from a grazing `wo` and mirror nothing. We draw those that are visible on a
//! surface of V-shaped grooves (Heitz and d'Eon 2014, *Importance Sampling Microfacet-Based BSDFs using the
//! Distribution of Visible Normals*), so that the density of what is mirrored is finite everywhere. Their choice
//! between the two sides of a groove costs a third random number; we invert the distribution of azimuths instead.

use crate::real::consts::PI;
use crate::real::{Real, Vec3};

/// Bound on the Newton steps for an azimuth: four are usual, and at the triple root for `tilt` 1 each leaves two
/// thirds of the error, so that a hundred reach round-off from anywhere.
const NEWTON_STEPS_MAX: u32 = 100;

/// GTR1 with its roughness bound.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Gtr1 {
    /// Square of the roughness.
    alpha2: Real,
    /// ln of `alpha2`, < 0.
    log_alpha2: Real,
}

impl Gtr1 {
    /// `alpha` in (0, 1).
    pub fn new(alpha: Real) -> Gtr1 {
        Gtr1 {
            alpha2: alpha * alpha,
            log_alpha2: 2.0 * alpha.ln(),
        }
    }

    /// The roughness it was made with.
    pub fn alpha(&self) -> Real {
        self.alpha2.sqrt()
    }

    /// Density D of the normal along `sum`, which points up, per solid angle and base area, sr⁻¹.
    ///
    /// (α² − 1) / (π ln α² (sin² + α² cos²)), in terms of the slope; ∫ D·cos over the hemisphere is 1.
    #[inline]
    fn density(&self, sum: Vec3) -> Real {
        let excess = (1.0 - self.alpha2) / (slope2(sum) + self.alpha2);
        (self.alpha2 - 1.0) / (PI * self.log_alpha2) * (1.0 + excess)
    }

    /// D of the normal halfway between two unit vectors above the horizon, sr⁻¹.
    #[inline]
    pub fn half_density(&self, a: Vec3, b: Vec3) -> Real {
        self.density(a + b)
    }

    /// Draws `wi` by mirroring `wo`, above the horizon, at a visible normal; a direction below the horizon is
    /// mirrored up. `u` in `[0,1)²`. The density of `wi` is exactly [`Gtr1::mirror_pdf`].
    pub fn sample_mirror(&self, wo: Vec3, u: [Real; 2]) -> Vec3 {
        // sin² = (α^(2(1 − u)) − α²)/(1 − α²), as a product that keeps the digits of a small sine.
        let sin2 = self.alpha2 * (-u[1] * self.log_alpha2).exp_m1() / (1.0 - self.alpha2);
        let sin = sin2.min(1.0).sqrt();
        let cos = (1.0 - sin2).max(0.0).sqrt().max(Real::MIN_POSITIVE);
        let across = (wo.x * wo.x + wo.y * wo.y).sqrt();
        // The azimuth counts from that of `wo`; where `wo` has none, any will do.
        let (x, y) = if across > 0.0 {
            (wo.x / across, wo.y / across)
        } else {
            (1.0, 0.0)
        };
        let (sin_phi, cos_phi) = visible_azimuth(across * sin / (wo.z * cos), u[0]).sin_cos();
        let normal = Vec3::new(
            sin * (cos_phi * x - sin_phi * y),
            sin * (cos_phi * y + sin_phi * x),
            cos,
        );
        let wi = 2.0 * wo.dot(normal) * normal - wo;
        wi.with_z(wi.z.abs().max(Real::MIN_POSITIVE))
    }

    /// Density of [`Gtr1::sample_mirror`] at `wi`, above the horizon, sr⁻¹.
    ///
    /// min(1, 2 h_z cos θ_o / (wo·h))·D(h) / (4 cos θ_o) (Heitz and d'Eon 2014: G1 of V-grooves times D over
    /// 4 cos θ_o) at `wi` and at its image below the horizon. It integrates to exactly 1 over the hemisphere.
    #[inline]
    pub fn mirror_pdf(&self, wo: Vec3, wi: Vec3) -> Real {
        let density = |w: Vec3| {
            let sum = wo + w;
            if sum.z <= 0.0 {
                return 0.0;
            }
            // wo·h is half the length of `sum`, which leaves D / max(4 cos θ_o, |sum|²/sum_z).
            let groove = sum.z * (1.0 + slope2(sum));
            self.density(sum) / groove.max(4.0 * wo.z)
        };
        (density(wi) + density(wi.with_z(-wi.z))).min(Real::MAX)
    }
}

/// Squared slope of the surface whose normal lies along `normal`, which points up.
#[inline]
fn slope2(normal: Vec3) -> Real {
    let (x, y) = (normal.x / normal.z, normal.y / normal.z);
    x * x + y * y
}

/// Azimuth, from that of `wo`, of a visible normal in grooves whose sides lie at all azimuths alike.
///
/// `tilt` = tan θ_o · tan θ_m ≥ 0. The two sides of a groove are seen in proportion to max(0, wo·m), which makes the
/// density 2πp(φ) = 1 + `tilt`·cos φ where both are seen, 2 where only this one is, and 0 where only the other one
/// is. `u` in `[0,1)` is this density's integral, counted from −π.
fn visible_azimuth(tilt: Real, u: Real) -> Real {
    // A steeper tilt leaves no azimuth at which both sides are seen.
    let tilt = tilt.min(1.0 / Real::EPSILON);
    let signed = 2.0 * u - 1.0;
    let target = PI * signed.abs();
    // Nearer than `alone`, the other side of the groove is hidden.
    let alone = if tilt > 1.0 { (1.0 / tilt).acos() } else { 0.0 };
    if target <= 2.0 * alone {
        return (0.5 * target).copysign(signed);
    }
    // φ + tilt·sin φ is concave and increasing here: Newton's steps from the left approach and never overshoot.
    let target = target - alone + tilt * alone.sin();
    let mut phi = alone.max(target / (1.0 + tilt));
    for _ in 0..NEWTON_STEPS_MAX {
        let (sin, cos) = phi.sin_cos();
        let step = (target - phi - tilt * sin) / (1.0 + tilt * cos);
        phi += step.max(0.0);
        // Round-off turns the last step around, or makes it NaN where the density is zero.
        if step.is_nan() || step <= Real::EPSILON * phi {
            break;
        }
    }
    phi.min(PI - alone).copysign(signed)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Round-off of the distribution function, whose terms are of the size of the tilt.
    const ROUND_OFF: Real = 1e-12;

    /// The integral of the density that [`visible_azimuth`] documents, from −π to `phi`, over 2π.
    fn distribution(tilt: Real, phi: Real) -> Real {
        let alone = if tilt > 1.0 { (1.0 / tilt).acos() } else { 0.0 };
        let far = phi.abs();
        let half = if far <= alone {
            2.0 * far
        } else {
            alone + far + tilt * (far.sin() - alone.sin())
        };
        0.5 + half.copysign(phi) / (2.0 * PI)
    }

    #[test]
    fn azimuths_invert_their_distribution() {
        for tilt in [0.0, 1e-9, 0.3, 0.999, 1.0, 1.001, 2.0, 50.0] {
            for i in 0..1000 {
                let u = i as Real / 1000.0;
                let phi = visible_azimuth(tilt, u);
                let error = distribution(tilt, phi) - u;
                assert!(error.abs() < ROUND_OFF * (1.0 + tilt), "{error} at {tilt}, {u}");
                assert!(
                    1.0 + tilt * phi.cos() > -ROUND_OFF * tilt,
                    "hidden: {phi} at {tilt}"
                );
            }
        }
        for tilt in [1e20, Real::INFINITY] {
            assert!((visible_azimuth(tilt, 0.0) + 0.5 * PI).abs() < ROUND_OFF);
        }
    }
}
