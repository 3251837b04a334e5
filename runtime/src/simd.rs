//! The vectors of our own kernels, for kernels of other crates: one formula for every tier, no `unsafe`.
//!
//! A kernel is a [`TierTask`]: [`Tier::dispatch`] finds the processor's proof and runs the task in a function
//! compiled for the tier. What must be compiled with it is `#[inline(always)]`, or enters again by
//! [`Simd::enter`] as a function of its own.

use crate::error::Result;
use crate::native::TierJob;

pub use crate::native::Tier;
pub use crate::native::math::{exp, ln, sigmoid, sin_cos};
pub use crate::native::vector::{Several, Simd, Task, Vector};

/// A job written over any tier's vectors.
pub trait TierTask {
    /// What it gives.
    type Out;

    /// Does it, compiled with the instructions of `simd` as far as it is `#[inline(always)]`.
    fn run<S: Simd>(self, simd: S) -> Self::Out;
}

/// A [`TierTask`] on its way into the function compiled for its tier.
struct Entering<'a, S, T: TierTask> {
    simd: S,
    task: T,
    out: &'a mut Option<T::Out>,
}

impl<S: Simd, T: TierTask> Task for Entering<'_, S, T> {
    #[inline(always)]
    fn run(self) {
        *self.out = Some(self.task.run(self.simd));
    }
}

impl Tier {
    /// Runs `task` with this tier's instructions.
    ///
    /// # Errors
    /// [`Error::Tier`] when the processor lacks them.
    pub fn dispatch<T: TierTask>(self, task: T) -> Result<T::Out> {
        self.with(Dispatched(task))
    }
}

/// A [`TierTask`] that gets its tier's proof.
struct Dispatched<T>(T);

impl<T: TierTask> TierJob for Dispatched<T> {
    type Out = T::Out;

    fn run<S: Simd, const N: usize>(self, simd: S) -> T::Out {
        let mut out = None;
        simd.enter(Entering {
            simd,
            task: self.0,
            out: &mut out,
        });
        out.expect("entering runs the task")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::native::vector::ROUND;

    /// Doubles whole vectors through arrays, and the rest through slices.
    struct Double<'a>(&'a mut [f32]);

    impl TierTask for Double<'_> {
        type Out = usize;

        #[inline(always)]
        fn run<S: Simd>(self, simd: S) -> usize {
            let zero = simd.splat(0.0);
            for array in S::Vector::arrays_mut(self.0) {
                let value = zero.load(array);
                (value + value).write(array);
            }
            let whole = self.0.len() / S::Vector::LANES * S::Vector::LANES;
            let rest = simd.load(&self.0[whole..]);
            (rest + rest).store(&mut self.0[whole..]);
            S::Vector::arrays(self.0).len()
        }
    }

    #[test]
    fn every_tier_runs_a_task_on_its_own_lanes() {
        for tier in Tier::available() {
            let mut numbers: Vec<f32> = (0..37).map(|i| i as f32).collect();
            assert_eq!(tier.dispatch(Double(&mut numbers)).ok(), Some(37 / tier.lanes()));
            assert!(numbers.iter().enumerate().all(|(i, &n)| n == 2.0 * i as f32));
        }
    }

    /// Numbers of both signs and many sizes, none of them 0.
    fn numbers(shift: f32) -> Vec<f32> {
        (0..48)
            .map(|i| (i as f32 - 20.5) * 1.37f32.powi(i - 24) + shift)
            .collect()
    }

    /// All that vectors can do, written for any of them: results one after the other.
    struct Everything;

    impl Everything {
        #[inline(always)]
        fn of<V: Vector>(zero: V) -> Vec<Vec<f32>> {
            let (a, b) = (numbers(0.25), numbers(-3.0));
            let mut results = vec![vec![0.0; a.len()]; 20];
            for (i, (a, b)) in V::arrays(&a).iter().zip(V::arrays(&b)).enumerate() {
                let (a, b) = (zero.load(a), zero.load(b));
                let size = a.abs() + a.splat(1.0);
                let (exponent, mantissa) = size.split_exponent();
                let all = [
                    a + b,
                    a - b,
                    a * b,
                    a / b,
                    -a,
                    a.mul_add(b, a),
                    a.mul_add_const(b, 2.0),
                    a.min(b),
                    a.max(b),
                    a.clamp(-1.0, 2.0),
                    a.abs(),
                    size.sqrt(),
                    size.reciprocal(),
                    V::select(a.less(b), a, size),
                    size.scale_exponent(a.splat(ROUND + 3.0)),
                    exponent,
                    mantissa,
                    sigmoid(a),
                    ln(size),
                ];
                for (result, value) in results.iter_mut().zip(all) {
                    value.write(&mut V::arrays_mut(result)[i]);
                }
                a.store(&mut results[19][i * V::LANES..]);
            }
            results
        }
    }

    impl TierTask for Everything {
        type Out = [Vec<Vec<f32>>; 2];

        #[inline(always)]
        fn run<S: Simd>(self, simd: S) -> [Vec<Vec<f32>>; 2] {
            let zero = simd.splat(0.0);
            [
                Everything::of(zero),
                Everything::of(Several::<S::Vector, 3>::repeat(zero)),
            ]
        }
    }

    #[test]
    fn vectors_in_step_do_what_each_does_alone() {
        for tier in Tier::available() {
            let [alone, in_step] = tier.dispatch(Everything).expect("an available tier");
            assert!(alone.iter().flatten().all(|value| value.is_finite()));
            assert_eq!(alone, in_step, "{tier:?}");
            assert_eq!(alone[19], numbers(0.25));
        }
    }
}
