//! Errors of the elementary functions: every so many numbers of their whole ranges, on every tier.

use super::*;
use crate::native::arch;
use crate::native::vector::{Simd, Task};

/// Stated bound of [`exp`]: half an ULP each for the last rounding, the polynomial's and the reduction's,
/// which tiers without fused multiply-add round twice as often.
const EXP_ULPS: f64 = 3.0;
/// Stated bound of [`ln`]: the series is rounded where it is largest, then the exponent's part is added.
const LN_ULPS: f64 = 3.0;
/// Stated bound of [`sin_cos`]: one rounding of a small correction and one of the sum.
const SIN_COS_ULPS: f64 = 2.0;
/// Stated bound of [`half_turns`]: a sum is rounded where it is about π, and a product next to 1.
const HALF_TURNS_TOL: f64 = 3e-7;
/// Stated bound of [`decay`]: 1 − 2ⁿ is up to twice the result, and the series' part is rounded thrice.
const DECAY_ULPS: f64 = 6.0;
/// Stated bound of [`atan`]: a quotient, a series and a sum.
const ATAN_ULPS: f64 = 4.0;
/// Stated bound of [`sigmoid`]: some roundings of numbers up to 1.
const SIGMOID_TOL: f64 = 3e-7;
/// Stated bound of [`Vector::reciprocal`], [`Vector::over`] and [`Vector::inverse_sqrt`].
const RECIPROCAL_ULPS: f64 = 2.0;
/// One more rounding, of the divisor.
const THIRD_ULPS: f64 = RECIPROCAL_ULPS + 1.0;

/// Steps through the bit patterns of a range, odd so that mantissas of all residues are met: the fastest tier sees tens of
/// millions of numbers of every function, the others a few. All of them are an ignored test's.
const STRIDE: u32 = 41;
const STRIDE_OF_OTHERS: u32 = 1009;

/// Numbers per call of a function.
const CHUNK: usize = 4096;

/// 2¹²⁵, as far as reciprocals are stated.
const RECIPROCAL_MAX: f32 = (1u128 << 125) as f32;
/// 2²², as far as half turns are stated.
const TURNS_MAX: f32 = (1 << 22) as f32;

/// A function on vectors: closures would not be compiled for the tier.
trait Function {
    fn of<V: Vector>(x: V) -> V;
}

/// Makes a [`Function`] of an expression.
macro_rules! functions {
    ($($name:ident: |$x:ident| $value:expr;)*) => {$(
        struct $name;

        impl Function for $name {
            #[inline(always)]
            fn of<V: Vector>($x: V) -> V {
                $value
            }
        }
    )*};
}
functions! {
    Exp: |x| exp(x);
    Sigmoid: |x| sigmoid(x);
    Ln: |x| ln(x);
    Sin: |x| sin_cos(x).0;
    Cos: |x| sin_cos(x).1;
    SinTurns: |x| half_turns(within_a_turn(x)).0;
    CosTurns: |x| half_turns(within_a_turn(x)).1;
    Decay: |x| decay(x);
    Atan: |x| atan(x);
    Reciprocal: |x| x.reciprocal();
    Third: |x| x.splat(1.0).over(x + x + x);
    InverseSqrt: |x| x.inverse_sqrt();
}

/// `F` of every number of `x`, in a function compiled for the tier of `S`.
struct Chunk<'a, S, F> {
    simd: S,
    function: std::marker::PhantomData<F>,
    x: &'a [f32],
    out: &'a mut [f32],
}

impl<S: Simd, F: Function> Task for Chunk<'_, S, F> {
    #[inline(always)]
    fn run(self) {
        let mut start = 0;
        while start < self.x.len() {
            F::of(self.simd.load(&self.x[start..])).store(&mut self.out[start..]);
            start += S::Vector::LANES;
        }
    }
}

/// Largest errors of a function, in ULP of the truth and absolutely, and where.
#[derive(Clone, Copy, Default)]
struct Worst {
    ulps: f64,
    absolute: f64,
    at: f32,
}

/// Errors of `F` against `truth` at every `stride`-th number of `range`, which begins at 0 or above, and mirrored if `signed`.
fn worst<S: Simd, F: Function>(
    simd: S,
    truth: impl Fn(f64) -> f64,
    range: [f32; 2],
    signed: bool,
    stride: u32,
) -> Worst {
    let mut worst = Worst::default();
    let (mut x, mut out) = (Vec::with_capacity(CHUNK), [0.0; CHUNK]);
    let mut judge = |x: &mut Vec<f32>| {
        let function = std::marker::PhantomData::<F>;
        simd.enter(Chunk {
            simd,
            function,
            x,
            out: &mut out[..x.len()],
        });
        for (&x, &found) in x.iter().zip(&out) {
            let expected = truth(f64::from(x));
            let near = (expected as f32).abs();
            let error = (f64::from(found) - expected).abs();
            assert!(error.is_finite(), "{found} instead of {expected} at {x:e}");
            let ulps = error / (f64::from(near.next_up()) - f64::from(near));
            if ulps > worst.ulps {
                (worst.ulps, worst.at) = (ulps, x);
            }
            worst.absolute = worst.absolute.max(error);
        }
        x.clear();
    };
    let [first, last] = range.map(f32::to_bits);
    let mut bits = first;
    // The last number is always among them.
    loop {
        let number = f32::from_bits(bits);
        x.push(number);
        if signed {
            x.push(-number);
        }
        if x.len() + 1 >= CHUNK || bits == last {
            judge(&mut x);
        }
        if bits == last {
            return worst;
        }
        bits = bits.saturating_add(stride).min(last);
    }
}

fn check<S: Simd>(simd: S, tier: &str, stride: u32) {
    let within = |what: &str, found: f64, bound: f64, at: f32| {
        eprintln!("{tier}, every {stride}: {what} {found:.3e} at {at:e}, bound {bound:e}");
        assert!(
            found <= bound,
            "{tier}: {what} is off by {found} > {bound} at {at:e}"
        );
    };
    let ulps = |what: &str, found: Worst, bound: f64| within(what, found.ulps, bound, found.at);
    let absolute = |what: &str, found: Worst, bound: f64| within(what, found.absolute, bound, found.at);
    let exponents = [0.0, EXP_MAX];
    let normal = [f32::MIN_POSITIVE, f32::MAX];
    let logistic = |x: f64| 1.0 / (1.0 + (-x).exp());
    let turned = |x: f64| std::f64::consts::PI * (x - 2.0 * (0.5 * x).round());
    let quarter = [0.0, FRAC_PI_4];
    let turns = [0.0, TURNS_MAX.next_down()];
    ulps(
        "exp",
        worst::<S, Exp>(simd, f64::exp, exponents, true, stride),
        EXP_ULPS,
    );
    absolute(
        "sigmoid",
        worst::<S, Sigmoid>(simd, logistic, [0.0, f32::MAX], true, stride),
        SIGMOID_TOL,
    );
    ulps(
        "ln",
        worst::<S, Ln>(simd, f64::ln, normal, false, stride),
        LN_ULPS,
    );
    ulps(
        "sin",
        worst::<S, Sin>(simd, f64::sin, quarter, true, stride),
        SIN_COS_ULPS,
    );
    ulps(
        "cos",
        worst::<S, Cos>(simd, f64::cos, quarter, true, stride),
        SIN_COS_ULPS,
    );
    let sin = worst::<S, SinTurns>(simd, |x| turned(x).sin(), turns, true, stride);
    absolute("sin of half turns", sin, HALF_TURNS_TOL);
    let cos = worst::<S, CosTurns>(simd, |x| turned(x).cos(), turns, true, stride);
    absolute("cos of half turns", cos, HALF_TURNS_TOL);
    ulps(
        "decay",
        worst::<S, Decay>(simd, |x| -(-x).exp_m1(), exponents, true, stride),
        DECAY_ULPS,
    );
    ulps(
        "atan",
        worst::<S, Atan>(simd, f64::atan, [0.0, 1.0], false, stride),
        ATAN_ULPS,
    );
    let reciprocal = worst::<S, Reciprocal>(simd, |x| 1.0 / x, [1.0, RECIPROCAL_MAX], true, stride);
    ulps("reciprocal", reciprocal, RECIPROCAL_ULPS);
    let divisors = [1.0 / RECIPROCAL_MAX, RECIPROCAL_MAX / 4.0];
    let third = worst::<S, Third>(simd, |x| 1.0 / (3.0 * x), divisors, true, stride);
    ulps("quotient", third, THIRD_ULPS);
    let root = worst::<S, InverseSqrt>(simd, |x| 1.0 / x.sqrt(), normal, false, stride);
    ulps("inverse square root", root, RECIPROCAL_ULPS);
}

#[test]
fn functions_keep_their_stated_bounds_on_every_tier() {
    check(arch::scalar::Scalar, "scalar", STRIDE_OF_OTHERS);
    check(arch::portable::Portable, "portable", STRIDE_OF_OTHERS);
    #[cfg(target_arch = "x86_64")]
    {
        let widest = arch::avx512::Avx512::new();
        let stride = if widest.is_some() {
            STRIDE_OF_OTHERS
        } else {
            STRIDE
        };
        if let Some(avx2) = arch::avx2::Avx2::new() {
            check(avx2, "avx2", stride);
        }
        if let Some(avx512) = widest {
            check(avx512, "avx512", STRIDE);
        }
    }
}

#[test]
#[ignore = "minutes: every f32 of all ranges"]
fn functions_keep_their_stated_bounds_at_every_number() {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx512) = arch::avx512::Avx512::new() {
        return check(avx512, "avx512", 1);
    }
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = arch::avx2::Avx2::new() {
        return check(avx2, "avx2", 1);
    }
    check(arch::portable::Portable, "portable", 1);
}
