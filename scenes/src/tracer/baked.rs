//! A baked material at a surface: directions from the sampling network, weights by the chosen estimator.

use super::lanes::Lanes;
use super::shader::{Batch, Scattered, Shader};
use crate::error::Result;
use bake_runtime::conductor::Conductor;
use bake_runtime::{Backend, Bsdf};

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
    pub backend: Box<dyn Backend>,
    /// The model that the networks were baked from.
    pub reference: Conductor,
    /// Where weights come from.
    pub estimator: Estimator,
    jacobian: Vec<f32>,
}

impl BakedShader {
    /// Binds the three.
    pub fn new(backend: Box<dyn Backend>, reference: Conductor, estimator: Estimator) -> BakedShader {
        BakedShader {
            backend,
            reference,
            estimator,
            jacobian: Vec::new(),
        }
    }

    /// Fills `value` with `f_cos`, by the network or the reference as the estimator says.
    fn f_cos(&mut self, batch: &mut Batch, wi: &Lanes, value: &mut Lanes) -> Result<()> {
        if self.estimator == Estimator::ExactBaked {
            return Ok(self
                .backend
                .eval(batch.wo.slices(), wi.slices(), value.slices_mut())?);
        }
        for (i, rng) in batch.rng.iter_mut().enumerate() {
            value.set(
                i,
                self.reference
                    .eval(batch.wo.unit_at(i), wi.unit_at(i), rng)
                    .as_vec3(),
            );
        }
        Ok(())
    }
}

impl Shader for BakedShader {
    fn eval(&mut self, batch: &mut Batch, out: &mut Scattered) -> Result<()> {
        self.f_cos(batch, &out.wi, &mut out.value)?;
        Ok(self
            .backend
            .pdf(batch.wo.slices(), out.wi.slices(), &mut out.pdf)?)
    }

    fn sample(&mut self, batch: &mut Batch, out: &mut Scattered) -> Result<()> {
        let u = [batch.u[0].as_slice(), batch.u[1].as_slice()];
        if self.estimator == Estimator::Learned {
            self.backend
                .sample_learned(batch.wo.slices(), u, out.wi.slices_mut(), out.value.slices_mut())?;
        } else {
            self.jacobian.resize(batch.wo.len(), 0.0);
            self.backend
                .sample_jacobian(batch.wo.slices(), u, out.wi.slices_mut(), &mut self.jacobian)?;
            self.f_cos(batch, &out.wi, &mut out.value)?;
            for component in out.value.slices_mut() {
                component
                    .iter_mut()
                    .zip(&self.jacobian)
                    .for_each(|(value, jacobian)| *value *= jacobian);
            }
        }
        Ok(self
            .backend
            .pdf(batch.wo.slices(), out.wi.slices(), &mut out.pdf)?)
    }
}
