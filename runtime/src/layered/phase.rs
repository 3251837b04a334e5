//! The Henyey–Greenstein phase function: how a medium scatters.
//!
//! Source: Henyey and Greenstein 1941, *Diffuse Radiation in the Galaxy*.
//! Deviation: the inverse is written as one fraction that needs no case for small `g`.

use crate::real::consts::{PI, TAU};
use crate::real::{Real, Vec3};

/// Density of scattering from the direction of travel `from` into `to` (both unit), sr⁻¹; `g` in (−1, 1) is the mean
/// cosine between them. It integrates to 1 over the sphere and is symmetric.
#[inline]
pub(super) fn henyey_greenstein(from: Vec3, to: Vec3, g: Real) -> Real {
    if g == 0.0 {
        return 1.0 / (4.0 * PI);
    }
    let squared = (1.0 - g) * (1.0 - g) + 2.0 * g * (1.0 - from.dot(to));
    // The cosine of unit vectors with round-off may exceed 1 by a little.
    let squared = squared.max((1.0 - g.abs()) * (1.0 - g.abs()));
    (1.0 - g * g) / (4.0 * PI * squared * squared.sqrt())
}

/// Draws the direction of travel after scattering, with density [`henyey_greenstein`]; `u` in `[0,1)²`.
#[inline]
pub(super) fn sample_henyey_greenstein(from: Vec3, g: Real, u: [Real; 2]) -> Vec3 {
    let s = 2.0 * u[0] - 1.0;
    let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
    if g == 0.0 {
        let sin = ((1.0 - s) * (1.0 + s)).sqrt();
        return Vec3::new(sin * cos_phi, sin * sin_phi, s);
    }
    // (1 + g² − ((1 − g²)/(1 + g·s))²)/(2g), multiplied out: its terms no longer cancel for small g.
    let numerator = s * (1.0 + g * g) + 0.5 * g * (s * s + 3.0) + 0.5 * g * g * g * (s * s - 1.0);
    let cos = (numerator / ((1.0 + g * s) * (1.0 + g * s))).clamp(-1.0, 1.0);
    let sin = ((1.0 - cos) * (1.0 + cos)).sqrt();
    let (x, y) = from.any_orthonormal_pair();
    (from * cos + x * (sin * cos_phi) + y * (sin * sin_phi)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Rng;

    /// Standard errors allowed: ten comparisons exceed 4.5 by chance once in 15 000 runs.
    const SIGMAS: Real = 4.5;

    /// The moments of the drawn cosine against its closed form, and of the density against 1, by the same draws.
    #[test]
    fn draws_follow_the_density() {
        const DRAWS: usize = 200_000;
        let from = Vec3::new(0.3, -0.5, -0.8).normalize();
        for (k, g) in [-0.9, -0.3, 0.0, 1e-9, 0.5, 0.95].into_iter().enumerate() {
            let mut rng = Rng::new(&[21, k as u64]);
            let (mut sum, mut square, mut inverse) = (0.0, 0.0, 0.0);
            for _ in 0..DRAWS {
                let to = sample_henyey_greenstein(from, g, rng.pair());
                let cos = from.dot(to);
                sum += cos;
                square += cos * cos;
                // E[1/p] over the draws is the solid angle of the sphere; the hemisphere ahead keeps it tame.
                inverse += Real::from(u8::from(cos * g >= 0.0)) / henyey_greenstein(from, to, g) / (2.0 * PI);
            }
            let n = DRAWS as Real;
            let mean = sum / n;
            let se = ((square / n - mean * mean) / n).sqrt();
            assert!((mean - g).abs() < SIGMAS * se, "mean cosine {mean} for g {g}");
            if g != 0.0 && g.abs() < 0.6 {
                // 1/p varies by less than a factor of 5 here, so its relative deviation is below 1.
                assert!(
                    (inverse / n - 1.0).abs() < SIGMAS / n.sqrt(),
                    "{} for g {g}",
                    inverse / n
                );
            }
        }
    }
}
