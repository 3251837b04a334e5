//! Our own kernels: batches through the networks of one material, sixteen, eight or one query per vector.
//!
//! Numeric code is written once over `vector::Vector`; `arch` holds lane operations only. A batch is
//! dispatched once, into a function compiled for the tier, and cut into tiles that go through all layers in
//! buffers that stay in the first-level cache. Results do not depend on how queries are batched.

pub(crate) mod arch;
pub(crate) mod math;
pub(crate) mod vector;

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
