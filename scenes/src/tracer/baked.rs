//! A baked material at a surface: directions from the sampling network, weights by the chosen estimator.

use super::lanes::Lanes;
use super::shader::{Batch, Scattered, Shader};
use crate::error::Result;
use bake_runtime::estimator::{exact_f_cos, exact_weight};
use bake_runtime::{Backend, Points, Reference};
use std::sync::Arc;

/// Where the weight of a baked sample comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Estimator {
    /// Regressed by the sampling network; lights are evaluated with the reference model.
    Learned,
    /// Reference model × Jacobian of the map: unbiased.
    Exact,
    /// Evaluation network × Jacobian of the map; lights are evaluated with the same network.
    ExactBaked,
}

impl Estimator {
    /// All estimators.
    pub const ALL: [Estimator; 3] = [Estimator::Learned, Estimator::Exact, Estimator::ExactBaked];

    /// The name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Estimator::Learned => "learned",
            Estimator::Exact => "exact",
            Estimator::ExactBaked => "exact_baked",
        }
    }
}

/// A baked material; the pdf network gives the densities of both techniques' weights.
pub struct BakedShader {
    /// Runs the networks.
    pub backend: Arc<dyn Backend>,
    /// The model that the networks were baked from.
    pub reference: Reference,
    /// Where weights come from.
    pub estimator: Estimator,
    jacobian: Vec<f32>,
}

impl BakedShader {
    /// Binds the three.
    pub fn new(backend: Arc<dyn Backend>, reference: Reference, estimator: Estimator) -> BakedShader {
        BakedShader {
            backend,
            reference,
            estimator,
            jacobian: Vec::new(),
        }
    }

    /// Multiplies `value` by the jacobians.
    fn times_jacobian(&self, value: &mut Lanes) {
        for component in value.slices_mut() {
            let pairs = component.iter_mut().zip(&self.jacobian);
            pairs.for_each(|(value, jacobian)| *value *= jacobian);
        }
    }
}

impl Shader for BakedShader {
    fn eval(&mut self, batch: &mut Batch, out: &mut Scattered) -> Result<()> {
        let (points, wi) = (Points::fixed(batch.wo.slices()), out.wi.slices());
        self.backend.pdf(points, wi, &mut out.pdf)?;
        if self.estimator == Estimator::ExactBaked {
            return Ok(self.backend.eval(points, wi, out.value.slices_mut())?);
        }
        for (i, (rng, &pdf)) in batch.rng.iter_mut().zip(&out.pdf).enumerate() {
            let (wo, wi) = (batch.wo.unit_at(i), out.wi.unit_at(i));
            let f_cos = exact_f_cos(&self.reference, wo, wi, f64::from(pdf), rng);
            out.value.set(i, f_cos.as_vec3());
        }
        Ok(())
    }

    fn sample(&mut self, batch: &mut Batch, out: &mut Scattered) -> Result<()> {
        let u = [batch.u[0].as_slice(), batch.u[1].as_slice()];
        let points = Points::fixed(batch.wo.slices());
        if self.estimator == Estimator::Learned {
            self.backend
                .sample_learned(points, u, out.wi.slices_mut(), out.value.slices_mut())?;
        } else {
            self.jacobian.resize(batch.wo.len(), 0.0);
            self.backend
                .sample_jacobian(points, u, out.wi.slices_mut(), &mut self.jacobian)?;
            if self.estimator == Estimator::ExactBaked {
                self.backend
                    .eval(points, out.wi.slices(), out.value.slices_mut())?;
                self.times_jacobian(&mut out.value);
            } else {
                for (i, (rng, &jacobian)) in batch.rng.iter_mut().zip(&self.jacobian).enumerate() {
                    let (wo, wi) = (batch.wo.unit_at(i), out.wi.unit_at(i));
                    let weight = exact_weight(&self.reference, wo, wi, f64::from(jacobian), rng);
                    out.value.set(i, weight.as_vec3());
                }
            }
        }
        Ok(self.backend.pdf(points, out.wi.slices(), &mut out.pdf)?)
    }
}
