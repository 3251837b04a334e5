//! Integrals over the hemisphere of functions with lobes as narrow as those of this model.
//!
//! Three ways to place points (uniform, and mirrored at the normals of either specular lobe) are weighed by the
//! balance heuristic (Veach and Guibas 1995, *Optimally Combining Sampling Techniques*), and the points are those of
//! the R2 sequence. Nothing here is shared with the model: its densities are written out once more.

use bake_runtime::bsdf::shifted_r2;
use bake_runtime::principled::Principled;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Points per technique.
const POINTS: u64 = 1 << 18;

/// Normals of a specular lobe: how to draw one, and its density.
enum Normals {
    /// Uniform on the surface that `alpha` stretches to a hemisphere: GGX over it is bounded.
    Ggx { alpha: [f64; 2] },
    /// GTR1 times the cosine (Burley 2012).
    Gtr1 { alpha: f64 },
}

impl Normals {
    fn draw(&self, u: [f64; 2]) -> DVec3 {
        let (y, x) = (TAU * u[0]).sin_cos();
        match *self {
            Normals::Ggx { alpha } => {
                let cos = 1.0 - u[1];
                let slope = (1.0 - cos * cos).sqrt() / cos;
                DVec3::new(alpha[0] * slope * x, alpha[1] * slope * y, 1.0).normalize()
            }
            Normals::Gtr1 { alpha } => {
                let cos2 = (1.0 - alpha.powf(2.0 - 2.0 * u[1])) / (1.0 - alpha * alpha);
                let sin = (1.0 - cos2).max(0.0).sqrt();
                DVec3::new(sin * x, sin * y, cos2.sqrt())
            }
        }
    }

    /// Density of the unit vector `m`, sr⁻¹.
    fn density(&self, m: DVec3) -> f64 {
        match *self {
            Normals::Ggx { alpha: [x, y] } => {
                let stretched = DVec3::new(m.x / x, m.y / y, m.z).length();
                1.0 / (stretched.powi(3) * TAU * x * y)
            }
            Normals::Gtr1 { alpha } => {
                let (a2, sin2) = (alpha * alpha, m.x * m.x + m.y * m.y);
                m.z * (a2 - 1.0) / (PI * a2.ln() * (sin2 + a2 * m.z * m.z))
            }
        }
    }
}

/// ∫ g(wi) dω over the hemisphere, for a `g` with lobes like those of `bsdf` seen from `wo`.
pub fn integrate<const N: usize>(bsdf: &Principled, wo: DVec3, g: impl Fn(DVec3) -> [f64; N]) -> [f64; N] {
    let p = bsdf.parameters();
    let lobes = [
        Normals::Ggx { alpha: alpha(bsdf) },
        Normals::Gtr1 {
            alpha: 0.1 - 0.099 * p.clearcoat_gloss,
        },
    ];
    let density = |wi: DVec3| {
        let sum = wo + wi;
        let m = sum.normalize();
        let mirrored: f64 = lobes.iter().map(|l| l.density(m)).sum();
        1.0 / TAU + mirrored / (2.0 * sum.length())
    };
    let mut integral = [0.0; N];
    let mut add = |wi: DVec3| {
        if wi.z > 0.0 {
            let weight = 1.0 / (density(wi) * POINTS as f64);
            integral
                .iter_mut()
                .zip(g(wi))
                .for_each(|(sum, g)| *sum += g * weight);
        }
    };
    for i in 0..POINTS {
        let u = shifted_r2(i, [0.0; 2]);
        let (y, x) = (TAU * u[0]).sin_cos();
        let r = (1.0 - u[1] * u[1]).sqrt();
        add(DVec3::new(r * x, r * y, u[1]));
        for lobe in &lobes {
            let m = lobe.draw(u);
            let cos = wo.dot(m);
            if cos > 0.0 {
                add(2.0 * cos * m - wo);
            }
        }
    }
    integral
}

/// Roughness of the main specular lobe along x and y.
pub fn alpha(bsdf: &Principled) -> [f64; 2] {
    let p = bsdf.parameters();
    let aspect = (1.0 - 0.9 * p.anisotropic).sqrt();
    [1.0 / aspect, aspect].map(|a| (p.roughness * p.roughness * a).max(1e-3))
}
