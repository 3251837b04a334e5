//! Sets of instructions that the kernels are compiled for, and how one is chosen.

use super::arch;
use super::arch::portable::Portable;
use super::arch::scalar::Scalar;
use super::vector::Simd;
use crate::error::{Error, Result};

/// The environment variable that names the tier to use, in [`Tier::chosen`].
pub const TIER_VARIABLE: &str = "BAKE_TIER";

/// A set of instructions that the kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tier {
    /// One lane, any processor: what the others are held against, never made fast.
    Scalar,
    /// Four lanes in plain Rust, any processor: what the compiler makes of them.
    Portable,
    /// Eight lanes: AVX2 and FMA.
    Avx2,
    /// Sixteen lanes: AVX-512F.
    Avx512,
}

/// What is done with the proof that a processor has a tier.
pub(crate) trait TierJob {
    /// What it gives.
    type Out;

    /// Does it; the tier's tiles have `N` vectors.
    fn run<S: Simd, const N: usize>(self, simd: S) -> Self::Out;
}

/// Asks for the proof alone.
struct Nothing;

impl TierJob for Nothing {
    type Out = ();

    fn run<S: Simd, const N: usize>(self, _: S) {}
}

impl Tier {
    /// All tiers, slowest first.
    pub const ALL: [Tier; 4] = [Tier::Scalar, Tier::Portable, Tier::Avx2, Tier::Avx512];

    /// The tiers that this processor has, slowest first.
    pub fn available() -> Vec<Tier> {
        Tier::ALL.into_iter().filter(|tier| tier.exists()).collect()
    }

    fn exists(self) -> bool {
        self.with(Nothing).is_ok()
    }

    /// Gives `job` this tier's proof.
    ///
    /// # Errors
    /// [`Error::Tier`] when the processor lacks its instructions.
    pub(crate) fn with<J: TierJob>(self, job: J) -> Result<J::Out> {
        // The numbers are those of vectors per tile: the sums of a block of rows stay in the tier's registers.
        let out = match self {
            Tier::Scalar => Some(job.run::<_, 4>(Scalar)),
            Tier::Portable => Some(job.run::<_, 3>(Portable)),
            #[cfg(target_arch = "x86_64")]
            Tier::Avx2 => arch::avx2::Avx2::new().map(|simd| job.run::<_, 2>(simd)),
            #[cfg(target_arch = "x86_64")]
            Tier::Avx512 => arch::avx512::Avx512::new().map(|simd| job.run::<_, 4>(simd)),
            #[cfg(not(target_arch = "x86_64"))]
            Tier::Avx2 | Tier::Avx512 => None,
        };
        out.ok_or(Error::Tier(self.name()))
    }

    /// The fastest tier of this processor.
    pub fn best() -> Tier {
        Tier::available().last().copied().unwrap_or(Tier::Portable)
    }

    /// The tier that the environment variable [`TIER_VARIABLE`] names, else the fastest.
    ///
    /// # Errors
    /// [`Error::Query`] when it names none, [`Error::Tier`] when this processor lacks the one that it names.
    pub fn chosen() -> Result<Tier> {
        match std::env::var_os(TIER_VARIABLE).filter(|name| !name.is_empty()) {
            Some(name) => Tier::named(&name.to_string_lossy()),
            None => Ok(Tier::best()),
        }
    }

    /// The tier called `name`, as [`Tier::name`] has it.
    ///
    /// # Errors
    /// [`Error::Query`] when there is none, [`Error::Tier`] when this processor lacks it.
    pub fn named(name: &str) -> Result<Tier> {
        let Some(tier) = Tier::ALL.into_iter().find(|tier| tier.name() == name) else {
            let names = Tier::ALL.map(Tier::name).join(", ");
            return Err(Error::query(
                TIER_VARIABLE,
                format!("is `{name}`, but must be one of {names}"),
            ));
        };
        match tier.exists() {
            true => Ok(tier),
            false => Err(Error::Tier(tier.name())),
        }
    }

    /// Queries, or rows of a layer, that one of its vectors holds.
    pub fn lanes(self) -> usize {
        match self {
            Tier::Scalar => 1,
            Tier::Portable => 4,
            Tier::Avx2 => 8,
            Tier::Avx512 => 16,
        }
    }

    /// The name in reports and in [`TIER_VARIABLE`].
    pub fn name(self) -> &'static str {
        match self {
            Tier::Scalar => "scalar",
            Tier::Portable => "portable",
            Tier::Avx2 => "avx2",
            Tier::Avx512 => "avx512",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiers_go_by_their_names() {
        for tier in Tier::available() {
            assert_eq!(Tier::named(tier.name()).ok(), Some(tier));
        }
        let error = Tier::named("sse9").expect_err("no such tier").to_string();
        assert!(error.contains("sse9") && error.contains("portable"), "{error}");
        assert_eq!(Tier::available().last(), Some(&Tier::best()));
    }
}
