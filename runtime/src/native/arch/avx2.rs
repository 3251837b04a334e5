//! Eight lanes of AVX2 with FMA.

use super::{MANTISSA_BITS, SQRT_HALF_BITS};
use crate::native::vector::{Simd, Task, Vector};
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Number of lanes.
const LANES: usize = 8;

/// Proof that this processor has AVX2 and FMA.
#[derive(Clone, Copy)]
pub struct Avx2(());

/// Eight lanes.
#[derive(Clone, Copy)]
pub struct F32x8(__m256);

impl Avx2 {
    /// The proof, where the processor and the operating system support it.
    pub fn new() -> Option<Avx2> {
        (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Avx2(()))
    }
}

/// All bits of the first `count` lanes, of which there are fewer than all.
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
unsafe fn first(count: usize) -> __m256i {
    // SAFETY: the caller's.
    unsafe {
        _mm256_cmpgt_epi32(
            _mm256_set1_epi32(count as i32),
            _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7),
        )
    }
}

/// The one function of this tier: `task` is compiled into it.
#[target_feature(enable = "avx2,fma")]
fn compiled<T: Task>(task: T) {
    task.run();
}

impl Simd for Avx2 {
    type Vector = F32x8;

    #[inline(always)]
    fn splat(self, value: f32) -> F32x8 {
        // SAFETY: `self` proves AVX2 and FMA.
        F32x8(unsafe { _mm256_set1_ps(value) })
    }

    #[inline(always)]
    fn load(self, source: &[f32]) -> F32x8 {
        let vector = match source.first_chunk::<LANES>() {
            // SAFETY: `self` proves AVX2 and FMA, and the pointer is to 8 f32; the load needs no alignment.
            Some(whole) => unsafe { _mm256_loadu_ps(whole.as_ptr()) },
            // SAFETY: the same; lanes that the mask leaves out are not read, and the others lie in `source`.
            None => unsafe { _mm256_maskload_ps(source.as_ptr(), first(source.len())) },
        };
        F32x8(vector)
    }

    fn enter<T: Task>(self, task: T) {
        // SAFETY: `self` proves AVX2 and FMA.
        unsafe { compiled(task) }
    }
}

/// Implements an operator of two vectors by an intrinsic.
macro_rules! operator {
    ($($trait:ident $method:ident $intrinsic:ident)*) => {$(
        impl $trait for F32x8 {
            type Output = F32x8;
            #[inline(always)]
            fn $method(self, other: F32x8) -> F32x8 {
                // SAFETY: only an `Avx2` makes a first `F32x8`, so the processor has AVX2 and FMA.
                F32x8(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    )*};
}
operator! { Add add _mm256_add_ps Sub sub _mm256_sub_ps Mul mul _mm256_mul_ps Div div _mm256_div_ps }

impl Neg for F32x8 {
    type Output = F32x8;
    #[inline(always)]
    fn neg(self) -> F32x8 {
        // SAFETY: as for the operators above.
        unsafe { F32x8(_mm256_xor_ps(self.0, _mm256_set1_ps(-0.0))) }
    }
}

impl Vector for F32x8 {
    const LANES: usize = LANES;
    type Mask = __m256;
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
    fn load(self, source: &[f32; LANES]) -> F32x8 {
        // SAFETY: AVX2 and FMA as below, and the pointer is to 8 f32; the load needs no alignment.
        F32x8(unsafe { _mm256_loadu_ps(source.as_ptr()) })
    }

    #[inline(always)]
    fn write(self, out: &mut [f32; LANES]) {
        // SAFETY: AVX2 and FMA as below, and the pointer is to 8 f32; the store needs no alignment.
        unsafe { _mm256_storeu_ps(out.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn splat(self, value: f32) -> F32x8 {
        // SAFETY: only an `Avx2` makes a first `F32x8`, so the processor has AVX2 and FMA. So in all methods.
        F32x8(unsafe { _mm256_set1_ps(value) })
    }

    #[inline(always)]
    fn store(self, out: &mut [f32]) {
        if let Some(whole) = out.first_chunk_mut::<LANES>() {
            // SAFETY: AVX2 and FMA as above, and the pointer is to 8 f32; the store needs no alignment.
            unsafe { _mm256_storeu_ps(whole.as_mut_ptr(), self.0) }
        } else {
            // SAFETY: AVX2 and FMA as above; lanes that the mask leaves out are not written, and the others lie in `out`.
            unsafe { _mm256_maskstore_ps(out.as_mut_ptr(), first(out.len()), self.0) }
        }
    }

    #[inline(always)]
    fn mul_add(self, a: F32x8, b: F32x8) -> F32x8 {
        // SAFETY: AVX2 and FMA as above.
        F32x8(unsafe { _mm256_fmadd_ps(self.0, a.0, b.0) })
    }

    #[inline(always)]
    fn min(self, other: F32x8) -> F32x8 {
        // SAFETY: AVX2 and FMA as above.
        F32x8(unsafe { _mm256_min_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn max(self, other: F32x8) -> F32x8 {
        // SAFETY: AVX2 and FMA as above.
        F32x8(unsafe { _mm256_max_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> F32x8 {
        // SAFETY: AVX2 and FMA as above.
        F32x8(unsafe { _mm256_sqrt_ps(self.0) })
    }

    #[inline(always)]
    fn abs(self) -> F32x8 {
        // SAFETY: AVX2 and FMA as above.
        F32x8(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
    }

    #[inline(always)]
    fn reciprocal(self) -> F32x8 {
        // SAFETY: AVX2 and FMA as above.
        F32x8(unsafe { _mm256_div_ps(_mm256_set1_ps(1.0), self.0) })
    }

    #[inline(always)]
    fn less(self, other: F32x8) -> __m256 {
        // SAFETY: AVX2 and FMA as above.
        unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0) }
    }

    #[inline(always)]
    fn select(mask: __m256, yes: F32x8, no: F32x8) -> F32x8 {
        // SAFETY: AVX2 and FMA as above.
        F32x8(unsafe { _mm256_blendv_ps(no.0, yes.0, mask) })
    }

    #[inline(always)]
    fn scale_exponent(self, rounded: F32x8) -> F32x8 {
        // SAFETY: AVX2 and FMA as above.
        unsafe {
            let exponent = _mm256_slli_epi32::<MANTISSA_BITS>(_mm256_castps_si256(rounded.0));
            F32x8(_mm256_castsi256_ps(_mm256_add_epi32(
                _mm256_castps_si256(self.0),
                exponent,
            )))
        }
    }

    #[inline(always)]
    fn split_exponent(self) -> (F32x8, F32x8) {
        // SAFETY: AVX2 and FMA as above.
        unsafe {
            let bits = _mm256_castps_si256(self.0);
            let above = _mm256_sub_epi32(bits, _mm256_set1_epi32(SQRT_HALF_BITS));
            let exponent = _mm256_srai_epi32::<MANTISSA_BITS>(above);
            let mantissa = _mm256_sub_epi32(bits, _mm256_slli_epi32::<MANTISSA_BITS>(exponent));
            (
                F32x8(_mm256_cvtepi32_ps(exponent)),
                F32x8(_mm256_castsi256_ps(mantissa)),
            )
        }
    }
}
