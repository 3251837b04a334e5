//! The multiply-add peak of a processor's core, measured: what kernels are held against.

use bake_runtime::simd::{Simd, Tier, TierTask, Vector};
use std::hint::black_box;
use std::time::Instant;

/// Chains of multiply-adds that wait for nobody: more than the latency times the number of units, fewer than registers.
pub const CHAINS: usize = 12;
/// Steps of every chain: some tenths of a millisecond.
const STEPS: usize = 1 << 17;
/// Steps of the chain that counts cycles.
const CYCLES: usize = 1 << 18;

/// One measurement of the peak.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// Multiply-adds of a tier's lanes, 10⁹ operations a second, two for each.
    pub gflops: f64,
    /// Cycles of the core, 10⁹ a second.
    pub clock_ghz: f64,
}

impl Peak {
    /// Runs independent multiply-adds of `tier`, and a chain of rotations and differences, each of which takes a cycle, for
    /// the clock; about a millisecond. Whatever else runs on the core lowers what is found: of several, the highest is the
    /// peak ([`Peak::highest`]).
    ///
    /// # Errors
    /// [`bake_runtime::Error::Tier`] when the processor lacks `tier`.
    pub fn measure(tier: Tier) -> bake_runtime::Result<Peak> {
        // Processors take a while to wake the units of wide vectors.
        black_box(tier.dispatch(Chains { steps: STEPS / 2 })?);
        let started = Instant::now();
        black_box(tier.dispatch(Chains { steps: STEPS })?);
        let seconds = started.elapsed().as_secs_f64();
        let operations = (2 * CHAINS * STEPS * tier.lanes()) as f64;
        let started = Instant::now();
        let mut word = black_box(1u64);
        for _ in 0..CYCLES / 2 {
            word = word.rotate_left(7) ^ 0x5bd1_e995;
        }
        black_box(word);
        let cycles = started.elapsed().as_secs_f64();
        Ok(Peak {
            gflops: operations / seconds * 1e-9,
            clock_ghz: CYCLES as f64 / cycles * 1e-9,
        })
    }

    /// The highest of several measurements, and the highest clock.
    pub fn highest(peaks: &[Peak]) -> Peak {
        let start = Peak {
            gflops: 0.0,
            clock_ghz: 0.0,
        };
        peaks.iter().fold(start, |highest, peak| Peak {
            gflops: highest.gflops.max(peak.gflops),
            clock_ghz: highest.clock_ghz.max(peak.clock_ghz),
        })
    }

    /// Multiply-adds of whole vectors that it is a cycle.
    pub fn vectors_per_cycle(&self, tier: Tier) -> f64 {
        self.gflops / (2.0 * tier.lanes() as f64 * self.clock_ghz)
    }
}

/// `steps` multiply-adds in each of [`CHAINS`] chains.
pub struct Chains {
    /// Steps of each chain.
    pub steps: usize,
}

impl TierTask for Chains {
    type Out = f32;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> f32 {
        let (a, b) = (simd.splat(black_box(0.999)), simd.splat(black_box(1e-3)));
        let mut sums = [b; CHAINS];
        for _ in 0..self.steps {
            for sum in &mut sums {
                *sum = sum.mul_add(a, b);
            }
        }
        let mut total = b;
        for sum in sums {
            total = total + sum;
        }
        let mut out = [0.0];
        total.store(&mut out);
        out[0]
    }
}
