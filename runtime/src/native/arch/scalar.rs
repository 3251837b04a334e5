//! One lane in plain Rust, for any processor. No fused multiply-add: without the instruction it would be a
//! library call.

use super::{MANTISSA_BITS, SQRT_HALF_BITS};
use crate::native::vector::{Simd, Task, Vector};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Every processor runs this tier.
#[derive(Clone, Copy)]
pub struct Scalar;

/// One lane.
#[derive(Clone, Copy)]
pub struct F32x1(f32);

impl Simd for Scalar {
    type Vector = F32x1;

    #[inline(always)]
    fn splat(self, value: f32) -> F32x1 {
        F32x1(value)
    }

    #[inline(always)]
    fn load(self, source: &[f32]) -> F32x1 {
        F32x1(source.first().copied().unwrap_or(0.0))
    }

    fn enter<T: Task>(self, task: T) {
        task.run();
    }
}

/// Implements an operator by f32's own.
macro_rules! operator {
    ($($trait:ident $method:ident)*) => {$(
        impl $trait for F32x1 {
            type Output = F32x1;
            #[inline(always)]
            fn $method(self, other: F32x1) -> F32x1 {
                F32x1(self.0.$method(other.0))
            }
        }
    )*};
}
operator! { Add add Sub sub Mul mul Div div }

impl Neg for F32x1 {
    type Output = F32x1;
    #[inline(always)]
    fn neg(self) -> F32x1 {
        F32x1(-self.0)
    }
}

impl Vector for F32x1 {
    const LANES: usize = 1;
    type Mask = bool;
    type Array = [f32; 1];

    #[inline(always)]
    fn arrays(numbers: &[f32]) -> &[[f32; 1]] {
        numbers.as_chunks().0
    }

    #[inline(always)]
    fn arrays_mut(numbers: &mut [f32]) -> &mut [[f32; 1]] {
        numbers.as_chunks_mut().0
    }

    #[inline(always)]
    fn load(self, source: &[f32; 1]) -> F32x1 {
        F32x1(source[0])
    }

    #[inline(always)]
    fn write(self, out: &mut [f32; 1]) {
        *out = [self.0];
    }

    #[inline(always)]
    fn splat(self, value: f32) -> F32x1 {
        F32x1(value)
    }

    #[inline(always)]
    fn store(self, out: &mut [f32]) {
        if let Some(first) = out.first_mut() {
            *first = self.0;
        }
    }

    #[inline(always)]
    fn mul_add(self, a: F32x1, b: F32x1) -> F32x1 {
        F32x1(self.0 * a.0 + b.0)
    }

    #[inline(always)]
    fn min(self, other: F32x1) -> F32x1 {
        F32x1(if self.0 < other.0 { self.0 } else { other.0 })
    }

    #[inline(always)]
    fn max(self, other: F32x1) -> F32x1 {
        F32x1(if self.0 > other.0 { self.0 } else { other.0 })
    }

    #[inline(always)]
    fn sqrt(self) -> F32x1 {
        F32x1(self.0.sqrt())
    }

    #[inline(always)]
    fn abs(self) -> F32x1 {
        F32x1(self.0.abs())
    }

    #[inline(always)]
    fn reciprocal(self) -> F32x1 {
        F32x1(1.0 / self.0)
    }

    #[inline(always)]
    fn less(self, other: F32x1) -> bool {
        self.0 < other.0
    }

    #[inline(always)]
    fn select(mask: bool, yes: F32x1, no: F32x1) -> F32x1 {
        if mask { yes } else { no }
    }

    #[inline(always)]
    fn scale_exponent(self, rounded: F32x1) -> F32x1 {
        let exponent = rounded.0.to_bits() << MANTISSA_BITS;
        F32x1(f32::from_bits(self.0.to_bits().wrapping_add(exponent)))
    }

    #[inline(always)]
    fn split_exponent(self) -> (F32x1, F32x1) {
        let bits = self.0.to_bits() as i32;
        let exponent = (bits - SQRT_HALF_BITS) >> MANTISSA_BITS;
        let mantissa = bits - (exponent << MANTISSA_BITS);
        (F32x1(exponent as f32), F32x1(f32::from_bits(mantissa as u32)))
    }
}
