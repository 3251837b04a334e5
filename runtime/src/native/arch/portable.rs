//! Lanes in plain Rust, for the compiler to make vectors of: what other processors get.

use super::scalar::{F32x1, Scalar};
use crate::native::vector::{Several, Simd, Task, Vector};

/// Number of lanes.
const LANES: usize = 4;

/// Every processor runs this tier.
#[derive(Clone, Copy)]
pub struct Portable;

impl Simd for Portable {
    type Vector = Several<F32x1, LANES>;

    #[inline(always)]
    fn splat(self, value: f32) -> Self::Vector {
        Several::repeat(Scalar.splat(value))
    }

    #[inline(always)]
    fn load(self, source: &[f32]) -> Self::Vector {
        let mut padded = [0.0; LANES];
        for (to, from) in padded.iter_mut().zip(source) {
            *to = *from;
        }
        self.splat(0.0).load(&Self::Vector::arrays(&padded)[0])
    }

    fn enter<T: Task>(self, task: T) {
        task.run();
    }
}
