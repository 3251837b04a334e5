//! Reference conductor: multiple-scattering anisotropic Smith GGX, its Fresnel term per colour and bounce.
//!
//! Source: Heitz et al. 2016, *Multiple-Scattering Microfacet BSDFs with the Smith Model*. Deviation: `pdf` is a
//! normalised density (see [`crate::microfacet::mirror_pdf`]), not the sum of a single-scattering and a cosine term.

mod compensated;
mod eval;
mod scattering;
mod slice;
mod walk;

pub use compensated::CompensatedConductor;
pub use slice::ConductorSlice;
pub use walk::Vertex;

use crate::bsdf::{Bsdf, BsdfSample, Slice, usable};
use crate::error::{Result, check};
use crate::fresnel::MetalFresnel;
use crate::microfacet::{HalfVector, Stretched, mirror_pdf, sample_mirror};
use crate::random::Rng;
use crate::real::{Real, Vec3};

/// Multiple-scattering Smith GGX conductor with its parameters bound.
#[derive(Clone, Debug, PartialEq)]
pub struct Conductor {
    /// Roughness along x and y of the shading frame, in `[ALPHA_MIN, 1]`.
    pub alpha: [Real; 2],
    /// How much a facet mirrors.
    pub fresnel: MetalFresnel,
}

impl Conductor {
    /// Smallest roughness; below it a surface is a mirror for every purpose of this crate.
    pub const ALPHA_MIN: Real = 1e-4;

    /// Largest index of refraction and extinction coefficient that is accepted; metals stay below 10 in visible light.
    pub const IOR_MAX: Real = 100.0;

    /// Smallest index of refraction that is accepted.
    pub const IOR_MIN: Real = 1e-3;

    /// Checks and binds roughness and Schlick reflectance (F0, RGB).
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] naming the first of `alpha[i]`, in `[ALPHA_MIN, 1]`, or `reflectance[i]`, in
    /// `[0, 1]`, that is out of range or not a number.
    pub fn new(alpha: [Real; 2], reflectance: [Real; 3]) -> Result<Conductor> {
        check("alpha", &alpha, Self::ALPHA_MIN, 1.0)?;
        check("reflectance", &reflectance, 0.0, 1.0)?;
        Ok(Conductor {
            alpha,
            fresnel: MetalFresnel::Schlick(Vec3::from_array(reflectance)),
        })
    }

    /// Checks and binds roughness and the complex index of refraction `eta` + i·`k`, RGB.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] naming the first of `alpha[i]`, in `[ALPHA_MIN, 1]`, `ior.eta[i]`, in
    /// `[IOR_MIN, IOR_MAX]`, or `ior.k[i]`, in `[0, IOR_MAX]`, that is out of range or not a number.
    pub fn with_ior(alpha: [Real; 2], eta: [Real; 3], k: [Real; 3]) -> Result<Conductor> {
        check("alpha", &alpha, Self::ALPHA_MIN, 1.0)?;
        check("ior.eta", &eta, Self::IOR_MIN, Self::IOR_MAX)?;
        check("ior.k", &k, 0.0, Self::IOR_MAX)?;
        Ok(Conductor {
            alpha,
            fresnel: MetalFresnel::Complex {
                eta: Vec3::from_array(eta),
                k: Vec3::from_array(k),
            },
        })
    }

    /// The same surface mirroring all light.
    pub fn white(&self) -> Conductor {
        Conductor {
            fresnel: MetalFresnel::Schlick(Vec3::ONE),
            ..self.clone()
        }
    }

    /// Analytic single scattering: `f_cos`, RGB, sr⁻¹.
    ///
    /// F·D·G2 / (4 cos θ_o) with the height-correlated G2 = 1/(1 + Λ_o + Λ_i) (Heitz 2014, *Understanding the
    /// Masking-Shadowing Function in Microfacet-Based BRDFs*, Eq. 99), written without the Λ so that it stays
    /// finite at the horizon. Zero unless both directions are above it.
    #[inline]
    pub fn single(&self, wo: Vec3, wi: Vec3) -> Vec3 {
        if !usable(wo) || !usable(wi) {
            return Vec3::ZERO;
        }
        let half = HalfVector::new(wo, wi, self.alpha);
        let length = |w: Vec3| Stretched::new(w, self.alpha).length();
        let masking = wi.z / (2.0 * (length(wo) * wi.z + length(wi) * wo.z));
        self.fresnel.at(half.cos) * (half.density * masking)
    }
}

impl Bsdf for Conductor {
    /// Single scattering exactly, and [`Conductor::multiple`] for the rest.
    fn eval(&self, wo: Vec3, wi: Vec3, rng: &mut Rng) -> Vec3 {
        let [single, multiple] = self.eval_lobes(wo, wi, rng);
        single + multiple
    }

    fn eval_lobes(&self, wo: Vec3, wi: Vec3, rng: &mut Rng) -> [Vec3; 2] {
        [self.single(wo, wi), self.multiple(wo, wi, rng)]
    }

    /// One walk: its weight is at most 1.
    fn sample(&self, wo: Vec3, u: [Real; 2], rng: &mut Rng) -> Option<BsdfSample> {
        self.walk(wo, u, rng, |_| ())
    }

    /// The baseline sampler's density, [`mirror_pdf`]: visible normals of the single scattering, renormalised.
    fn pdf(&self, wo: Vec3, wi: Vec3) -> Real {
        mirror_pdf(wo, wi, self.alpha)
    }

    /// Mirrors `wo` at a visible normal: [`sample_mirror`].
    fn propose(&self, wo: Vec3, u: [Real; 2]) -> Option<Vec3> {
        sample_mirror(wo, self.alpha, u)
    }

    fn is_stochastic(&self) -> bool {
        true
    }

    fn slice(&self, wo: Vec3, walks: usize, seed: u64) -> Box<dyn Slice + '_> {
        Box::new(ConductorSlice::new(self, wo, walks, seed))
    }
}
