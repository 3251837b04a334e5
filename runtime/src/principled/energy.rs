//! How much light each lobe of the sampler should carry: estimates of directional albedos, in closed form.
//!
//! They only set the probabilities of lobes, so that an error costs variance and nothing else: a probability of ½
//! that is wrong by a tenth adds a hundredth to the relative variance. The albedo of the diffuse base is exact
//! (moments of (1 − cos θ)⁵ under a cosine lobe); the other constants were fitted by least squares, in relative
//! error, to albedos integrated over the whole domain. The tests below say how close they are.

use super::{LUMINANCE, Principled};
use crate::fresnel::schlick_weight;
use crate::microfacet::Stretched;
use crate::real::consts::PI;
use crate::real::{Real, Vec3};

/// Means of (1 − cos θ)⁵, and of its products with cos θ and cos² θ, under a cosine lobe.
const GRAZING_MOMENTS: [Real; 3] = [1.0 / 21.0, 1.0 / 84.0, 1.0 / 252.0];

/// Largest share of a rough specular lobe that the cosine lobe samples.
const SPREAD_MAX: Real = 0.87;

/// Expected luminance that each lobe of the sampler carries from one `wo`, dimensionless.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Energies {
    /// What resembles a cosine lobe: most of the base, and the main specular lobe as far as it is rough.
    pub cosine: Real,
    /// What is nearer to uniform: sheen, and subsurface scattering at grazing angles.
    pub uniform: Real,
    /// The rest of the main specular lobe.
    pub specular: Real,
    /// The clearcoat.
    pub coat: Real,
}

impl Energies {
    /// The lobes of `bsdf` seen from `wo`, which is above the horizon.
    #[inline]
    pub fn new(bsdf: &Principled, wo: Vec3) -> Energies {
        let [cosine, uniform] = base(bsdf, wo.z);
        let [spread, specular] = specular(bsdf, wo);
        Energies {
            cosine: cosine + spread,
            uniform,
            specular,
            coat: coat(bsdf, wo.z),
        }
    }
}

/// Share of the main specular lobe at normal reflectance that a cosine lobe samples better than visible normals do.
///
/// Mirrored at a very rough surface, light nearly fills the hemisphere, and masking (which visible normals of `wo`
/// do not know) shapes it like a cosine: at roughness 1 a cosine lobe leaves a fiftieth of the variance. Chosen by
/// minimising the variance at angles and roughnesses of all kinds; the smaller roughness, `alpha[1]`, counts more.
pub(super) fn spread(alpha: [Real; 2]) -> Real {
    let rough = (alpha[1] * (alpha[0] * alpha[1]).sqrt()).sqrt();
    ((rough - 0.3) / 0.6).clamp(0.0, SPREAD_MAX)
}

/// Diffuse base or its subsurface approximation, and sheen, apart into a cosine and a uniform part; `cos` of `wo`.
#[inline]
fn base(bsdf: &Principled, cos: Real) -> [Real; 2] {
    let p = &bsdf.parameters;
    if p.metallic == 1.0 {
        return [0.0; 2];
    }
    let diffuse = PI * LUMINANCE.dot(bsdf.diffuse);
    let o = schlick_weight(cos);
    // R = roughness·(1 + wo·wi): its mean, and the means of R·i and R²·i with i = (1 − cos θ_i)⁵.
    let mean = p.roughness * (1.0 + 2.0 / 3.0 * cos);
    let [w0, w1, w2] = GRAZING_MOMENTS;
    let first = p.roughness * (w0 + cos * w1);
    let across = 0.5 * (1.0 - cos * cos) * (w0 - w2);
    let second = p.roughness * p.roughness * (w0 + cos * (2.0 * w1 + cos * w2) + across);
    let retro = o * mean + first + o * (second - first);
    let lambert = (1.0 - 0.5 * o) * (1.0 - 0.5 * w0);
    let mut parts = [diffuse * (1.0 - p.flatness) * (lambert + retro), 0.0];
    if p.flatness > 0.0 {
        // The flattening at its mean, and the mean of 1/(cos θ_i + cos θ_o) under a cosine lobe.
        let flattened = 1.0 + (0.5 * mean - 1.0) * o;
        let share = flattened * (2.0 - 2.0 * cos * ((1.0 + cos).ln() - cos.ln()));
        // Its product with cos θ_i is constant at grazing `wo`, and tends to a cosine at normal `wo`.
        let uniform = share / (1.0 + 3.0 * cos);
        let scale = 1.25 * diffuse * p.flatness;
        parts[0] += scale * (share - uniform + 0.5 * (1.0 - flattened));
        parts[1] += scale * uniform;
    }
    if p.sheen > 0.0 {
        // Never zero, so that the mirrored lobes are not left to sample a faint sheen.
        let m = (1.0 - cos).max(0.0);
        parts[1] += LUMINANCE.dot(bsdf.sheen) * (2.6e-4 + m * (0.0118 + 0.0777 * m * m));
    }
    parts
}

/// Main specular lobe, apart into what is spread and what is not: its albedo without Fresnel term, times that term
/// at a typical facet.
#[inline]
fn specular(bsdf: &Principled, wo: Vec3) -> [Real; 2] {
    let Some(fresnel) = &bsdf.fresnel else {
        return [0.0; 2];
    };
    let [x, y] = bsdf.alpha;
    let alpha2 = x * x + y * y;
    let masked = 1.0 - wo.z / Stretched::new(wo, bsdf.alpha).projected_area();
    let albedo = 1.0 / (1.0 + 0.957 * alpha2 + masked * (0.1425 - 0.768 * alpha2));
    // The roughness along wo turns typical facets away from grazing and from normal incidence.
    let (x2, y2) = (wo.x * wo.x, wo.y * wo.y);
    let across2 = x2 + y2;
    let [rough_x, rough_y] = bsdf.facet_turn;
    let rough = if across2 > 0.0 {
        (rough_x * x2 + rough_y * y2) / across2
    } else {
        rough_x
    };
    let cos = wo.z + rough * (0.252 + 0.666 * rough - 1.025 * wo.z);
    let typical = LUMINANCE.dot(fresnel.at(cos.clamp(0.0, 1.0)));
    [albedo * bsdf.spread, albedo * (typical - bsdf.spread).max(0.0)]
}

/// Clearcoat; `cos` of `wo`.
#[inline]
fn coat(bsdf: &Principled, cos: Real) -> Real {
    let p = &bsdf.parameters;
    let m = 1.0 - cos;
    p.clearcoat * cos * (0.0112 + 0.05 * m * m + (0.0143 + 0.0081 * p.clearcoat_gloss) * cos * cos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::Bsdf;
    use crate::principled::PrincipledParameters;
    use crate::random::Rng;

    /// An albedo so small that its error hardly counts: the errors below are relative to the albedo plus this.
    const FAINT: Real = 0.01;

    /// Largest error over the domain up to 89°, and its root mean square, a quarter above those measured.
    const BASE_TOL: [Real; 2] = [0.08, 0.022];
    const METAL_TOL: [Real; 2] = [0.3, 0.038];
    const DIELECTRIC_TOL: [Real; 2] = [0.56, 0.09];
    const COAT_TOL: [Real; 2] = [0.15, 0.025];

    /// Compares estimate and albedo of random surfaces whose other lobes `alone` has switched off.
    fn compare(name: &str, tolerance: [Real; 2], alone: impl Fn(&mut PrincipledParameters)) {
        const SURFACES: u32 = 1000;
        const SAMPLES: u64 = 4096;
        let mut rng = Rng::new(&[0xe4e]);
        let (mut worst, mut square) = (0.0 as Real, 0.0);
        for _ in 0..SURFACES {
            let mut value = || rng.uniform();
            let mut parameters = PrincipledParameters {
                base_color: Vec3::new(value(), value(), value()),
                metallic: value(),
                roughness: value(),
                specular: value(),
                specular_tint: value(),
                anisotropic: value(),
                sheen: value(),
                sheen_tint: value(),
                clearcoat: value(),
                clearcoat_gloss: value(),
                flatness: value(),
            };
            alone(&mut parameters);
            let (theta, phi) = (value() * (89.0 as Real).to_radians(), value() * PI);
            let wo = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            let bsdf = Principled::new(parameters).expect("valid parameters");
            let e = Energies::new(&bsdf, wo);
            let estimate = e.cosine + e.uniform + e.specular + e.coat;
            let albedo = LUMINANCE.dot(bsdf.albedo(wo, SAMPLES, 0).mean);
            let error = (estimate - albedo) / (albedo + FAINT);
            worst = worst.max(error.abs());
            square += error * error / SURFACES as Real;
        }
        let found = [worst, square.sqrt()];
        assert!(
            found[0] < tolerance[0] && found[1] < tolerance[1],
            "{name}: {found:?}, allowed {tolerance:?}"
        );
    }

    #[test]
    fn estimates_are_close_to_albedos() {
        compare("base", BASE_TOL, |p| {
            (p.specular, p.clearcoat) = (0.0, 0.0);
        });
        compare("metal", METAL_TOL, |p| {
            (p.metallic, p.clearcoat) = (1.0, 0.0);
        });
        compare("dielectric", DIELECTRIC_TOL, |p| {
            (p.metallic, p.sheen, p.clearcoat) = (0.0, 0.0, 0.0);
            p.base_color = Vec3::ZERO;
        });
        compare("coat", COAT_TOL, |p| {
            (p.metallic, p.specular, p.clearcoat) = (1.0, 0.0, 1.0);
        });
    }
}
