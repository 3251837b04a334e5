//! Our own kernels: batches through the networks of one material, sixteen, eight or one query per vector.
//!
//! Numeric code is written once over `vector::Vector`; `arch` holds lane operations only. A batch is
//! dispatched once, into a function compiled for the tier, and cut into tiles that go through all layers in
//! buffers that stay in the first-level cache. Results do not depend on how queries are batched.

pub(crate) mod arch;
mod density;
mod kernel;
mod lobe;
pub(crate) mod math;
mod program;
mod sample;
mod tile;
pub(crate) mod vector;

use crate::backend::{Backend, BakedMaterial, check_lengths};
use crate::error::{Error, Result};
use crate::spec::Role;
use arch::scalar::Scalar;
use density::{Densities, Density};
use sample::{Jacobian, Learned, Sampler};
use vector::Simd;

/// A set of instructions that the kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tier {
    /// One lane, any processor.
    Scalar,
    /// Eight lanes: AVX2 and FMA.
    Avx2,
    /// Sixteen lanes: AVX-512F.
    Avx512,
}

impl Tier {
    /// The tiers that this processor has, slowest first.
    pub fn available() -> Vec<Tier> {
        let all = [Tier::Scalar, Tier::Avx2, Tier::Avx512];
        all.into_iter().filter(|tier| tier.exists()).collect()
    }

    fn exists(self) -> bool {
        match self {
            Tier::Scalar => true,
            #[cfg(target_arch = "x86_64")]
            Tier::Avx2 => arch::avx2::Avx2::new().is_some(),
            #[cfg(target_arch = "x86_64")]
            Tier::Avx512 => arch::avx512::Avx512::new().is_some(),
            #[cfg(not(target_arch = "x86_64"))]
            Tier::Avx2 | Tier::Avx512 => false,
        }
    }

    /// The fastest tier of this processor.
    pub fn best() -> Tier {
        Tier::available().last().copied().unwrap_or(Tier::Scalar)
    }

    /// The name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Tier::Scalar => "scalar",
            Tier::Avx2 => "avx2",
            Tier::Avx512 => "avx512",
        }
    }
}

/// The networks of one material, packed for a tier, with the buffers they run in: no call allocates.
pub struct NativeBackend {
    runner: Box<dyn Backend>,
}

impl NativeBackend {
    /// Packs `material` for `tier`.
    ///
    /// # Errors
    /// [`Error::Tier`] when the processor lacks `tier`, [`Error::Network`] when a network's weights contradict
    /// its specification.
    pub fn new(material: &BakedMaterial, tier: Tier) -> Result<NativeBackend> {
        // The number is that of vectors per tile: with four output rows the sums stay in the tier's registers.
        let runner: Box<dyn Backend> = match tier {
            Tier::Scalar => Box::new(Runner::<Scalar, 4>::new(material, Scalar)?),
            #[cfg(target_arch = "x86_64")]
            Tier::Avx2 => {
                let simd = arch::avx2::Avx2::new().ok_or(Error::Tier(tier.name()))?;
                Box::new(Runner::<_, 2>::new(material, simd)?)
            }
            #[cfg(target_arch = "x86_64")]
            Tier::Avx512 => {
                let simd = arch::avx512::Avx512::new().ok_or(Error::Tier(tier.name()))?;
                Box::new(Runner::<_, 4>::new(material, simd)?)
            }
            #[cfg(not(target_arch = "x86_64"))]
            Tier::Avx2 | Tier::Avx512 => return Err(Error::Tier(tier.name())),
        };
        Ok(NativeBackend { runner })
    }
}

impl Backend for NativeBackend {
    fn sample_learned(
        &mut self,
        wo: [&[f32]; 3],
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        weight: [&mut [f32]; 3],
    ) -> Result<()> {
        let n = wo[0].len();
        check_lengths(n, &lengths("wo", &wo))?;
        check_lengths(n, &lengths("u", &u))?;
        check_lengths(n, &lengths("wi", &wi))?;
        check_lengths(n, &lengths("weight", &weight))?;
        self.runner.sample_learned(wo, u, wi, weight)
    }

    fn sample_jacobian(
        &mut self,
        wo: [&[f32]; 3],
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        jacobian: &mut [f32],
    ) -> Result<()> {
        let n = wo[0].len();
        check_lengths(n, &lengths("wo", &wo))?;
        check_lengths(n, &lengths("u", &u))?;
        check_lengths(n, &lengths("wi", &wi))?;
        check_lengths(n, &[("jacobian", jacobian.len())])?;
        self.runner.sample_jacobian(wo, u, wi, jacobian)
    }

    fn eval(&mut self, wo: [&[f32]; 3], wi: [&[f32]; 3], f_cos: [&mut [f32]; 3]) -> Result<()> {
        let n = wo[0].len();
        check_lengths(n, &lengths("wo", &wo))?;
        check_lengths(n, &lengths("wi", &wi))?;
        check_lengths(n, &lengths("f_cos", &f_cos))?;
        self.runner.eval(wo, wi, f_cos)
    }

    fn pdf(&mut self, wo: [&[f32]; 3], wi: [&[f32]; 3], pdf: &mut [f32]) -> Result<()> {
        let n = wo[0].len();
        check_lengths(n, &lengths("wo", &wo))?;
        check_lengths(n, &lengths("wi", &wi))?;
        check_lengths(n, &[("pdf", pdf.len())])?;
        self.runner.pdf(wo, wi, pdf)
    }
}

/// The lengths of the components of the argument `name`.
fn lengths<T: AsRef<[f32]>, const K: usize>(
    name: &'static str,
    slices: &[T; K],
) -> [(&'static str, usize); K] {
    std::array::from_fn(|i| (name, slices[i].as_ref().len()))
}

/// The networks packed for one tier, `N` vectors of queries per tile. Lengths are checked by the caller.
struct Runner<S: Simd, const N: usize> {
    simd: S,
    sampler: Sampler<S::Vector, N>,
    eval: Densities<S::Vector, N>,
    pdf: Densities<S::Vector, N>,
}

impl<S: Simd, const N: usize> Runner<S, N> {
    fn new(material: &BakedMaterial, simd: S) -> Result<Self> {
        let zero = simd.splat(0.0);
        Ok(Runner {
            simd,
            sampler: Sampler::new(&material.sample, zero)?,
            eval: Densities::new(&material.eval, Role::Eval, zero)?,
            pdf: Densities::new(&material.pdf, Role::Pdf, zero)?,
        })
    }
}

impl<S: Simd, const N: usize> Backend for Runner<S, N> {
    fn sample_learned(
        &mut self,
        wo: [&[f32]; 3],
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        weight: [&mut [f32]; 3],
    ) -> Result<()> {
        self.simd.enter(Learned {
            simd: self.simd,
            sampler: &mut self.sampler,
            wo,
            u,
            wi,
            weight,
        });
        Ok(())
    }

    fn sample_jacobian(
        &mut self,
        wo: [&[f32]; 3],
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        jacobian: &mut [f32],
    ) -> Result<()> {
        self.simd.enter(Jacobian {
            simd: self.simd,
            sampler: &mut self.sampler,
            wo,
            u,
            wi,
            jacobian,
        });
        Ok(())
    }

    fn eval(&mut self, wo: [&[f32]; 3], wi: [&[f32]; 3], f_cos: [&mut [f32]; 3]) -> Result<()> {
        self.simd.enter(Density {
            simd: self.simd,
            densities: &mut self.eval,
            wo,
            wi,
            out: f_cos,
        });
        Ok(())
    }

    fn pdf(&mut self, wo: [&[f32]; 3], wi: [&[f32]; 3], pdf: &mut [f32]) -> Result<()> {
        self.simd.enter(Density {
            simd: self.simd,
            densities: &mut self.pdf,
            wo,
            wi,
            out: [pdf],
        });
        Ok(())
    }
}
