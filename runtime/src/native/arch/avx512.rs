//! Sixteen lanes of AVX-512F.

use super::{MANTISSA_BITS, SQRT_HALF_BITS};
use crate::native::vector::{Simd, Task, Vector};
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Number of lanes.
const LANES: usize = 16;

/// Proof that this processor has AVX-512F.
#[derive(Clone, Copy)]
pub struct Avx512(());

/// Sixteen lanes.
#[derive(Clone, Copy)]
pub struct F32x16(__m512);

impl Avx512 {
    /// The proof, where the processor and the operating system support it.
    pub fn new() -> Option<Avx512> {
        is_x86_feature_detected!("avx512f").then_some(Avx512(()))
    }
}

/// The first `count` lanes, at most all.
#[inline(always)]
fn first(count: usize) -> __mmask16 {
    match count {
        0..LANES => (1 << count) - 1,
        _ => __mmask16::MAX,
    }
}

/// The one function of this tier: `task` is compiled into it.
#[target_feature(enable = "avx512f")]
fn compiled<T: Task>(task: T) {
    task.run();
}

impl Simd for Avx512 {
    type Vector = F32x16;

    #[inline(always)]
    fn splat(self, value: f32) -> F32x16 {
        // SAFETY: `self` proves AVX-512F.
        F32x16(unsafe { _mm512_set1_ps(value) })
    }

    #[inline(always)]
    fn load(self, source: &[f32]) -> F32x16 {
        // SAFETY: `self` proves AVX-512F; lanes that the mask leaves out are not read, and the others lie in `source`.
        F32x16(unsafe { _mm512_maskz_loadu_ps(first(source.len()), source.as_ptr()) })
    }

    fn enter<T: Task>(self, task: T) {
        // SAFETY: `self` proves AVX-512F.
        unsafe { compiled(task) }
    }
}

/// Implements an operator of two vectors by an intrinsic.
macro_rules! operator {
    ($($trait:ident $method:ident $intrinsic:ident)*) => {$(
        impl $trait for F32x16 {
            type Output = F32x16;
            #[inline(always)]
            fn $method(self, other: F32x16) -> F32x16 {
                // SAFETY: only an `Avx512` makes a first `F32x16`, so the processor has AVX-512F.
                F32x16(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    )*};
}
operator! { Add add _mm512_add_ps Sub sub _mm512_sub_ps Mul mul _mm512_mul_ps Div div _mm512_div_ps }

impl Neg for F32x16 {
    type Output = F32x16;
    #[inline(always)]
    fn neg(self) -> F32x16 {
        // SAFETY: as for the operators above.
        unsafe {
            let sign = _mm512_set1_epi32(i32::MIN);
            F32x16(_mm512_castsi512_ps(_mm512_xor_epi32(
                _mm512_castps_si512(self.0),
                sign,
            )))
        }
    }
}

impl Vector for F32x16 {
    const LANES: usize = LANES;
    const REGISTERS: usize = 32;
    type Mask = __mmask16;
    type Array = [f32; LANES];

    #[inline(always)]
    fn arrays(numbers: &[f32]) -> &[[f32; LANES]] {
        numbers.as_chunks().0
    }

    #[inline(always)]
    fn arrays_mut(numbers: &mut [f32]) -> &mut [[f32; LANES]] {
        numbers.as_chunks_mut().0
    }

    #[inline(always)]
    fn load(self, source: &[f32; LANES]) -> F32x16 {
        // SAFETY: AVX-512F as below, and the pointer is to 16 f32; the load needs no alignment.
        F32x16(unsafe { _mm512_loadu_ps(source.as_ptr()) })
    }

    #[inline(always)]
    fn write(self, out: &mut [f32; LANES]) {
        // SAFETY: AVX-512F as below, and the pointer is to 16 f32; the store needs no alignment.
        unsafe { _mm512_storeu_ps(out.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn splat(self, value: f32) -> F32x16 {
        // SAFETY: only an `Avx512` makes a first `F32x16`, so the processor has AVX-512F. So in all methods.
        F32x16(unsafe { _mm512_set1_ps(value) })
    }

    #[inline(always)]
    fn store(self, out: &mut [f32]) {
        // SAFETY: AVX-512F as above; lanes that the mask leaves out are not written, and the others lie in `out`.
        unsafe { _mm512_mask_storeu_ps(out.as_mut_ptr(), first(out.len()), self.0) }
    }

    #[inline(always)]
    fn mul_add(self, a: F32x16, b: F32x16) -> F32x16 {
        // SAFETY: AVX-512F as above.
        F32x16(unsafe { _mm512_fmadd_ps(self.0, a.0, b.0) })
    }

    #[inline(always)]
    fn min(self, other: F32x16) -> F32x16 {
        // SAFETY: AVX-512F as above.
        F32x16(unsafe { _mm512_min_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn max(self, other: F32x16) -> F32x16 {
        // SAFETY: AVX-512F as above.
        F32x16(unsafe { _mm512_max_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> F32x16 {
        // SAFETY: AVX-512F as above.
        F32x16(unsafe { _mm512_sqrt_ps(self.0) })
    }

    #[inline(always)]
    fn abs(self) -> F32x16 {
        // SAFETY: AVX-512F as above.
        F32x16(unsafe { _mm512_abs_ps(self.0) })
    }

    #[inline(always)]
    fn reciprocal(self) -> F32x16 {
        // SAFETY: AVX-512F as above.
        unsafe {
            // The estimate has relative error 2⁻¹⁴; one Newton step squares it.
            let estimate = _mm512_rcp14_ps(self.0);
            let error = _mm512_fnmadd_ps(self.0, estimate, _mm512_set1_ps(1.0));
            F32x16(_mm512_fmadd_ps(estimate, error, estimate))
        }
    }

    #[inline(always)]
    fn over(self, divisor: F32x16) -> F32x16 {
        // SAFETY: AVX-512F as above.
        unsafe {
            // As the reciprocal, from what the quotient leaves; the processor's division takes five times as long.
            let estimate = _mm512_rcp14_ps(divisor.0);
            let quotient = _mm512_mul_ps(self.0, estimate);
            let rest = _mm512_fnmadd_ps(divisor.0, quotient, self.0);
            F32x16(_mm512_fmadd_ps(rest, estimate, quotient))
        }
    }

    #[inline(always)]
    fn inverse_sqrt(self) -> F32x16 {
        // SAFETY: AVX-512F as above.
        unsafe {
            // As the reciprocal.
            let (half, estimate) = (_mm512_set1_ps(0.5), _mm512_rsqrt14_ps(self.0));
            let slope = _mm512_mul_ps(_mm512_mul_ps(self.0, half), estimate);
            let error = _mm512_fnmadd_ps(slope, estimate, half);
            F32x16(_mm512_fmadd_ps(estimate, error, estimate))
        }
    }

    #[inline(always)]
    fn less(self, other: F32x16) -> __mmask16 {
        // SAFETY: AVX-512F as above.
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0) }
    }

    #[inline(always)]
    fn select(mask: __mmask16, yes: F32x16, no: F32x16) -> F32x16 {
        // SAFETY: AVX-512F as above.
        F32x16(unsafe { _mm512_mask_blend_ps(mask, no.0, yes.0) })
    }

    #[inline(always)]
    fn scale_exponent(self, rounded: F32x16) -> F32x16 {
        // SAFETY: AVX-512F as above.
        unsafe {
            let exponent = _mm512_slli_epi32::<{ MANTISSA_BITS as u32 }>(_mm512_castps_si512(rounded.0));
            F32x16(_mm512_castsi512_ps(_mm512_add_epi32(
                _mm512_castps_si512(self.0),
                exponent,
            )))
        }
    }

    #[inline(always)]
    fn split_exponent(self) -> (F32x16, F32x16) {
        // SAFETY: AVX-512F as above.
        unsafe {
            let bits = _mm512_castps_si512(self.0);
            let above = _mm512_sub_epi32(bits, _mm512_set1_epi32(SQRT_HALF_BITS));
            let exponent = _mm512_srai_epi32::<{ MANTISSA_BITS as u32 }>(above);
            let mantissa = _mm512_sub_epi32(bits, _mm512_slli_epi32::<{ MANTISSA_BITS as u32 }>(exponent));
            (
                F32x16(_mm512_cvtepi32_ps(exponent)),
                F32x16(_mm512_castsi512_ps(mantissa)),
            )
        }
    }
}
