//! The interface of a reference BSDF with its parameters bound.

use crate::random::Rng;
use glam::DVec3;

/// One direction drawn by [`Bsdf::sample`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// Unit vector to the light, shading frame, z > 0.
    pub wi: DVec3,
    /// `f_cos / pdf` of the technique that drew it, RGB, dimensionless.
    pub weight: DVec3,
}

/// A reflecting BSDF in f64, in the shading frame (z = normal).
///
/// `wo` (to the camera) and `wi` (to the light) are unit vectors away from the surface.
/// Where either points below the horizon, or is not finite, `eval` and `pdf` are zero and `sample` is `None`.
pub trait Bsdf: Send + Sync {
    /// `f(wo, wi)·cos θ_i`, RGB, sr⁻¹: the value, or an unbiased estimate of it that draws from `rng`.
    fn eval(&self, wo: DVec3, wi: DVec3, rng: &mut Rng) -> DVec3;

    /// Draws `wi`; `u` in `[0,1)²` steers the first interaction, everything after it draws from `rng`.
    fn sample(&self, wo: DVec3, u: [f64; 2], rng: &mut Rng) -> Option<BsdfSample>;

    /// A normalised density of `wi`, sr⁻¹, for the weights of multiple importance sampling.
    ///
    /// Where `sample` is a random walk this only approximates its density and must never divide a contribution.
    fn pdf(&self, wo: DVec3, wi: DVec3) -> f64;
}
