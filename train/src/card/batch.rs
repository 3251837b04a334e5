//! Batches of queries at one place: what every measure is made of.

use super::Mixture;
use super::heldout::HeldOut;
use bake_runtime::{Backend, Points};
use glam::DVec3;

/// Queries per call.
pub const BATCH: usize = 4096;

/// Reusable structure-of-arrays buffers of one batch.
pub struct Buffers {
    /// Free parameters, the same for all queries.
    params: Vec<[f32; 1]>,
    /// Camera directions.
    wo: [Vec<f32>; 3],
    /// Uniform numbers.
    u: [Vec<f32>; 2],
    /// Light directions.
    wi: [Vec<f32>; 3],
    /// Weights or f_cos.
    rgb: [Vec<f32>; 3],
    /// Jacobians or pdfs.
    pub scalar: Vec<f32>,
}

impl Buffers {
    /// Buffers of [`BATCH`] queries at `place`.
    pub fn new(place: &HeldOut) -> Buffers {
        let zeros = || vec![0.0; BATCH];
        Buffers {
            params: place.params.iter().map(|p| [*p as f32]).collect(),
            wo: place.wo.to_array().map(|c| vec![c as f32; BATCH]),
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
        DVec3::from_array(self.wi.each_ref().map(|c| c[i].into()))
    }

    /// Weight or f_cos of query `i`.
    pub fn rgb(&self, i: usize) -> DVec3 {
        DVec3::from_array(self.rgb.each_ref().map(|c| c[i].into()))
    }

    /// Fills `wi` and `rgb`.
    pub fn sample_learned(&mut self, backend: &dyn Backend) -> bake_runtime::Result<()> {
        let params = columns(&self.params);
        let points = points(&params, &self.wo);
        let [x, y, z] = &mut self.wi;
        let [r, g, b] = &mut self.rgb;
        backend.sample_learned(points, views(&self.u), [x, y, z], [r, g, b])
    }

    /// Fills `wi` and `scalar`.
    pub fn sample_jacobian(&mut self, backend: &dyn Backend) -> bake_runtime::Result<()> {
        let params = columns(&self.params);
        let points = points(&params, &self.wo);
        let [x, y, z] = &mut self.wi;
        backend.sample_jacobian(points, views(&self.u), [x, y, z], &mut self.scalar)
    }

    /// Fills `wi` and `scalar` by the exact mixture of charts; how many queries did not converge.
    pub fn sample_mixture(&mut self, mixture: &Mixture) -> bake_runtime::Result<usize> {
        let params = columns(&self.params);
        let points = points(&params, &self.wo);
        let [x, y, z] = &mut self.wi;
        mixture(points, views(&self.u), [x, y, z], &mut self.scalar)
    }

    /// Fills `rgb` at `wi`.
    pub fn eval(&mut self, backend: &dyn Backend) -> bake_runtime::Result<()> {
        let params = columns(&self.params);
        let points = points(&params, &self.wo);
        let [r, g, b] = &mut self.rgb;
        backend.eval(points, views(&self.wi), [r, g, b])
    }

    /// Fills `scalar` at `wi`.
    pub fn pdf(&mut self, backend: &dyn Backend) -> bake_runtime::Result<()> {
        let params = columns(&self.params);
        let points = points(&params, &self.wo);
        backend.pdf(points, views(&self.wi), &mut self.scalar)
    }
}

/// The shading points of a batch.
pub fn points<'a>(params: &'a [&'a [f32]], wo: &'a [Vec<f32>; 3]) -> Points<'a> {
    Points {
        params,
        wo: views(wo),
    }
}

/// Slices of the columns of a batch.
pub fn views<const N: usize>(columns: &[Vec<f32>; N]) -> [&[f32]; N] {
    columns.each_ref().map(|c| c.as_slice())
}

/// Slices of the parameters that a whole batch shares.
pub fn columns(params: &[[f32; 1]]) -> Vec<&[f32]> {
    params.iter().map(|p| p.as_slice()).collect()
}
