//! Quadrature over the hemisphere that resolves a GGX lobe of any roughness and a broad one at once.

use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, TAU};

/// Midpoint quadrature cuts the horizon along its cells, which costs about one part in their number per side.
pub const QUADRATURE_TOL: f64 = 1e-3;

/// A normal of any visibility with its density, sr⁻¹: uniform on the surface that alpha has stretched to a
/// hemisphere, so that D over the density is bounded; shares no code with the models.
pub fn draw_normal(alpha: [f64; 2], u: [f64; 2]) -> (DVec3, f64) {
    let cos = 1.0 - u[0];
    let slope = (1.0 - cos * cos).sqrt() / cos;
    let (y, x) = (TAU * u[1]).sin_cos();
    let m = DVec3::new(alpha[0] * slope * x, alpha[1] * slope * y, 1.0).normalize();
    (m, (cos / m.z).powi(3) / (TAU * alpha[0] * alpha[1]))
}

/// Density of [`draw_normal`] at the upward unit normal `m`, sr⁻¹.
fn normal_density(alpha: [f64; 2], m: DVec3) -> f64 {
    let stretched = DVec3::new(m.x / alpha[0], m.y / alpha[1], m.z);
    let cos = m.z / stretched.length();
    (cos / m.z).powi(3) / (TAU * alpha[0] * alpha[1])
}

/// ∫ g dω over the hemisphere by midpoints on `side`² cells in each of two coordinates: half vectors of `wo` under
/// roughness `alpha`, and the orthographic disk; the two share every direction by the balance heuristic.
pub fn hemisphere<const N: usize>(
    wo: DVec3,
    alpha: [f64; 2],
    side: usize,
    mut g: impl FnMut(DVec3) -> [f64; N],
) -> [f64; N] {
    let mut sum = [0.0; N];
    for cell in 0..side * side {
        let u = [(cell % side) as f64 + 0.5, (cell / side) as f64 + 0.5].map(|v| v / side as f64);
        let (m, _) = draw_normal(alpha, u);
        let mirrored = 2.0 * wo.dot(m) * m - wo;
        let (y, x) = (TAU * u[1]).sin_cos();
        let broad = DVec3::new(u[0].sqrt() * x, u[0].sqrt() * y, (1.0 - u[0]).sqrt());
        for (wi, seen) in [(mirrored, wo.dot(m) > 0.0), (broad, true)] {
            if seen && wi.z > 0.0 {
                let half = (wo + wi).normalize();
                let density = normal_density(alpha, half) / (4.0 * wo.dot(half).abs()) + wi.z * FRAC_1_PI;
                for (s, value) in sum.iter_mut().zip(g(wi)) {
                    *s += value / density;
                }
            }
        }
    }
    sum.map(|s| s / (side * side) as f64)
}
