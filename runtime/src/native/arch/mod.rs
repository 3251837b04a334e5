//! Lane operations per instruction set. These are the only files of this crate with `unsafe`, and the only
//! ones that know an architecture.

pub mod portable;
pub mod scalar;

#[cfg(target_arch = "x86_64")]
#[expect(
    unsafe_code,
    reason = "vendor intrinsics are unsafe outside functions compiled for their processor"
)]
pub mod avx2;

#[cfg(target_arch = "x86_64")]
#[expect(
    unsafe_code,
    reason = "vendor intrinsics are unsafe outside functions compiled for their processor"
)]
pub mod avx512;

/// f32 bits of √½: mantissas split there lie in `[√½, √2)`.
const SQRT_HALF_BITS: i32 = std::f32::consts::FRAC_1_SQRT_2.to_bits() as i32;

/// Bits of an f32 mantissa.
const MANTISSA_BITS: i32 = 23;
