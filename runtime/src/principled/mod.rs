//! Reference principled BRDF: the Disney BRDF as Mitsuba 3.9.1 evaluates it, reflection only.
//!
//! Sources: Burley 2012, *Physically-Based Shading at Disney*; Burley 2015, *Extending the Disney BRDF to a BSDF with
//! Integrated Subsurface Scattering* (its Fresnel term and flatness); for every detail in which they leave a
//! choice, the `principled` plugin of Mitsuba 3.9.1 without transmission, seen from its front.

mod energy;
mod gtr1;
mod lobes;
mod sampling;
mod slice;

use crate::bsdf::{Bsdf, BsdfSample, Slice};
use crate::error::{Result, check};
use crate::random::Rng;
use crate::real::consts::FRAC_1_PI;
use crate::real::{Real, Vec3};
use gtr1::Gtr1;
use lobes::Fresnel;
use sampling::Mixture;
use slice::PrincipledSlice;

/// Weights of linear RGB in the luminance of Rec. 709, with Mitsuba's digits.
const LUMINANCE: Vec3 = Vec3::new(0.212671, 0.715160, 0.072169);

/// Roughness of the clearcoat without gloss and with full gloss.
const CLEARCOAT_ALPHA: [Real; 2] = [0.1, 0.001];

/// The parameters of the principled BRDF, each in `[0, 1]`; `default()` holds Mitsuba's values for what is omitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipledParameters {
    /// Colour of the surface, linear RGB.
    pub base_color: Vec3,
    /// From a dielectric over a diffuse base to a metal tinted with the base colour.
    pub metallic: Real,
    /// Square root of the roughness of the main specular lobe; also how much light the base sends back.
    pub roughness: Real,
    /// Reflectance of the dielectric at normal incidence, over 0.08.
    ///
    /// At exactly 0 nothing is mirrored at all, not even by a metal: see [`Principled`].
    pub specular: Real,
    /// How much the dielectric's reflectance takes the hue of the base colour; Mitsuba's `spec_tint`.
    pub specular_tint: Real,
    /// Roughness along x over roughness along y is 1 / (1 − 0.9·`anisotropic`).
    pub anisotropic: Real,
    /// Strength of the sheen at grazing angles, as of cloth.
    pub sheen: Real,
    /// How much the sheen takes the hue of the base colour.
    pub sheen_tint: Real,
    /// Strength of the clearcoat.
    pub clearcoat: Real,
    /// From a clearcoat of roughness 0.1 to one of roughness 0.001.
    pub clearcoat_gloss: Real,
    /// From the diffuse base to an approximation of subsurface scattering.
    pub flatness: Real,
}

impl Default for PrincipledParameters {
    fn default() -> Self {
        PrincipledParameters {
            base_color: Vec3::splat(0.5),
            metallic: 0.0,
            roughness: 0.5,
            specular: 0.5,
            specular_tint: 0.0,
            anisotropic: 0.0,
            sheen: 0.0,
            sheen_tint: 0.0,
            clearcoat: 0.0,
            clearcoat_gloss: 0.0,
            flatness: 0.0,
        }
    }
}

impl PrincipledParameters {
    /// Checks that every parameter lies in `[0, 1]`.
    fn check(&self) -> Result<()> {
        check("base_color", &self.base_color.to_array(), 0.0, 1.0)?;
        let scalars = [
            ("metallic", self.metallic),
            ("roughness", self.roughness),
            ("specular", self.specular),
            ("specular_tint", self.specular_tint),
            ("anisotropic", self.anisotropic),
            ("sheen", self.sheen),
            ("sheen_tint", self.sheen_tint),
            ("clearcoat", self.clearcoat),
            ("clearcoat_gloss", self.clearcoat_gloss),
            ("flatness", self.flatness),
        ];
        scalars
            .into_iter()
            .try_for_each(|(name, value)| check(name, &[value], 0.0, 1.0))
    }
}

/// The principled BRDF with its parameters bound.
///
/// It is reciprocal, but does not conserve energy: seen from 86.5°, a white surface with sheen, clearcoat and
/// flatness sends back 1.85 of the light, and seen along the surface, a saturated blue with all tints 3.48 of the blue
/// light (the largest albedos that searches of the domain found; tested).
///
/// With `specular` = 0 the index of refraction is 1, and Mitsuba drops the whole main specular lobe where the exact
/// Fresnel term is zero, that of metals included. So do we, although it makes the limit `specular` → 0 of metals and
/// tinted dielectrics differ from the value there. (Mitsuba takes 0.001 for 0 only when the parameter is changed
/// after the scene was loaded.)
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Principled {
    parameters: PrincipledParameters,
    /// Roughness of the main specular lobe along x and y.
    alpha: [Real; 2],
    /// Its Fresnel term; `None` where it mirrors nothing.
    fresnel: Option<Fresnel>,
    /// How far typical facets turn towards `wo`, 0 to 1, for a `wo` over x and over y; see [`energy`].
    facet_turn: [Real; 2],
    /// Luminance of what the sampler leaves of it to the cosine lobe, over its albedo without Fresnel term.
    spread: Real,
    /// (1 − `metallic`)·`base_color` / π, sr⁻¹.
    diffuse: Vec3,
    /// Sheen where light and camera graze the surface from opposite sides, RGB, sr⁻¹.
    sheen: Vec3,
    /// Normals of the clearcoat.
    gtr1: Gtr1,
}

impl Principled {
    /// Smallest roughness of the main specular lobe.
    pub const ALPHA_MIN: Real = 1e-3;

    /// Checks and binds the parameters.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] naming the first that is not in `[0, 1]` or not a number.
    pub fn new(parameters: PrincipledParameters) -> Result<Principled> {
        parameters.check()?;
        let p = &parameters;
        let luminance = LUMINANCE.dot(p.base_color);
        let tint = if luminance > 0.0 {
            p.base_color / luminance
        } else {
            Vec3::ONE
        };
        let aspect = (1.0 - 0.9 * p.anisotropic).sqrt();
        let roughness2 = p.roughness * p.roughness;
        let dielectric = 1.0 - p.metallic;
        let alpha = [roughness2 / aspect, roughness2 * aspect].map(|a| a.max(Self::ALPHA_MIN));
        let fresnel = (p.specular > 0.0).then(|| Fresnel::new(p, tint));
        let normal = fresnel.map_or(0.0, |f| LUMINANCE.dot(f.at(1.0)));
        let [rough, glossy] = CLEARCOAT_ALPHA;
        Ok(Principled {
            alpha,
            fresnel,
            facet_turn: alpha.map(|a| (a / (1.0 + a)).sqrt()),
            spread: normal * energy::spread(alpha),
            diffuse: p.base_color * (dielectric * FRAC_1_PI),
            sheen: Vec3::ONE.lerp(tint, p.sheen_tint) * (dielectric * p.sheen),
            gtr1: Gtr1::new(rough + (glossy - rough) * p.clearcoat_gloss),
            parameters,
        })
    }

    /// The parameters it was bound to.
    pub fn parameters(&self) -> &PrincipledParameters {
        &self.parameters
    }
}

impl Bsdf for Principled {
    /// Draws nothing from `rng`.
    fn eval(&self, wo: Vec3, wi: Vec3, _rng: &mut Rng) -> Vec3 {
        self.f_cos(wo, wi)
    }

    fn eval_lobes(&self, wo: Vec3, wi: Vec3, _rng: &mut Rng) -> [Vec3; 2] {
        let slice = PrincipledSlice::new(self, wo);
        [slice.sharp(wi), slice.smooth(wi)]
    }

    /// [`Principled::propose`] and `f_cos / pdf`; draws nothing from `rng`.
    fn sample(&self, wo: Vec3, u: [Real; 2], _rng: &mut Rng) -> Option<BsdfSample> {
        let mixture = Mixture::new(self, wo)?;
        let wi = mixture.propose(u);
        let weight = self.f_cos(wo, wi) / mixture.pdf(wi);
        Some(BsdfSample { wi, weight })
    }

    /// The exact density of [`Principled::propose`]'s mixture of lobes.
    fn pdf(&self, wo: Vec3, wi: Vec3) -> Real {
        Mixture::new(self, wo).map_or(0.0, |mixture| mixture.pdf(wi))
    }

    /// Draws from one of four lobes, chosen by the light that each is expected to carry.
    fn propose(&self, wo: Vec3, u: [Real; 2]) -> Option<Vec3> {
        Some(Mixture::new(self, wo)?.propose(u))
    }

    fn is_stochastic(&self) -> bool {
        false
    }

    fn slice(&self, wo: Vec3, _walks: usize, _seed: u64) -> Box<dyn Slice + '_> {
        Box::new(PrincipledSlice::new(self, wo))
    }
}
