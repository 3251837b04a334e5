//! Elementary functions on vectors, written once for every tier, with tested error bounds.
//!
//! The coefficients of 2^f are our own (Remez exchange, relative error, constant term fixed at 1); the other
//! series are Taylor's, long enough for f32 over their ranges.

use super::vector::{ROUND, Vector};
use std::f32::consts::{FRAC_PI_4, LN_2, LOG2_E, PI, SQRT_2};

/// 2^f − 1 on `[−½, ½]`: coefficients of f, f², …, f⁶. Relative error of 2^f: 2.1e-8, an f32 rounding below.
const EXP2: [f32; 6] = [
    6.931_472_4e-1,
    2.402_265_2e-1,
    5.550_310_4e-2,
    9.617_693e-3,
    1.340_664_3e-3,
    1.559_467_8e-4,
];

/// Largest |x| for [`exp`]: the result stays a normal number.
pub const EXP_MAX: f32 = 87.0;

/// ln 2 to 12 bits, so that its product with an exponent is exact; [`LN_2_LOW`] is the rest.
const LN_2_HIGH: f32 = 2839.0 / 4096.0;

/// ln 2 − [`LN_2_HIGH`].
const LN_2_LOW: f32 = (std::f64::consts::LN_2 - LN_2_HIGH as f64) as f32;

/// (2^f − 1)/f for |f| ≤ ½.
#[inline(always)]
fn exp2_series<V: Vector>(fraction: V) -> V {
    let [c1, c2, c3, c4, c5, c6] = EXP2;
    let series = fraction.splat(c6).mul_add_const(fraction, c5);
    let series = series.mul_add_const(fraction, c4).mul_add_const(fraction, c3);
    series.mul_add_const(fraction, c2).mul_add_const(fraction, c1)
}

/// 2^t for |t| ≤ 126, where `rounded` = round(t) + [`ROUND`] and `fraction` = t − round(t).
#[inline(always)]
fn exp2_parts<V: Vector>(rounded: V, fraction: V) -> V {
    let series = exp2_series(fraction);
    series.mul_add_const(fraction, 1.0).scale_exponent(rounded)
}

/// eˣ for |x| ≤ `EXP_MAX`, within 3 ULP.
#[inline(always)]
pub fn exp<V: Vector>(x: V) -> V {
    let rounded = x.mul_add_const(x.splat(LOG2_E), ROUND);
    let n = rounded - x.splat(ROUND);
    let rest = n.mul_add(x.splat(-LN_2_HIGH), x);
    let rest = n.mul_add(x.splat(-LN_2_LOW), rest);
    exp2_parts(rounded, rest * x.splat(LOG2_E))
}

/// σ(x) = 1/(1 + e⁻ˣ) for any x, within 3e-7 absolutely; saturates beyond |x| = `EXP_MAX`.
///
/// The reduction of x is rounded, which costs relative accuracy where σ vanishes and nothing in x·σ(x).
#[inline(always)]
pub fn sigmoid<V: Vector>(x: V) -> V {
    let t = x.clamp(-EXP_MAX, EXP_MAX) * x.splat(-LOG2_E);
    let rounded = t + x.splat(ROUND);
    let fraction = t - (rounded - x.splat(ROUND));
    (exp2_parts(rounded, fraction) + x.splat(1.0)).reciprocal()
}

/// ln x for positive normal x, within 3 ULP.
///
/// ln m = 2·artanh(s) with s = (m − 1)/(m + 1) and |s| ≤ 0.172, where four terms of the series suffice.
#[inline(always)]
pub fn ln<V: Vector>(x: V) -> V {
    let (exponent, m) = x.split_exponent();
    let one = x.splat(1.0);
    let s = (m - one) / (m + one);
    let s2 = s * s;
    let series = s2.splat(2.0 / 9.0).mul_add_const(s2, 2.0 / 7.0);
    let series = series.mul_add_const(s2, 2.0 / 5.0).mul_add_const(s2, 2.0 / 3.0);
    let mantissa = (s * s2).mul_add(series, s + s);
    exponent.mul_add(x.splat(LN_2), mantissa)
}

/// (sin x, cos x) for |x| ≤ π/4, within 2 ULP.
#[inline(always)]
pub fn sin_cos<V: Vector>(x: V) -> (V, V) {
    let x2 = x * x;
    let sin = x2.splat(1.0 / 362_880.0).mul_add_const(x2, -1.0 / 5_040.0);
    let sin = sin.mul_add_const(x2, 1.0 / 120.0).mul_add_const(x2, -1.0 / 6.0);
    let cos = x2.splat(-1.0 / 3_628_800.0).mul_add_const(x2, 1.0 / 40_320.0);
    let cos = cos.mul_add_const(x2, -1.0 / 720.0).mul_add_const(x2, 1.0 / 24.0);
    (
        (x * x2).mul_add(sin, x),
        cos.mul_add_const(x2, -0.5).mul_add_const(x2, 1.0),
    )
}

/// (sin πx, cos πx) for |x| < 2²², within 3e-7 absolutely; the argument is reduced exactly.
#[inline(always)]
pub fn half_turns<V: Vector>(x: V) -> (V, V) {
    let one = x.splat(1.0);
    // To [−1, 1], then to an eighth of a turn on either side of a whole number of quarters.
    let turns = x.mul_add_const(x.splat(0.5), ROUND) - x.splat(ROUND);
    let r = x - (turns + turns);
    let quarters = (r + r + x.splat(ROUND)) - x.splat(ROUND);
    let (sin, cos) = sin_cos((r - quarters * x.splat(0.5)) * x.splat(PI));
    // Quarters are −2…2: odd ones swap the two, and signs follow from 1, ±1 or 1 − |±2|.
    let size = quarters.abs();
    let odd = (size - one).abs().less(x.splat(0.5));
    let even_sign = one - size;
    let sin_sign = V::select(odd, quarters, even_sign);
    let cos_sign = V::select(odd, -quarters, even_sign);
    (
        sin_sign * V::select(odd, cos, sin),
        cos_sign * V::select(odd, sin, cos),
    )
}

/// 1 − e⁻ˣ for |x| ≤ `EXP_MAX`, within 6 ULP: what [`exp`] would lose next to 0 stays.
#[inline(always)]
pub fn decay<V: Vector>(x: V) -> V {
    let x = -x;
    let rounded = x.mul_add_const(x.splat(LOG2_E), ROUND);
    let n = rounded - x.splat(ROUND);
    let rest = n.mul_add(x.splat(-LN_2_HIGH), x);
    let rest = n.mul_add(x.splat(-LN_2_LOW), rest);
    let fraction = rest * x.splat(LOG2_E);
    let power = x.splat(1.0).scale_exponent(rounded);
    // 1 − 2ⁿ·(1 + (2^f − 1)), n = 0 next to x = 0.
    (-power).mul_add(fraction * exp2_series(fraction), x.splat(1.0) - power)
}

/// atan x for x in `[0, 1]`, within 4 ULP.
#[inline(always)]
pub fn atan<V: Vector>(x: V) -> V {
    let one = x.splat(1.0);
    // Beyond tan π/8 the angle to π/4 is the smaller one; the series is Taylor's up to x¹⁵.
    let far = x.splat(SQRT_2 - 1.0).less(x);
    let y = V::select(far, (x - one) / (x + one), x);
    let y2 = y * y;
    let series = y2.splat(-1.0 / 15.0).mul_add_const(y2, 1.0 / 13.0);
    let series = series.mul_add_const(y2, -1.0 / 11.0).mul_add_const(y2, 1.0 / 9.0);
    let series = series.mul_add_const(y2, -1.0 / 7.0).mul_add_const(y2, 1.0 / 5.0);
    let angle = (y * y2).mul_add(series.mul_add_const(y2, -1.0 / 3.0), y);
    V::select(far, angle + x.splat(FRAC_PI_4), angle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::native::arch;
    use crate::native::vector::Simd;

    /// Stated bound of [`exp`]: half an ULP each for the last rounding, the polynomial's and the reduction's,
    /// which the scalar tier rounds twice as often.
    const EXP_ULPS: f64 = 3.0;
    /// Stated bound of [`ln`]: the series is rounded where it is largest, then the exponent's part is added.
    const LN_ULPS: f64 = 3.0;
    /// Stated bound of [`sin_cos`]: one rounding of a small correction and one of the sum.
    const SIN_COS_ULPS: f64 = 2.0;
    /// Stated bound of [`half_turns`]: the product with π is rounded, then as [`sin_cos`].
    const HALF_TURNS_TOL: f64 = 3e-7;
    /// Stated bound of [`decay`]: 1 − 2ⁿ is up to twice the result, and the series' part is rounded thrice.
    const DECAY_ULPS: f64 = 6.0;
    /// Stated bound of [`atan`]: a quotient, a series and a sum.
    const ATAN_ULPS: f64 = 4.0;
    /// Stated bound of [`sigmoid`]: some roundings of numbers up to 1.
    const SIGMOID_TOL: f64 = 3e-7;
    /// Stated bound of [`Vector::reciprocal`].
    const RECIPROCAL_ULPS: f64 = 2.0;
    /// Points per function: enough that the spacing is far below that of the polynomials' extrema.
    const POINTS: usize = 200_000;

    /// Largest error of `function` against `truth` over `range`, in ULP of the truth and absolutely.
    fn worst<S: Simd>(
        simd: S,
        function: impl Fn(S::Vector) -> S::Vector,
        truth: impl Fn(f64) -> f64,
        range: impl Fn(f64) -> f64,
    ) -> (f64, f64) {
        let (mut ulps, mut absolute) = (0.0f64, 0.0f64);
        for i in 0..=POINTS {
            let x = range(i as f64 / POINTS as f64) as f32;
            let mut out = [0.0];
            function(simd.splat(x)).store(&mut out);
            let (found, expected) = (f64::from(out[0]), truth(f64::from(x)));
            let ulp = f64::from((expected as f32).abs().next_up()) - f64::from((expected as f32).abs());
            let error = (found - expected).abs();
            assert!(error.is_finite(), "{found} instead of {expected} at {x}");
            ulps = ulps.max(error / ulp);
            absolute = absolute.max(error);
        }
        (ulps, absolute)
    }

    /// A point of `[-max, max]` for each `t` in `[0, 1]`.
    fn symmetric(max: f64) -> impl Fn(f64) -> f64 {
        move |t| (2.0 * t - 1.0) * max
    }

    fn check<S: Simd>(simd: S) {
        let within =
            |what: &str, found: f64, bound: f64| assert!(found <= bound, "{what}: {found} > {bound}");
        within(
            "exp",
            worst(simd, exp, f64::exp, symmetric(f64::from(EXP_MAX))).0,
            EXP_ULPS,
        );
        // 2⁻¹²⁰ to 2¹²⁰, and closely around 1, where ln vanishes.
        within(
            "ln",
            worst(simd, ln, f64::ln, |t| symmetric(120.0)(t).exp2()).0,
            LN_ULPS,
        );
        within(
            "ln near 1",
            worst(simd, ln, f64::ln, |t| 1.0 + symmetric(0.3)(t)).0,
            LN_ULPS,
        );
        let quarter = symmetric(std::f64::consts::FRAC_PI_4);
        within(
            "sin",
            worst(simd, |x| sin_cos(x).0, f64::sin, &quarter).0,
            SIN_COS_ULPS,
        );
        within(
            "cos",
            worst(simd, |x| sin_cos(x).1, f64::cos, &quarter).0,
            SIN_COS_ULPS,
        );
        let turned = |x: f64| std::f64::consts::PI * (x - 2.0 * (0.5 * x).round());
        for range in [1.0, 40.0, 4e6] {
            let [sin, cos] = [
                worst(simd, |x| half_turns(x).0, |x| turned(x).sin(), symmetric(range)).1,
                worst(simd, |x| half_turns(x).1, |x| turned(x).cos(), symmetric(range)).1,
            ];
            within("sin of half turns", sin, HALF_TURNS_TOL);
            within("cos of half turns", cos, HALF_TURNS_TOL);
        }
        for range in [1e-3, 1.0, f64::from(EXP_MAX)] {
            let error = worst(simd, decay, |x| -(-x).exp_m1(), symmetric(range)).0;
            within("decay", error, DECAY_ULPS);
        }
        within("atan", worst(simd, atan, f64::atan, |t| t).0, ATAN_ULPS);
        within(
            "atan near 0",
            worst(simd, atan, f64::atan, |t| (-60.0 * t).exp2()).0,
            ATAN_ULPS,
        );
        let logistic = |x: f64| 1.0 / (1.0 + (-x).exp());
        within(
            "sigmoid",
            worst(simd, sigmoid, logistic, symmetric(1000.0)).1,
            SIGMOID_TOL,
        );
        within(
            "sigmoid near 0",
            worst(simd, sigmoid, logistic, symmetric(20.0)).1,
            SIGMOID_TOL,
        );
        let reciprocal = worst(simd, |x| x.reciprocal(), |x| 1.0 / x, |t| (125.0 * t).exp2());
        within("reciprocal", reciprocal.0, RECIPROCAL_ULPS);
    }

    #[test]
    fn functions_keep_their_stated_bounds_on_every_tier() {
        check(arch::scalar::Scalar);
        check(arch::portable::Portable);
        #[cfg(target_arch = "x86_64")]
        {
            arch::avx2::Avx2::new().into_iter().for_each(check);
            arch::avx512::Avx512::new().into_iter().for_each(check);
        }
    }
}
