//! Our own kernels: batches through the networks of one material, sixteen, eight or one query per vector.
//!
//! Numeric code is written once over `vector::Vector`; `arch` holds lane operations only. A batch is
//! dispatched once, into a function compiled for the tier, and cut into tiles that go through all layers in
//! buffers that stay in the first-level cache. Results do not depend on how queries are batched.

pub(crate) mod arch;
mod batch;
mod chart;
mod columns;
mod density;
mod encode;
mod head;
mod invert;
mod kernel;
mod layer;
mod layers;
mod lines;
pub(crate) mod math;
mod place;
mod program;
mod runner;
mod sample;
mod scratch;
mod shift;
mod square;
mod stack;
mod tier;
mod tile;
pub(crate) mod vector;

use crate::backend::{Backend, BakedMaterial, Points, check_lengths};
use crate::error::{Error, Result};
pub use invert::Inversions;
pub use layers::Layers;
use runner::{Run, Runner};
pub(crate) use tier::TierJob;
pub use tier::{TIER_VARIABLE, Tier};
use vector::Simd;

/// The networks of one material, packed for a tier.
///
/// One serves any number of threads at once. The buffers that queries run in belong to threads: a thread's first call, and
/// its first on wider networks than before, allocates them; no other call allocates.
pub struct NativeBackend {
    runner: Box<dyn Run>,
    /// Number of free parameters.
    free: usize,
}

/// Packs a material for a tier.
struct Pack<'a>(&'a BakedMaterial);

impl TierJob for Pack<'_> {
    type Out = Result<Box<dyn Run>>;

    fn run<S: Simd, const N: usize>(self, simd: S) -> Self::Out {
        Ok(Box::new(Runner::<S, N>::new(self.0, simd)?))
    }
}

impl NativeBackend {
    /// Packs `material` for `tier`.
    ///
    /// # Errors
    /// [`Error::Tier`] when the processor lacks `tier`, [`Error::Network`] when a network's weights contradict
    /// its specification, or the networks each other.
    pub fn new(material: &BakedMaterial, tier: Tier) -> Result<NativeBackend> {
        let runner = tier.with(Pack(material))??;
        Ok(NativeBackend {
            free: material.sample.spec.material.free().len(),
            runner,
        })
    }

    /// The same material with those free parameters fixed that have `values`, one per free parameter in the order of
    /// [`crate::Material::free`]. They cost nothing any more: what the networks' first layers make of them is added to the
    /// bias, in f64. [`Points::params`] of the result holds the other parameters alone.
    ///
    /// Bound materials share their weights with the one that they come from.
    ///
    /// # Errors
    /// [`Error::BatchLength`] when the number of values is not that of the free parameters, [`Error::Query`] for a value that
    /// is not finite.
    pub fn bind(&self, values: &[Option<f32>]) -> Result<NativeBackend> {
        check_lengths(self.free, &[("params", values.len())])?;
        if let Some(i) = values.iter().position(|v| v.is_some_and(|v| !v.is_finite())) {
            return Err(Error::query(format!("params[{i}]"), "it must be a finite number"));
        }
        let values: Vec<Option<f64>> = values.iter().map(|v| v.map(f64::from)).collect();
        Ok(NativeBackend {
            free: values.iter().filter(|value| value.is_none()).count(),
            runner: self.runner.bound(&values),
        })
    }

    /// The density of what [`Backend::sample_jacobian`] draws at `wi`, sr⁻¹, by inverting the map: with one chart the
    /// reciprocal of its Jacobian, with two the mixture of both by their shares.
    ///
    /// Where the map folds it is the density of one of its branches, and where Newton's method does not converge that of
    /// the frame alone; the result counts these. Zero where a direction is not finite or not above the horizon.
    ///
    /// # Errors
    /// [`Error::BatchLength`] when slices differ in length, [`Error::Query`] for a network on the disk, whose map need not
    /// be one to one.
    pub fn exact_pdf(&self, points: Points, wi: [&[f32]; 3], pdf: &mut [f32]) -> Result<Inversions> {
        points.check(self.free)?;
        check_lengths(points.len(), &lengths("wi", &wi))?;
        check_lengths(points.len(), &[("pdf", pdf.len())])?;
        match self.runner.exact_pdf(points, wi, pdf) {
            Some(inversions) => Ok(inversions),
            None => Err(Error::query(
                "exact_pdf",
                "the sampling network draws on the disk, and only maps of charts can be inverted; use `pdf`",
            )),
        }
    }

    /// `wi`, and the signed `jacobian` (sr) that makes `f_cos · jacobian` an unbiased weight. With two charts it is that of
    /// the drawn one times its part of [`NativeBackend::exact_pdf`]: the balance heuristic (Veach and Guibas 1995) for the
    /// densities themselves, where [`Backend::sample_jacobian`] takes learned ones. With fewer the two are the same, and
    /// nothing is inverted.
    ///
    /// # Errors
    /// [`Error::BatchLength`] when slices differ in length.
    pub fn sample_mixture(
        &self,
        points: Points,
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        jacobian: &mut [f32],
    ) -> Result<Inversions> {
        self.check_jacobian(&points, &u, &wi, jacobian)?;
        Ok(self.runner.sample_mixture(points, u, wi, jacobian))
    }

    fn check_jacobian(
        &self,
        points: &Points,
        u: &[&[f32]; 2],
        wi: &[&mut [f32]; 3],
        jacobian: &[f32],
    ) -> Result<()> {
        points.check(self.free)?;
        check_lengths(points.len(), &lengths("u", u))?;
        check_lengths(points.len(), &lengths("wi", wi))?;
        check_lengths(points.len(), &[("jacobian", jacobian.len())])
    }
}

impl Backend for NativeBackend {
    fn sample_learned(
        &self,
        points: Points,
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        weight: [&mut [f32]; 3],
    ) -> Result<()> {
        points.check(self.free)?;
        check_lengths(points.len(), &lengths("u", &u))?;
        check_lengths(points.len(), &lengths("wi", &wi))?;
        check_lengths(points.len(), &lengths("weight", &weight))?;
        self.runner.sample_learned(points, u, wi, weight);
        Ok(())
    }

    fn sample_jacobian(
        &self,
        points: Points,
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        jacobian: &mut [f32],
    ) -> Result<()> {
        self.check_jacobian(&points, &u, &wi, jacobian)?;
        self.runner.sample_jacobian(points, u, wi, jacobian);
        Ok(())
    }

    fn eval(&self, points: Points, wi: [&[f32]; 3], f_cos: [&mut [f32]; 3]) -> Result<()> {
        points.check(self.free)?;
        check_lengths(points.len(), &lengths("wi", &wi))?;
        check_lengths(points.len(), &lengths("f_cos", &f_cos))?;
        self.runner.eval(points, wi, f_cos);
        Ok(())
    }

    fn pdf(&self, points: Points, wi: [&[f32]; 3], pdf: &mut [f32]) -> Result<()> {
        points.check(self.free)?;
        check_lengths(points.len(), &lengths("wi", &wi))?;
        check_lengths(points.len(), &[("pdf", pdf.len())])?;
        self.runner.pdf(points, wi, pdf);
        Ok(())
    }
}

/// The lengths of the components of the argument `name`.
fn lengths<T: AsRef<[f32]>, const K: usize>(
    name: &'static str,
    slices: &[T; K],
) -> [(&'static str, usize); K] {
    std::array::from_fn(|i| (name, slices[i].as_ref().len()))
}
