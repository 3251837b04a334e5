//! Batches of queries at one `wo`, and running moments of their weights: what every measure is made of.

use super::truth::Truth;
use bake_runtime::{Backend, Points};
use glam::DVec3;

/// Queries per call.
pub const BATCH: usize = 4096;

/// Running mean and variance of RGB weights.
#[derive(Clone, Copy, Default)]
pub struct Moments {
    /// Number of weights.
    pub count: f64,
    /// Their sum.
    pub sum: DVec3,
    /// The sum of their squares.
    pub square: DVec3,
}

impl Moments {
    /// Adds one weight.
    pub fn add(&mut self, value: DVec3) {
        self.count += 1.0;
        self.sum += value;
        self.square += value * value;
    }

    /// Mean so far.
    pub fn mean(&self) -> DVec3 {
        self.sum / self.count
    }

    /// Standard error of the mean.
    pub fn se(&self) -> DVec3 {
        let mean = self.mean();
        let variance = (self.square / self.count - mean * mean).max(DVec3::ZERO) / (self.count - 1.0);
        DVec3::new(variance.x.sqrt(), variance.y.sqrt(), variance.z.sqrt())
    }

    /// Bias against `albedo` with the standard error of both.
    pub fn bias(&self, truth: &Truth) -> (DVec3, DVec3) {
        let se = self.se();
        let total = DVec3::from_array([0, 1, 2].map(|c: usize| se[c].hypot(truth.albedo_se[c])));
        (self.mean() / truth.albedo - DVec3::ONE, total / truth.albedo)
    }
}

/// Reusable structure-of-arrays buffers of one batch.
pub struct Buffers {
    /// Camera directions.
    pub wo: [Vec<f32>; 3],
    /// Uniform numbers.
    pub u: [Vec<f32>; 2],
    /// Light directions.
    pub wi: [Vec<f32>; 3],
    /// Weights or f_cos.
    pub rgb: [Vec<f32>; 3],
    /// Jacobians or pdfs.
    pub scalar: Vec<f32>,
}

impl Buffers {
    /// Buffers of [`BATCH`] queries that all have `wo`.
    pub fn new(wo: DVec3) -> Buffers {
        let zeros = || vec![0.0; BATCH];
        Buffers {
            wo: wo.to_array().map(|c| vec![c as f32; BATCH]),
            u: [zeros(), zeros()],
            wi: [zeros(), zeros(), zeros()],
            rgb: [zeros(), zeros(), zeros()],
            scalar: zeros(),
        }
    }

    /// Sets the uniform numbers of query `i`.
    pub fn set_u(&mut self, i: usize, u: [f64; 2]) {
        // The largest f32 below 1: rounding must not leave [0, 1).
        let bound = |v: f64| (v as f32).min(1.0 - f32::EPSILON / 2.0);
        self.u[0][i] = bound(u[0]);
        self.u[1][i] = bound(u[1]);
    }

    /// Sets the light direction of query `i`.
    pub fn set_wi(&mut self, i: usize, wi: DVec3) {
        for (column, component) in self.wi.iter_mut().zip(wi.to_array()) {
            column[i] = component as f32;
        }
    }

    /// Light direction of query `i`.
    pub fn wi(&self, i: usize) -> DVec3 {
        DVec3::new(self.wi[0][i].into(), self.wi[1][i].into(), self.wi[2][i].into())
    }

    /// Weight or f_cos of query `i`.
    pub fn rgb(&self, i: usize) -> DVec3 {
        DVec3::new(
            self.rgb[0][i].into(),
            self.rgb[1][i].into(),
            self.rgb[2][i].into(),
        )
    }

    /// Fills `wi` and `rgb`.
    pub fn sample_learned(&mut self, backend: &mut dyn Backend) -> bake_runtime::Result<()> {
        let [x, y, z] = &mut self.wi;
        let [r, g, b] = &mut self.rgb;
        backend.sample_learned(
            Points::fixed(views(&self.wo)),
            views(&self.u),
            [x, y, z],
            [r, g, b],
        )
    }

    /// Fills `wi` and `scalar`.
    pub fn sample_jacobian(&mut self, backend: &mut dyn Backend) -> bake_runtime::Result<()> {
        let [x, y, z] = &mut self.wi;
        backend.sample_jacobian(
            Points::fixed(views(&self.wo)),
            views(&self.u),
            [x, y, z],
            &mut self.scalar,
        )
    }

    /// Fills `rgb` at `wi`.
    pub fn eval(&mut self, backend: &mut dyn Backend) -> bake_runtime::Result<()> {
        let [r, g, b] = &mut self.rgb;
        backend.eval(Points::fixed(views(&self.wo)), views(&self.wi), [r, g, b])
    }

    /// Fills `scalar` at `wi`.
    pub fn pdf(&mut self, backend: &mut dyn Backend) -> bake_runtime::Result<()> {
        backend.pdf(Points::fixed(views(&self.wo)), views(&self.wi), &mut self.scalar)
    }
}

fn views<const N: usize>(columns: &[Vec<f32>; N]) -> [&[f32]; N] {
    columns.each_ref().map(|c| c.as_slice())
}
