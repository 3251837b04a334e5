//! The interface of a reference BSDF with its parameters bound.

use crate::moments::Moments;
use crate::random::Rng;
use crate::real::{Real, Vec3};

/// How far the squared length of a unit vector may be from 1: f32 callers with a few operations of round-off pass.
pub const UNIT_TOL: Real = 1e-4;

/// Independent parts of a mean whose spread gives its standard error.
const REPLICATES: u64 = 16;

/// Key of the numbers behind [`Bsdf::albedo`].
const ALBEDO_KEY: u64 = 0xa1be_d000;

/// One direction drawn by [`Bsdf::sample`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// Unit vector to the light, shading frame, z > 0.
    pub wi: Vec3,
    /// `f_cos / pdf` of the technique that drew it, RGB, dimensionless.
    pub weight: Vec3,
}

/// A mean with its standard error, RGB.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// The mean.
    pub mean: Vec3,
    /// Its standard error.
    pub se: Vec3,
}

/// A reflecting BSDF in the shading frame (z = normal).
///
/// `wo` (to the camera) and `wi` (to the light) are unit vectors away from the surface. Where either points below
/// the horizon, is not finite, or not of length 1 (its square within [`UNIT_TOL`]), `eval` and `pdf` are zero and
/// `sample` and `propose` are `None`.
pub trait Bsdf: Send + Sync {
    /// `f(wo, wi)·cos θ_i`, RGB, sr⁻¹: the value, or an unbiased estimate of it that draws from `rng`.
    fn eval(&self, wo: Vec3, wi: Vec3, rng: &mut Rng) -> Vec3;

    /// [`Bsdf::eval`] as a sharp lobe, which draws nothing, and the rest: the lobes of [`Bsdf::slice`].
    fn eval_lobes(&self, wo: Vec3, wi: Vec3, rng: &mut Rng) -> [Vec3; 2] {
        [self.eval(wo, wi, rng), Vec3::ZERO]
    }

    /// Draws `wi`; `u` in `[0,1)²` steers the first interaction, everything after it draws from `rng`.
    ///
    /// The mean of the weight is the albedo; `None` counts as a weight of zero.
    fn sample(&self, wo: Vec3, u: [Real; 2], rng: &mut Rng) -> Option<BsdfSample>;

    /// A density of `wi`, sr⁻¹, that integrates to 1 over the hemisphere: that of [`Bsdf::propose`].
    ///
    /// Where `sample` is a random walk this only approximates its density: good for the weights of multiple
    /// importance sampling, but it must never divide what `sample` drew.
    fn pdf(&self, wo: Vec3, wi: Vec3) -> Real;

    /// Draws `wi` from exactly [`Bsdf::pdf`]; `u` in `[0,1)²`. `None` only where `wo` is no direction above the
    /// horizon.
    fn propose(&self, wo: Vec3, u: [Real; 2]) -> Option<Vec3>;

    /// Whether `eval` draws from its `rng`.
    fn is_stochastic(&self) -> bool;

    /// The BSDF over all `wi` for one `wo`, for many evaluations that may share their noise.
    ///
    /// `walks` random walks from `wo`, keyed by `seed`, serve every direction (common random numbers):
    /// [`Slice::eval`] is unbiased at each, and its error varies smoothly from one to the next. Deterministic models
    /// need no walks.
    fn slice(&self, wo: Vec3, walks: usize, seed: u64) -> Box<dyn Slice + '_>;

    /// Directional albedo ∫ f_cos dω_i: the mean weight of `samples` calls of [`Bsdf::sample`].
    ///
    /// Points of the R2 sequence under 16 random shifts, which also give the standard error. At least 32 samples
    /// are taken.
    fn albedo(&self, wo: Vec3, samples: u64, seed: u64) -> Estimate {
        let each = samples.div_ceil(REPLICATES).max(2);
        let mut replicates = Moments::default();
        for replicate in 0..REPLICATES {
            let key = [ALBEDO_KEY, seed, replicate];
            let shift = Rng::new(&key).pair();
            let mut part = Vec3::ZERO;
            for i in 0..each {
                let mut rng = Rng::new(&[key[0], key[1], key[2], i + 1]);
                let sample = self.sample(wo, shifted_r2(i, shift), &mut rng);
                part += sample.map_or(Vec3::ZERO, |s| s.weight);
            }
            replicates.add(part / each as Real);
        }
        replicates.estimate()
    }
}

/// How the smooth lobe of a [`Slice`] lies relative to its sharp one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rest {
    /// Where the sharp one is, about as narrow: the higher orders of one rough surface.
    Alike,
    /// Over the whole hemisphere: light that entered the material, or a diffuse base.
    Diffuse,
}

/// One slice of a BSDF as a sum of two lobes: see [`Bsdf::slice`].
///
/// All values are `f_cos`, RGB, sr⁻¹; both lobes are non-negative.
pub trait Slice: Send + Sync {
    /// The lobe that may be narrow: exact, cheap, without noise.
    fn sharp(&self, wi: Vec3) -> Vec3;

    /// The rest; where it has noise, that is common to all directions.
    fn smooth(&self, wi: Vec3) -> Vec3;

    /// Roughness of the sharp lobe along x and y: how narrow it is.
    fn alpha(&self) -> [Real; 2];

    /// Where the rest lies.
    fn rest(&self) -> Rest;

    /// Their sum.
    fn eval(&self, wi: Vec3) -> Vec3 {
        self.sharp(wi) + self.smooth(wi)
    }
}

/// The slice of a model that needs no random numbers and tells no lobes apart.
pub(crate) struct DirectSlice<'a, B: Bsdf> {
    /// The model.
    pub bsdf: &'a B,
    /// Its one direction to the camera.
    pub wo: Vec3,
}

impl<B: Bsdf> Slice for DirectSlice<'_, B> {
    fn sharp(&self, wi: Vec3) -> Vec3 {
        self.bsdf.eval(self.wo, wi, &mut Rng::new(&[]))
    }

    fn smooth(&self, _: Vec3) -> Vec3 {
        Vec3::ZERO
    }

    fn alpha(&self) -> [Real; 2] {
        [1.0; 2]
    }

    fn rest(&self) -> Rest {
        Rest::Alike
    }
}

/// Whether `w` is a finite unit vector above the horizon.
#[inline]
pub(crate) fn usable(w: Vec3) -> bool {
    // A NaN anywhere fails the comparison.
    w.z > 0.0 && (w.length_squared() - 1.0).abs() <= UNIT_TOL
}

/// Unit direction of polar angle `theta_deg` from the normal and azimuth `phi_deg` from x towards y, degrees.
///
/// z is exactly 0 at 90°, so that such a direction counts as not above the horizon.
pub fn direction(theta_deg: Real, phi_deg: Real) -> Vec3 {
    let (sin_theta, cos_theta) = theta_deg.to_radians().sin_cos();
    let (sin_phi, cos_phi) = phi_deg.to_radians().sin_cos();
    let z = if theta_deg == 90.0 { 0.0 } else { cos_theta };
    Vec3::new(sin_theta * cos_phi, sin_theta * sin_phi, z)
}

/// The plastic number, the root of x³ = x + 1.
const PLASTIC: f64 = 1.324_717_957_244_746;
/// Steps of the R2 sequence (Roberts 2018, *The Unreasonable Effectiveness of Quasirandom Sequences*).
const R2: [f64; 2] = [1.0 / PLASTIC, 1.0 / (PLASTIC * PLASTIC)];

/// `v` in `[0, 1)` and `shift` added on the torus. A sum of 1 or more in the target's precision wraps to a number below 1.
fn on_torus(v: f64, shift: Real) -> Real {
    let v = v as Real + shift;
    v - v.floor()
}

/// Point `index` of the R2 sequence, shifted on the torus: low discrepancy, no tables.
pub fn shifted_r2(index: u64, shift: [Real; 2]) -> [Real; 2] {
    [0, 1].map(|c: usize| on_torus((0.5 + (index + 1) as f64 * R2[c]).fract(), shift[c]))
}

/// Point `index` of the R2 sequence that begins at `first`, which is point 0.
pub fn r2_from(first: [Real; 2], index: u32) -> [Real; 2] {
    [0, 1].map(|c: usize| on_torus((f64::from(index) * R2[c]).fract(), first[c]))
}
