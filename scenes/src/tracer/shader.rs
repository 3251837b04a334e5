//! What happens at a surface, for a batch of hits at once: reference models and the diffuse ground.

use super::lanes::Lanes;
use crate::error::Result;
use bake_runtime::concentric::square_to_hemisphere;
use bake_runtime::{Bsdf, Reference, Rng};
use glam::{DVec3, Vec3};
use std::f64::consts::{FRAC_1_PI, PI};

/// One shading point per lane.
#[derive(Debug, Default)]
pub struct Batch {
    /// Unit directions to the camera, shading frame, z > 0.
    pub wo: Lanes,
    /// Low-discrepancy pair per lane, `[0,1)²`.
    pub u: [Vec<f32>; 2],
    /// A stream per lane, for everything beyond `u`.
    pub rng: Vec<Rng>,
}

/// Directions, what they carry, and their density for multiple importance sampling; one per lane.
#[derive(Debug, Default)]
pub struct Scattered {
    /// Unit directions to the light, shading frame.
    pub wi: Lanes,
    /// From `eval`: `f_cos`, RGB, sr⁻¹. From `sample`: the weight, RGB, dimensionless, zero where nothing
    /// was drawn; baked weights may be negative.
    pub value: Lanes,
    /// Density of `wi`, sr⁻¹: the same function in `eval` and `sample`, only ever used in weights.
    pub pdf: Vec<f32>,
}

impl Scattered {
    /// Makes room for `len` lanes.
    pub fn resize(&mut self, len: usize) {
        self.wi.resize(len);
        self.value.resize(len);
        self.pdf.resize(len, 0.0);
    }
}

/// A surface's reflection, bound to one method of sampling it.
pub trait Shader: Send {
    /// Fills `out.value` with `f_cos` (or an unbiased estimate) for `out.wi`, and `out.pdf`.
    ///
    /// # Errors
    /// What a backend returns.
    fn eval(&mut self, batch: &mut Batch, out: &mut Scattered) -> Result<()>;

    /// Draws `out.wi`, one per lane, with their weights in `out.value`, and fills `out.pdf`.
    ///
    /// # Errors
    /// What a backend returns.
    fn sample(&mut self, batch: &mut Batch, out: &mut Scattered) -> Result<()>;
}

/// How a reference model is sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Proposal {
    /// Its own random walk, steered by the low-discrepancy pair.
    Walk,
    /// Its own random walk on plain random numbers.
    RandomWalk,
    /// Its own analytic proposal: visible normals, where it has a microsurface.
    Vndf,
    /// cos θ/π.
    Cosine,
}

/// A reference model with a way of sampling it.
pub struct ReferenceShader {
    /// The model.
    pub bsdf: Reference,
    /// How directions are drawn.
    pub proposal: Proposal,
}

impl ReferenceShader {
    fn pdf(&self, wo: DVec3, wi: DVec3) -> f64 {
        match self.proposal {
            Proposal::Cosine => wi.z.max(0.0) * FRAC_1_PI,
            _ => self.bsdf.pdf(wo, wi),
        }
    }

    /// Direction and weight, or `None` where the proposal fails.
    fn draw(&self, wo: DVec3, u: [f64; 2], rng: &mut Rng) -> Option<(DVec3, DVec3)> {
        let wi = match self.proposal {
            Proposal::Walk | Proposal::RandomWalk => {
                let u = if self.proposal == Proposal::Walk {
                    u
                } else {
                    rng.pair()
                };
                return self.bsdf.sample(wo, u, rng).map(|s| (s.wi, s.weight));
            }
            Proposal::Vndf => self.bsdf.propose(wo, u)?,
            Proposal::Cosine => cosine_direction(u),
        };
        let pdf = self.pdf(wo, wi);
        (pdf > 0.0).then(|| (wi, self.bsdf.eval(wo, wi, rng) / pdf))
    }
}

impl Shader for ReferenceShader {
    fn eval(&mut self, batch: &mut Batch, out: &mut Scattered) -> Result<()> {
        for (i, rng) in batch.rng.iter_mut().enumerate() {
            let (wo, wi) = (batch.wo.unit_at(i), out.wi.unit_at(i));
            out.value.set(i, self.bsdf.eval(wo, wi, rng).as_vec3());
            out.pdf[i] = self.pdf(wo, wi) as f32;
        }
        Ok(())
    }

    fn sample(&mut self, batch: &mut Batch, out: &mut Scattered) -> Result<()> {
        for (i, rng) in batch.rng.iter_mut().enumerate() {
            let wo = batch.wo.unit_at(i);
            let u = [0, 1].map(|axis| f64::from(batch.u[axis][i]));
            let (wi, weight) = self.draw(wo, u, rng).unwrap_or((DVec3::Z, DVec3::ZERO));
            out.wi.set(i, wi.as_vec3());
            out.value.set(i, weight.as_vec3());
            out.pdf[i] = self.pdf(wo, wi) as f32;
        }
        Ok(())
    }
}

/// A Lambertian surface, always sampled by the cosine.
pub struct DiffuseShader {
    /// Albedo, RGB.
    pub albedo: Vec3,
}

impl Shader for DiffuseShader {
    fn eval(&mut self, batch: &mut Batch, out: &mut Scattered) -> Result<()> {
        for i in 0..batch.wo.len() {
            let pdf = out.wi.at(i).z.max(0.0) * FRAC_1_PI as f32;
            out.value.set(i, self.albedo * pdf);
            out.pdf[i] = pdf;
        }
        Ok(())
    }

    fn sample(&mut self, batch: &mut Batch, out: &mut Scattered) -> Result<()> {
        for i in 0..batch.wo.len() {
            let wi = cosine_direction([0, 1].map(|axis| f64::from(batch.u[axis][i])));
            out.wi.set(i, wi.as_vec3());
            out.value.set(i, self.albedo);
            out.pdf[i] = (wi.z / PI) as f32;
        }
        Ok(())
    }
}

/// A direction of density cos θ/π (sr⁻¹) for `u` in `[0,1)²`.
pub fn cosine_direction(u: [f64; 2]) -> DVec3 {
    DVec3::from(square_to_hemisphere(u, u.map(|v| 1.0 - v)))
}
