//! The networks of one material, packed for one tier, and the tasks that run them. Lengths are checked by the caller.

use super::batch::{self, Tiles};
use super::density::{Densities, Density};
use super::invert::{ExactPdf, Inversions};
use super::sample::{Jacobian, Learned, Partition, Sampler};
use super::scratch;
use super::vector::Simd;
use crate::backend::{BakedMaterial, Points};
use crate::error::{Error, Result};
use crate::spec::{CHARTS_MAX, Role};

/// What every tier can do: [`crate::Backend`] and the inversions of [`super::NativeBackend`], without their errors.
pub trait Run: Send + Sync {
    /// [`crate::Backend::sample_learned`].
    fn sample_learned(&self, points: Points, u: [&[f32]; 2], wi: [&mut [f32]; 3], weight: [&mut [f32]; 3]);

    /// [`crate::Backend::sample_jacobian`].
    fn sample_jacobian(&self, points: Points, u: [&[f32]; 2], wi: [&mut [f32]; 3], jacobian: &mut [f32]);

    /// [`super::NativeBackend::sample_mixture`].
    fn sample_mixture(
        &self,
        points: Points,
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        jacobian: &mut [f32],
    ) -> Inversions;

    /// [`crate::Backend::eval`].
    fn eval(&self, points: Points, wi: [&[f32]; 3], f_cos: [&mut [f32]; 3]);

    /// [`crate::Backend::pdf`].
    fn pdf(&self, points: Points, wi: [&[f32]; 3], pdf: &mut [f32]);

    /// [`super::NativeBackend::bind`]; there is a value for every free parameter.
    fn bound(&self, values: &[Option<f64>]) -> Box<dyn Run>;

    /// [`super::NativeBackend::exact_pdf`]; `None` on the disk.
    fn exact_pdf(&self, points: Points, wi: [&[f32]; 3], pdf: &mut [f32]) -> Option<Inversions>;
}

/// The networks packed for one tier, to run in tiles of `N` vectors.
pub struct Runner<S, const N: usize> {
    simd: S,
    sampler: Sampler,
    eval: Densities,
    pdf: Densities,
    /// Widest layer or input of all networks.
    width: usize,
}

impl<S: Simd, const N: usize> Runner<S, N> {
    /// Packs the networks of `material`.
    ///
    /// # Errors
    /// [`Error::Network`] when one contradicts itself or the others.
    pub fn new(material: &BakedMaterial, simd: S) -> Result<Self> {
        let runner = Runner::of(
            simd,
            Sampler::new(&material.sample)?,
            Densities::new(&material.eval, Role::Eval)?,
            Densities::new(&material.pdf, Role::Pdf)?,
        );
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

    fn of(simd: S, sampler: Sampler, eval: Densities, pdf: Densities) -> Self {
        let widths = [&sampler.program, &eval.program, &pdf.program].map(|program| program.width);
        Runner {
            simd,
            sampler,
            eval,
            pdf,
            width: widths.into_iter().max().unwrap_or(0),
        }
    }

    /// Runs `job` in this thread's buffers.
    fn run(&self, job: &mut impl Tiles<S::Vector>) {
        let zero = self.simd.splat(0.0);
        scratch::with::<S::Vector, N>(self.width, zero, |scratch| batch::run(self.simd, scratch, job));
    }
}

impl<S: Simd, const N: usize> Run for Runner<S, N> {
    fn bound(&self, values: &[Option<f64>]) -> Box<dyn Run> {
        Box::new(Runner::<S, N>::of(
            self.simd,
            self.sampler.bound(values),
            self.eval.bound(values),
            self.pdf.bound(values),
        ))
    }

    fn sample_learned(&self, points: Points, u: [&[f32]; 2], wi: [&mut [f32]; 3], weight: [&mut [f32]; 3]) {
        self.run(&mut Learned {
            simd: self.simd,
            sampler: &self.sampler,
            points,
            u,
            wi,
            weight,
        });
    }

    fn sample_jacobian(&self, points: Points, u: [&[f32]; 2], wi: [&mut [f32]; 3], jacobian: &mut [f32]) {
        let partition = match self.sampler.program.charts() {
            CHARTS_MAX => Partition::Learned(&self.pdf),
            _ => Partition::None,
        };
        self.run(&mut Jacobian {
            simd: self.simd,
            sampler: &self.sampler,
            partition,
            points,
            u,
            wi,
            jacobian,
        });
    }

    fn sample_mixture(
        &self,
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
        self.run(&mut Jacobian {
            simd: self.simd,
            sampler: &self.sampler,
            partition,
            points,
            u,
            wi,
            jacobian,
        });
        inversions
    }

    fn eval(&self, points: Points, wi: [&[f32]; 3], f_cos: [&mut [f32]; 3]) {
        self.run(&mut Density {
            simd: self.simd,
            densities: &self.eval,
            points,
            wi,
            out: f_cos,
        });
    }

    fn pdf(&self, points: Points, wi: [&[f32]; 3], pdf: &mut [f32]) {
        self.run(&mut Density {
            simd: self.simd,
            densities: &self.pdf,
            points,
            wi,
            out: [pdf],
        });
    }

    fn exact_pdf(&self, points: Points, wi: [&[f32]; 3], pdf: &mut [f32]) -> Option<Inversions> {
        self.sampler.program.frames.as_ref()?;
        let mut inversions = Inversions::default();
        self.run(&mut ExactPdf {
            simd: self.simd,
            sampler: &self.sampler,
            points,
            wi,
            pdf,
            inversions: &mut inversions,
        });
        Some(inversions)
    }
}
