//! Reference layered material: a rough dielectric over a homogeneous slab over a diffuse base.
//!
//! Source: Guo, Hašan and Zhao 2018, *Position-Free Monte Carlo Simulation for Arbitrary Layered BSDFs*, with the
//! interface of Walter et al. 2007 under separable masking. The interface mirrors or refracts once a visit, so light
//! that a facet sends to the wrong side is lost: a white slab under a rough interface is darker than 1, which is the
//! model and not an error. Deviations from Guo et al. in how it is estimated: see `eval.rs`.

mod eval;
mod field;
mod interface;
mod link;
mod phase;
mod slice;
mod walk;

pub use slice::LayeredSlice;

use crate::bsdf::{Bsdf, BsdfSample, Slice, usable};
use crate::concentric::square_to_hemisphere;
use crate::error::{Result, check};
use crate::fresnel::dielectric;
use crate::microfacet::{mirror_pdf, sample_mirror};
use crate::random::Rng;
use crate::real::consts::FRAC_1_PI;
use crate::real::{Real, Vec3};
use interface::Interface;
use walk::{Dye, Segment};

/// Smallest probability of either lobe of [`Bsdf::propose`], while it has light at all: its weights stay bounded
/// where the estimate of its energy is poor.
const LOBE_MIN: Real = 0.05;

/// A layered material with its parameters bound.
#[derive(Clone, Debug, PartialEq)]
pub struct Layered {
    alpha: Real,
    eta: Real,
    sigma_t: Real,
    albedo: Vec3,
    base: Vec3,
    g: Real,
    /// Estimated share of entering light that leaves again, for the choice of lobes alone.
    body: Real,
}

impl Layered {
    /// Smallest roughness of the interface.
    pub const ALPHA_MIN: Real = 1e-4;
    /// Smallest relative index of refraction.
    pub const ETA_MIN: Real = 0.5;
    /// Largest relative index of refraction.
    pub const ETA_MAX: Real = 4.0;
    /// Largest optical depth: the mean walk through a white slab scatters about four times as often.
    pub const SIGMA_T_MAX: Real = 100.0;
    /// Largest |g|.
    pub const G_MAX: Real = 0.99;

    /// Checks and binds the parameters.
    ///
    /// `alpha`: GGX roughness of the interface; `eta`: index of refraction of the slab over that of the air, where 1
    /// means that there is no interface; `sigma_t`: vertical optical depth of the slab; `albedo`: single-scattering
    /// albedo of its medium, RGB; `base`: reflectance of the diffuse base, RGB; `g`: mean cosine of the
    /// Henyey–Greenstein phase function, 0 for isotropic scattering.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] naming the first parameter that is out of range or not a number: `alpha` in
    /// `[ALPHA_MIN, 1]`, `eta` in `[ETA_MIN, ETA_MAX]`, `sigma_t` in `[0, SIGMA_T_MAX]`, `albedo[i]` and `base[i]` in
    /// `[0, 1]`, `g` in `[-G_MAX, G_MAX]`.
    pub fn new(
        alpha: Real,
        eta: Real,
        sigma_t: Real,
        albedo: [Real; 3],
        base: [Real; 3],
        g: Real,
    ) -> Result<Layered> {
        check("alpha", &[alpha], Self::ALPHA_MIN, 1.0)?;
        check("eta", &[eta], Self::ETA_MIN, Self::ETA_MAX)?;
        check("sigma_t", &[sigma_t], 0.0, Self::SIGMA_T_MAX)?;
        check("albedo", &albedo, 0.0, 1.0)?;
        check("base", &base, 0.0, 1.0)?;
        check("g", &[g], -Self::G_MAX, Self::G_MAX)?;
        let (albedo, base) = (Vec3::from_array(albedo), Vec3::from_array(base));
        Ok(Layered {
            alpha,
            eta,
            sigma_t,
            albedo,
            base,
            g,
            body: body_share(
                eta,
                sigma_t,
                albedo.element_sum() / 3.0,
                base.element_sum() / 3.0,
                g,
            ),
        })
    }

    /// Reflectance of the base, RGB.
    pub fn base(&self) -> Vec3 {
        self.base
    }

    fn interface(&self) -> Interface {
        Interface {
            alpha: self.alpha,
            eta: self.eta,
        }
    }

    fn dye(&self) -> Dye {
        Dye {
            albedo: self.albedo,
            base: self.base,
        }
    }

    /// Analytic reflection off the interface: `f_cos`, sr⁻¹, the same in all channels.
    ///
    /// F·D·G1(wo)·G1(wi) / (4 cos θ_o) (Walter et al. 2007, Eq. 20). Zero unless both directions are above the
    /// horizon.
    pub fn reflection(&self, wo: Vec3, wi: Vec3) -> Real {
        if !usable(wo) || !usable(wi) || self.interface().is_absent() {
            return 0.0;
        }
        self.interface().reflection(wo, wi)
    }

    /// Probability with which [`Bsdf::propose`] mirrors: the expected energy of the reflection over that of all light.
    fn mirror_probability(&self, wo: Vec3) -> Real {
        if self.interface().is_absent() {
            return 0.0;
        }
        let mirrored = dielectric(wo.z, self.eta).reflectance;
        let body = (1.0 - mirrored) * self.body;
        if body > 0.0 {
            (mirrored / (mirrored + body)).clamp(LOBE_MIN, 1.0 - LOBE_MIN)
        } else if self.body > 0.0 {
            1.0 - LOBE_MIN
        } else {
            1.0
        }
    }
}

/// Estimated share of light entering a slab that leaves it again, in `[0, 1]`; 0 only where nothing can.
///
/// Slab and base reflect about base·T² + (1 − T²)·R∞, with T the diffuse transmission e^(−3τ'/2) and R∞ of a half-space
/// by van de Hulst's fit (van de Hulst 1980, *Multiple Light Scattering*, §14.1); the interface then returns a part Fi of
/// that again and again, by Egan and Hilgeman's fit (Egan and Hilgeman 1979, *Optical Properties of Inhomogeneous Materials*).
fn body_share(eta: Real, sigma_t: Real, albedo: Real, base: Real, g: Real) -> Real {
    let similarity = ((1.0 - albedo) / (1.0 - albedo * g)).sqrt();
    let half_space = (1.0 - similarity) * (1.0 - 0.139 * similarity) / (1.0 + 1.17 * similarity);
    let transmission = (-3.0 * sigma_t * (1.0 - albedo * g)).exp();
    let inside = base * transmission + (1.0 - transmission) * half_space;
    let returned = match eta {
        1.0 => 0.0,
        e if e > 1.0 => -1.440 / (e * e) + 0.710 / e + 0.668 + 0.0636 * e,
        e => -0.4399 + 0.7099 / e - 0.3319 / (e * e) + 0.0636 / (e * e * e),
    };
    let returned = returned.clamp(0.0, 1.0);
    // All light that is not absorbed leaves: with no absorption 1, without the interface `inside`.
    (inside * (1.0 - returned) / (1.0 - returned * inside).max(Real::EPSILON)).clamp(0.0, 1.0)
}

impl Bsdf for Layered {
    /// The reflection off the interface exactly, and [`Layered::body`] for the rest.
    fn eval(&self, wo: Vec3, wi: Vec3, rng: &mut Rng) -> Vec3 {
        let [top, body] = self.eval_lobes(wo, wi, rng);
        top + body
    }

    fn eval_lobes(&self, wo: Vec3, wi: Vec3, rng: &mut Rng) -> [Vec3; 2] {
        [Vec3::splat(self.reflection(wo, wi)), self.body(wo, wi, rng)]
    }

    /// One walk forward: its weight is at most 1.
    fn sample(&self, wo: Vec3, u: [Real; 2], rng: &mut Rng) -> Option<BsdfSample> {
        if !usable(wo) {
            return None;
        }
        let interface = self.interface();
        let facet = interface.facet(wo, u);
        if rng.uniform() < facet.reflectance() {
            let mirrored = interface.mirror(&facet)?;
            return Some(BsdfSample {
                wi: mirrored.direction,
                weight: Vec3::splat(mirrored.masking),
            });
        }
        let entered = interface.refract(&facet)?;
        self.walk_out(Segment::start(entered.direction, Vec3::ONE), entered.masking, rng)
    }

    /// A mixture of [`mirror_pdf`] and of the cosine, for light off the interface and out of the slab.
    fn pdf(&self, wo: Vec3, wi: Vec3) -> Real {
        if !usable(wo) || !usable(wi) {
            return 0.0;
        }
        let mirror = self.mirror_probability(wo);
        let mirrored = if mirror > 0.0 {
            mirror * mirror_pdf(wo, wi, [self.alpha; 2])
        } else {
            0.0
        };
        mirrored + (1.0 - mirror) * wi.z * FRAC_1_PI
    }

    fn propose(&self, wo: Vec3, u: [Real; 2]) -> Option<Vec3> {
        if !usable(wo) {
            return None;
        }
        let mirror = self.mirror_probability(wo);
        if u[0] < mirror {
            return sample_mirror(wo, [self.alpha; 2], [u[0] / mirror, u[1]]);
        }
        let u = [(u[0] - mirror) / (1.0 - mirror), u[1]];
        let [x, y, z] = square_to_hemisphere(u, u.map(|v| 1.0 - v));
        Some(Vec3::new(x, y, z.max(Real::MIN_POSITIVE)))
    }

    fn is_stochastic(&self) -> bool {
        true
    }

    fn slice(&self, wo: Vec3, walks: usize, seed: u64) -> Box<dyn Slice + '_> {
        Box::new(LayeredSlice::new(self, wo, walks, seed))
    }
}
