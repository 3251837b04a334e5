//! What a processor must offer: lanes of f32 and a way to enter code compiled for them. Every formula of this
//! module tree is written once over these traits; the arch files implement them and nothing else.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Adding this to |t| < 2²² leaves round(t) in the low mantissa bits; subtracting it again gives round(t).
pub const ROUND: f32 = 1.5 * (1 << 23) as f32;

/// Proof that this processor runs a tier's instructions: only a successful detection makes one.
pub trait Simd: Copy + Send + Sync + 'static {
    /// The lanes of this tier.
    type Vector: Vector;

    /// `value` in every lane.
    fn splat(self, value: f32) -> Self::Vector;

    /// The first [`Vector::LANES`] elements of `source`; lanes beyond its end are 0.
    fn load(self, source: &[f32]) -> Self::Vector;

    /// Runs `task` in a function compiled with this tier's instructions, into which everything marked
    /// `#[inline(always)]` is compiled with them.
    fn enter<T: Task>(self, task: T);
}

/// A job over a whole batch.
pub trait Task {
    /// Does it. Implementations are `#[inline(always)]`, and so is all they call on vectors.
    fn run(self);
}

/// Lanes of f32. A value exists only where a [`Simd`] made one, so its methods need no further proof.
pub trait Vector:
    Copy
    + Send
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// Number of lanes.
    const LANES: usize;

    /// Vectors that the processor's registers hold.
    const REGISTERS: usize = 16;

    /// One truth value per lane.
    type Mask: Copy;

    /// As many numbers as there are lanes.
    type Array: Copy + Send + Sync;

    /// `numbers` cut into whole vectors, without what is left over.
    fn arrays(numbers: &[f32]) -> &[Self::Array];

    /// As [`Vector::arrays`], to be written.
    fn arrays_mut(numbers: &mut [f32]) -> &mut [Self::Array];

    /// The numbers of `source`; `self` is only the proof.
    fn load(self, source: &Self::Array) -> Self;

    /// Writes the lanes to `out`.
    fn write(self, out: &mut Self::Array);

    /// `value` in every lane; `self` is only the proof.
    fn splat(self, value: f32) -> Self;

    /// Writes the lanes to `out`, as many as fit.
    fn store(self, out: &mut [f32]);

    /// self·a + b, rounded once where the tier has fused multiply-add and twice elsewhere.
    fn mul_add(self, a: Self, b: Self) -> Self;

    /// The smaller; `other` where `self` is NaN.
    fn min(self, other: Self) -> Self;

    /// The larger; `other` where `self` is NaN.
    fn max(self, other: Self) -> Self;

    /// Square root, correctly rounded.
    fn sqrt(self) -> Self;

    /// Absolute value.
    fn abs(self) -> Self;

    /// 1/self within 2 ULP, for |self| in `[1, 2¹²⁵]`.
    fn reciprocal(self) -> Self;

    /// self/divisor within 2 ULP, where |divisor| is in `[2⁻¹²⁵, 2¹²⁵]` and the result a normal number or 0.
    #[inline(always)]
    fn over(self, divisor: Self) -> Self {
        self / divisor
    }

    /// 1/√self within 2 ULP, for positive normal numbers.
    #[inline(always)]
    fn inverse_sqrt(self) -> Self {
        self.splat(1.0) / self.sqrt()
    }

    /// Where self < other; false where either is NaN.
    fn less(self, other: Self) -> Self::Mask;

    /// `yes` where `mask` holds, `no` elsewhere.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;

    /// self·2ⁿ for `rounded` = n + `ROUND`, as long as self and the result are normal numbers.
    fn scale_exponent(self, rounded: Self) -> Self;

    /// (e, m) with self = m·2ᵉ and m in `[√½, √2)`, for positive normal numbers.
    fn split_exponent(self) -> (Self, Self);

    /// self limited to `[low, high]`; `low` where self is NaN.
    #[inline(always)]
    fn clamp(self, low: f32, high: f32) -> Self {
        self.max(self.splat(low)).min(self.splat(high))
    }

    /// self·a + b for a constant b.
    #[inline(always)]
    fn mul_add_const(self, a: Self, b: f32) -> Self {
        self.mul_add(a, self.splat(b))
    }
}

/// Lanes of the widest tier.
pub const LANES_MAX: usize = 16;

/// The lanes of `v`, zeros beyond.
#[inline(always)]
pub fn lanes<V: Vector>(v: V) -> [f32; LANES_MAX] {
    let mut lanes = [0.0; LANES_MAX];
    v.store(&mut lanes[..V::LANES]);
    lanes
}

/// `N` vectors in step, as one of `N` times the lanes: processors start an operation on the next vector while
/// they wait for that on the last, which hides the latency of long formulas.
///
/// Loops are spelled out: closures within the standard library's would not be compiled for the tier.
#[derive(Clone, Copy)]
pub struct Several<V, const N: usize>(pub [V; N]);

impl<V: Vector, const N: usize> Several<V, N> {
    /// `vector`, `N` times.
    #[inline(always)]
    pub fn repeat(vector: V) -> Self {
        Several([vector; N])
    }
}

/// Implements methods and operators vector by vector.
macro_rules! in_step {
    ($($method:ident($($other:ident),*))*) => {$(
        #[inline(always)]
        fn $method(mut self $(, $other: Self)*) -> Self {
            for i in 0..N {
                self.0[i] = self.0[i].$method($($other.0[i]),*);
            }
            self
        }
    )*};
    ($($trait:ident: $method:ident($($other:ident)?);)*) => {$(
        impl<V: Vector, const N: usize> $trait for Several<V, N> {
            type Output = Self;
            in_step! { $method($($other)?) }
        }
    )*};
}
in_step! {
    Add: add(other);
    Sub: sub(other);
    Mul: mul(other);
    Div: div(other);
    Neg: neg();
}

impl<V: Vector, const N: usize> Vector for Several<V, N> {
    const LANES: usize = N * V::LANES;
    type Mask = [V::Mask; N];
    type Array = [V::Array; N];

    in_step! {
        mul_add(a, b) min(other) max(other) sqrt() abs() reciprocal() over(divisor) inverse_sqrt() scale_exponent(rounded)
    }

    #[inline(always)]
    fn arrays(numbers: &[f32]) -> &[[V::Array; N]] {
        V::arrays(numbers).as_chunks().0
    }

    #[inline(always)]
    fn arrays_mut(numbers: &mut [f32]) -> &mut [[V::Array; N]] {
        V::arrays_mut(numbers).as_chunks_mut().0
    }

    #[inline(always)]
    fn load(mut self, source: &[V::Array; N]) -> Self {
        for (vector, source) in self.0.iter_mut().zip(source) {
            *vector = vector.load(source);
        }
        self
    }

    #[inline(always)]
    fn write(self, out: &mut [V::Array; N]) {
        for (vector, out) in self.0.iter().zip(out) {
            vector.write(out);
        }
    }

    #[inline(always)]
    fn splat(self, value: f32) -> Self {
        Several([self.0[0].splat(value); N])
    }

    #[inline(always)]
    fn store(self, out: &mut [f32]) {
        for (i, out) in out.chunks_mut(V::LANES).take(N).enumerate() {
            self.0[i].store(out);
        }
    }

    #[inline(always)]
    fn less(self, other: Self) -> [V::Mask; N] {
        let mut masks = [self.0[0].less(other.0[0]); N];
        for (mask, (vector, other)) in masks.iter_mut().zip(self.0.iter().zip(&other.0)) {
            *mask = vector.less(*other);
        }
        masks
    }

    #[inline(always)]
    fn select(mask: [V::Mask; N], yes: Self, mut no: Self) -> Self {
        for (mask, (yes, no)) in mask.iter().zip(yes.0.iter().zip(&mut no.0)) {
            *no = V::select(*mask, *yes, *no);
        }
        no
    }

    #[inline(always)]
    fn split_exponent(self) -> (Self, Self) {
        let (mut exponents, mut mantissas) = (self, self);
        for i in 0..N {
            (exponents.0[i], mantissas.0[i]) = self.0[i].split_exponent();
        }
        (exponents, mantissas)
    }
}
