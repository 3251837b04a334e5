//! The boost: a conformal map of the hemisphere onto itself that carries the normal to a given direction.
//!
//! Directions transform as light does between observers who move past each other at the speed β (Einstein 1905, *Zur
//! Elektrodynamik bewegter Körper*, §7, the law of aberration). With β in the plane of the surface the horizon stays the
//! horizon. It turns the lobe of a rough mirror seen at a slant into one around the normal: its half vector
//! normalise(v + normal), stretched by cos θ along β, becomes the half vector of the two real directions, and so straight
//! ellipses of facet slopes, however long, stay straight, where a linear map of directions would have to bend them.

/// A boost of directions with a velocity in the plane of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Boost {
    /// Velocity β, |β| < 1: the normal goes to the direction whose x and y are −β.
    beta: [f64; 2],
    /// √(1 − |β|²).
    cos: f64,
}

impl Boost {
    /// Nothing changes.
    pub const NONE: Boost = Boost {
        beta: [0.0; 2],
        cos: 1.0,
    };

    /// The boost with velocity `beta`, |β| < 1.
    pub fn new(beta: [f64; 2]) -> Boost {
        let cos = (1.0 - beta[0] * beta[0] - beta[1] * beta[1]).max(0.0).sqrt();
        Boost { beta, cos }
    }

    /// The boost with velocity `beta` whose `cos` = √(1 − |β|²) is known better than from β itself.
    pub fn with_cos(beta: [f64; 2], cos: f64) -> Boost {
        Boost { beta, cos }
    }

    /// √(1 − |β|²): cosine of the polar angle that the normal goes to.
    pub fn cos(&self) -> f64 {
        self.cos
    }

    /// The velocity β.
    pub fn velocity(&self) -> [f64; 2] {
        self.beta
    }

    /// The boost that carries the normal to the direction of slope `slope` = (x/z, y/z).
    pub fn to_slope(slope: [f64; 2]) -> Boost {
        let cos = 1.0 / (1.0 + slope[0] * slope[0] + slope[1] * slope[1]).sqrt();
        Boost {
            beta: [-slope[0] * cos, -slope[1] * cos],
            cos,
        }
    }

    /// The boost that undoes this one.
    pub fn inverse(&self) -> Boost {
        Boost {
            beta: self.beta.map(|b| -b),
            cos: self.cos,
        }
    }

    /// Where the unit direction `v` goes, and the solid angle there per solid angle at `v`, cos² / (1 − v·β)².
    pub fn apply(&self, v: [f64; 3]) -> ([f64; 3], f64) {
        let along = v[0] * self.beta[0] + v[1] * self.beta[1];
        let scale = 1.0 / (1.0 - along);
        let shift = along / (1.0 + self.cos) - 1.0;
        (
            [
                scale * (self.cos * v[0] + shift * self.beta[0]),
                scale * (self.cos * v[1] + shift * self.beta[1]),
                scale * self.cos * v[2],
            ],
            (self.cos * scale).powi(2),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Rng;
    use glam::DVec3;

    /// Round-off of boosts up to 85°.
    const ROUND_TRIP_TOL: f64 = 1e-12;
    /// Central differences with step 1e-5.
    const DIFFERENCE_TOL: f64 = 1e-6;

    #[test]
    fn it_is_undone_carries_the_normal_and_keeps_half_vectors_straight() {
        let mut rng = Rng::new(&[0xb0]);
        for _ in 0..1000 {
            let wo = crate::bsdf::direction(85.0 * rng.uniform(), 360.0 * rng.uniform());
            let boost = Boost::to_slope([-wo.x / wo.z, -wo.y / wo.z]);
            let v = crate::bsdf::direction(89.0 * rng.uniform(), 360.0 * rng.uniform());
            let (w, scale) = boost.apply(v.to_array());
            let w = DVec3::from_array(w);
            assert!((w.length() - 1.0).abs() < ROUND_TRIP_TOL);
            let (back, inverse) = boost.inverse().apply(w.to_array());
            assert!((DVec3::from_array(back) - v).length() < ROUND_TRIP_TOL);
            assert!((scale * inverse - 1.0).abs() < ROUND_TRIP_TOL);
            let (mirror, _) = boost.apply([0.0, 0.0, 1.0]);
            assert!((DVec3::from_array(mirror) - DVec3::new(-wo.x, -wo.y, wo.z)).length() < ROUND_TRIP_TOL);
            // Slopes of the half vectors: those around the normal, with the part along wo's azimuth times cos θ_o,
            // over a denominator that is the same for a whole straight line.
            let (h, local) = (w + wo, v + DVec3::Z);
            let p = [local.x / local.z, local.y / local.z];
            let along = p[0] * wo.x + p[1] * wo.y;
            let expected = [0, 1].map(|c: usize| (p[c] - wo[c] * along / (1.0 + wo.z)) / (1.0 - along));
            assert!((h.x / h.z - expected[0]).abs() < ROUND_TRIP_TOL * (1.0 + expected[0].abs()) * 1e3);
            assert!((h.y / h.z - expected[1]).abs() < ROUND_TRIP_TOL * (1.0 + expected[1].abs()) * 1e3);
        }
    }

    #[test]
    fn its_scale_is_that_of_solid_angles() {
        let boost = Boost::to_slope([-1.2, 0.7]);
        let v = DVec3::new(0.3, -0.5, 0.81).normalize();
        let a = v.cross(DVec3::Z).normalize();
        let b = v.cross(a);
        let h = 1e-5;
        let at = |d: DVec3| DVec3::from_array(boost.apply((v + d).normalize().to_array()).0);
        let (x, y) = (
            (at(a * h) - at(a * -h)) / (2.0 * h),
            (at(b * h) - at(b * -h)) / (2.0 * h),
        );
        let (_, scale) = boost.apply(v.to_array());
        assert!((x.cross(y).length() - scale).abs() < DIFFERENCE_TOL);
        assert!(x.dot(y).abs() < DIFFERENCE_TOL, "conformal");
    }
}
