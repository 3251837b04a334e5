//! The hemisphere laid over the whole plane, so that a flow of the plane has a proper density of directions.
//!
//! A disk point of radius r goes to the radius ρ with r² = 1 − exp(−ρ²/2), its azimuth stays. A Gaussian of the plane is
//! then a cosine lobe: a flow that does nothing samples cosθ/π, and with z² = 1 − r² heights next to the horizon keep
//! their relative precision.

use bake_runtime::concentric::square_to_hemisphere;
use glam::{DVec2, DVec3};

/// Heights below this count as this: ρ stays finite at the horizon, and densities there do not underflow.
const Z_MIN: f64 = 1e-60;

/// Squared radius of the disk from which z tells ρ better than 1 − r² does.
const RIM: f64 = 0.5;

/// Point of the plane for the direction `wi`, z ≥ 0.
pub fn from_direction(wi: DVec3) -> DVec2 {
    let r2 = wi.x * wi.x + wi.y * wi.y;
    let rho2 = match r2 < RIM {
        true => -2.0 * (-r2).ln_1p(),
        false => -4.0 * wi.z.max(Z_MIN).ln(),
    };
    let scale = if r2 > 0.0 { (rho2 / r2).sqrt() } else { 0.0 };
    DVec2::new(wi.x, wi.y) * scale
}

/// Unit direction over the point `x` of the plane; `None` where that is so far out that its height underflows.
pub fn to_direction(x: DVec2) -> Option<DVec3> {
    let rho2 = x.length_squared();
    let z = (-0.25 * rho2).exp();
    let scale = match rho2 > 0.0 {
        true => (-(-0.5 * rho2).exp_m1() / rho2).sqrt(),
        false => 0.0,
    };
    (z >= Z_MIN).then(|| DVec3::new(x.x * scale, x.y * scale, z))
}

/// ln of the plane's area per solid angle at the point `x`, sr⁻¹.
pub fn log_area(x: DVec2) -> f64 {
    // r dr = exp(−ρ²/2)·ρ dρ/2 and dω = r dr dφ / z: dω/dx = z/2.
    std::f64::consts::LN_2 + 0.25 * x.length_squared()
}

/// A standard Gaussian number of the plane for `u` in `[0,1)²`: nearby `u` give nearby points.
pub fn gaussian(u: [f64; 2]) -> DVec2 {
    from_direction(DVec3::from_array(square_to_hemisphere(
        u,
        [1.0 - u[0], 1.0 - u[1]],
    )))
}

/// ln of the density of [`gaussian`] at `z`, per unit area of the plane.
pub fn log_gaussian(z: DVec2) -> f64 {
    -0.5 * z.length_squared() - std::f64::consts::TAU.ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::Rng;
    use bake_runtime::bsdf::direction;

    /// Round-off of exponentials and logarithms; both sides of [`RIM`] and of the pole are hit.
    const ROUND_OFF: f64 = 1e-12;
    /// Central differences with step 1e-5.
    const DIFFERENCE_TOL: f64 = 1e-6;

    #[test]
    fn the_plane_is_the_hemisphere() {
        let mut rng = Rng::new(&[0x91a]);
        for i in 0..1000 {
            // Down to a thousandth of a degree above the horizon, and at the pole.
            let height = 90.0 * 10f64.powf(-5.0 * rng.uniform());
            let wi = if i == 0 {
                DVec3::Z
            } else {
                direction(90.0 - height, 360.0 * rng.uniform())
            };
            let x = from_direction(wi);
            let back = to_direction(x).expect("not at the horizon");
            assert!(
                back.is_normalized() && (back - wi).length() < ROUND_OFF,
                "{wi} {back}"
            );
            assert!((back.z / wi.z - 1.0).abs() < ROUND_OFF);
        }
        assert_eq!(to_direction(DVec2::new(0.0, 50.0)), None);
        assert!(from_direction(DVec3::X).is_finite());
    }

    #[test]
    fn areas_are_those_of_differences() {
        let mut rng = Rng::new(&[0x91b]);
        let h = 1e-5;
        for _ in 0..200 {
            let x = DVec2::from_array(rng.pair().map(|u| 6.0 * u - 3.0));
            let at = |d: DVec2| to_direction(x + d).expect("not at the horizon");
            let across = (at(DVec2::new(h, 0.0)) - at(DVec2::new(-h, 0.0))) / (2.0 * h);
            let along = (at(DVec2::new(0.0, h)) - at(DVec2::new(0.0, -h))) / (2.0 * h);
            let solid_angle = across.cross(along).length();
            assert!((solid_angle * log_area(x).exp() - 1.0).abs() < DIFFERENCE_TOL);
        }
    }

    #[test]
    fn a_gaussian_is_a_cosine_lobe() {
        let mut rng = Rng::new(&[0x91c]);
        for _ in 0..200 {
            let u = rng.pair();
            let z = gaussian(u);
            let wi = to_direction(z).expect("not at the horizon");
            let pdf = (log_gaussian(z) + log_area(z)).exp();
            assert!((pdf / (wi.z * std::f64::consts::FRAC_1_PI) - 1.0).abs() < ROUND_OFF);
        }
    }
}
