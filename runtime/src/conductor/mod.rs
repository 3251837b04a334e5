//! Reference conductor: multiple-scattering anisotropic Smith GGX with Schlick reflectance per colour and bounce.
//!
//! Source: Heitz et al. 2016, *Multiple-Scattering Microfacet BSDFs with the Smith Model*. Deviation: `pdf` is a
//! normalised density (see [`Conductor::sample_vndf`]), not the sum of a single-scattering and a cosine term.

mod eval;
mod microsurface;
mod walk;

pub use walk::Vertex;

use crate::bsdf::{Bsdf, BsdfSample};
use crate::error::{Error, Result};
use crate::random::Rng;
use glam::DVec3;
use microsurface::{HalfVector, Stretched, schlick};

/// Multiple-scattering Smith GGX conductor with its parameters bound.
#[derive(Clone, Debug, PartialEq)]
pub struct Conductor {
    /// Roughness along x and y of the shading frame, in `[ALPHA_MIN, 1]`.
    pub alpha: [f64; 2],
    /// Schlick reflectance at normal incidence (F0), RGB, in `[0, 1]`.
    pub reflectance: DVec3,
}

/// Whether the unit vector `w` is finite and above the horizon.
#[inline]
fn above_horizon(w: DVec3) -> bool {
    w.is_finite() && w.z > 0.0
}

impl Conductor {
    /// Smallest roughness; below it a surface is a mirror for every purpose of this crate.
    pub const ALPHA_MIN: f64 = 1e-4;

    /// Checks and binds the parameters.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the first of `alpha[i]`, in `[ALPHA_MIN, 1]`, or `reflectance[i]`, in
    /// `[0, 1]`, that is out of range or not a number.
    pub fn new(alpha: [f64; 2], reflectance: [f64; 3]) -> Result<Conductor> {
        check("alpha", &alpha, Self::ALPHA_MIN)?;
        check("reflectance", &reflectance, 0.0)?;
        Ok(Conductor {
            alpha,
            reflectance: DVec3::from_array(reflectance),
        })
    }

    /// Analytic single scattering: `f_cos`, RGB, sr⁻¹.
    ///
    /// F·D·G2 / (4 cos θ_o) with the height-correlated G2 = 1/(1 + Λ_o + Λ_i) (Heitz 2014, *Understanding the
    /// Masking-Shadowing Function in Microfacet-Based BRDFs*, Eq. 99), written without the Λ so that it stays
    /// finite at the horizon. Zero unless both directions are above it.
    #[inline]
    pub fn single(&self, wo: DVec3, wi: DVec3) -> DVec3 {
        if !above_horizon(wo) || !above_horizon(wi) {
            return DVec3::ZERO;
        }
        let half = HalfVector::new(wo, wi, self.alpha);
        let length = |w: DVec3| Stretched::new(w, self.alpha).length();
        let masking = wi.z / (2.0 * (length(wo) * wi.z + length(wi) * wo.z));
        schlick(self.reflectance, half.cos) * (half.density * masking)
    }

    /// Draws `wi` by mirroring `wo` at a visible normal; a direction below the horizon is mirrored up.
    ///
    /// `u` in `[0,1)²`. The density of `wi` is exactly [`Bsdf::pdf`]. `None` when `wo` is not above the horizon.
    #[inline]
    pub fn sample_vndf(&self, wo: DVec3, u: [f64; 2]) -> Option<DVec3> {
        if !above_horizon(wo) {
            return None;
        }
        let eye = Stretched::new(wo, self.alpha);
        let (wi, _) = eye.mirror(eye.visible_normal(self.alpha, u));
        Some(wi.with_z(wi.z.abs().max(f64::MIN_POSITIVE)))
    }
}

/// Checks that every element of the parameter `name` lies in `lowest..=1`.
fn check(name: &str, values: &[f64], lowest: f64) -> Result<()> {
    match values.iter().position(|v| !(lowest..=1.0).contains(v)) {
        Some(i) => Err(Error::parameter(
            format!("{name}[{i}]"),
            format!("is {}, but must lie in {lowest}..1", values[i]),
        )),
        None => Ok(()),
    }
}

impl Bsdf for Conductor {
    /// Single scattering exactly, and [`Conductor::multiple`] for the rest.
    fn eval(&self, wo: DVec3, wi: DVec3, rng: &mut Rng) -> DVec3 {
        self.single(wo, wi) + self.multiple(wo, wi, rng)
    }

    /// One walk: its weight is at most 1.
    fn sample(&self, wo: DVec3, u: [f64; 2], rng: &mut Rng) -> Option<BsdfSample> {
        self.walk(wo, u, rng, |_| ())
    }

    /// Density of [`Conductor::sample_vndf`], sr⁻¹: that of mirroring at a visible normal, D(h)/(4 σ(wo)), at `wi`
    /// and at its image below the horizon. It integrates to exactly 1 over the hemisphere.
    fn pdf(&self, wo: DVec3, wi: DVec3) -> f64 {
        if !above_horizon(wo) || !above_horizon(wi) {
            return 0.0;
        }
        let density = |w: DVec3| HalfVector::new(wo, w, self.alpha).density;
        let area = Stretched::new(wo, self.alpha).projected_area();
        (density(wi) + density(wi.with_z(-wi.z))) / (4.0 * area)
    }
}
