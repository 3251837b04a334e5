//! The networks of one material, packed for one tier, and the tasks that run them. Lengths are checked by the caller.

use super::density::{Densities, Density};
use super::invert::{ExactPdf, Inversions};
use super::sample::{Jacobian, Learned, Partition, Sampler};
use super::vector::Simd;
use crate::backend::{BakedMaterial, Points};
use crate::error::{Error, Result};
use crate::spec::{CHARTS_MAX, Role};

/// What every tier can do: [`crate::Backend`] and the inversions of [`super::NativeBackend`], without their errors.
pub trait Run: Send {
    /// [`crate::Backend::sample_learned`].
    fn sample_learned(
        &mut self,
        points: Points,
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        weight: [&mut [f32]; 3],
    );

    /// [`crate::Backend::sample_jacobian`].
    fn sample_jacobian(&mut self, points: Points, u: [&[f32]; 2], wi: [&mut [f32]; 3], jacobian: &mut [f32]);

    /// [`super::NativeBackend::sample_mixture`].
    fn sample_mixture(
        &mut self,
        points: Points,
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        jacobian: &mut [f32],
    ) -> Inversions;

    /// [`crate::Backend::eval`].
    fn eval(&mut self, points: Points, wi: [&[f32]; 3], f_cos: [&mut [f32]; 3]);

    /// [`crate::Backend::pdf`].
    fn pdf(&mut self, points: Points, wi: [&[f32]; 3], pdf: &mut [f32]);

    /// [`super::NativeBackend::exact_pdf`]; `None` on the disk.
    fn exact_pdf(&mut self, points: Points, wi: [&[f32]; 3], pdf: &mut [f32]) -> Option<Inversions>;
}

/// The networks packed for one tier, `N` vectors of queries per tile.
pub struct Runner<S: Simd, const N: usize> {
    simd: S,
    sampler: Sampler<S::Vector, N>,
    eval: Densities<S::Vector, N>,
    pdf: Densities<S::Vector, N>,
}

impl<S: Simd, const N: usize> Runner<S, N> {
    /// Packs the networks of `material`.
    ///
    /// # Errors
    /// [`Error::Network`] when one contradicts itself or the others.
    pub fn new(material: &BakedMaterial, simd: S) -> Result<Self> {
        let zero = simd.splat(0.0);
        let runner = Runner {
            simd,
            sampler: Sampler::new(&material.sample, zero)?,
            eval: Densities::new(&material.eval, Role::Eval, zero)?,
            pdf: Densities::new(&material.pdf, Role::Pdf, zero)?,
        };
        let refuse = |role: Role, reason: &str| {
            Err(Error::network(
                format!("the {} network", role.name()),
                format!("it has {reason} than the sampling network"),
            ))
        };
        for (role, network) in [(Role::Eval, &material.eval), (Role::Pdf, &material.pdf)] {
            if network.spec.material != material.sample.spec.material {
                return refuse(role, "another material");
            }
        }
        match runner.pdf.program.charts() == runner.sampler.program.charts() {
            true => Ok(runner),
            false => refuse(Role::Pdf, "another number of charts"),
        }
    }
}

impl<S: Simd, const N: usize> Run for Runner<S, N> {
    fn sample_learned(
        &mut self,
        points: Points,
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        weight: [&mut [f32]; 3],
    ) {
        self.simd.enter(Learned {
            simd: self.simd,
            sampler: &mut self.sampler,
            points,
            u,
            wi,
            weight,
        });
    }

    fn sample_jacobian(&mut self, points: Points, u: [&[f32]; 2], wi: [&mut [f32]; 3], jacobian: &mut [f32]) {
        let partition = match self.sampler.program.charts() {
            CHARTS_MAX => Partition::Learned(&mut self.pdf),
            _ => Partition::None,
        };
        self.simd.enter(Jacobian {
            simd: self.simd,
            sampler: &mut self.sampler,
            partition,
            points,
            u,
            wi,
            jacobian,
        });
    }

    fn sample_mixture(
        &mut self,
        points: Points,
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        jacobian: &mut [f32],
    ) -> Inversions {
        let mut inversions = Inversions::default();
        let partition = match self.sampler.program.charts() {
            CHARTS_MAX => Partition::Exact(&mut inversions),
            _ => Partition::None,
        };
        self.simd.enter(Jacobian {
            simd: self.simd,
            sampler: &mut self.sampler,
            partition,
            points,
            u,
            wi,
            jacobian,
        });
        inversions
    }

    fn eval(&mut self, points: Points, wi: [&[f32]; 3], f_cos: [&mut [f32]; 3]) {
        self.simd.enter(Density {
            simd: self.simd,
            densities: &mut self.eval,
            points,
            wi,
            out: f_cos,
        });
    }

    fn pdf(&mut self, points: Points, wi: [&[f32]; 3], pdf: &mut [f32]) {
        self.simd.enter(Density {
            simd: self.simd,
            densities: &mut self.pdf,
            points,
            wi,
            out: [pdf],
        });
    }

    fn exact_pdf(&mut self, points: Points, wi: [&[f32]; 3], pdf: &mut [f32]) -> Option<Inversions> {
        self.sampler.program.frames.as_ref()?;
        let mut inversions = Inversions::default();
        self.simd.enter(ExactPdf {
            simd: self.simd,
            sampler: &mut self.sampler,
            points,
            wi,
            pdf,
            inversions: &mut inversions,
        });
        Some(inversions)
    }
}
