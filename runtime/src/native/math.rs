//! Elementary functions on vectors, written once for every tier, with tested error bounds.
//!
//! The coefficients of 2^f and of sin πy are our own (Remez exchange, relative error; the constant term of 2^f fixed at 1);
//! the other series are Taylor's, long enough for f32 over their ranges.

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

/// sin(πy)/y on [−½, ½]: coefficients of 1, y², …, y⁸. Relative error: 5.3e-9.
const SIN_HALF_TURNS: [f32; 5] = [PI, -5.167_71, 2.550_069_7, -0.598_242_1, 0.077_560_39];

/// x less whole turns of 2, in [−1, 1], for |x| < 2²²; exact.
#[inline(always)]
pub fn within_a_turn<V: Vector>(x: V) -> V {
    let turns = x.mul_add_const(x.splat(0.5), ROUND) - x.splat(ROUND);
    x - (turns + turns)
}

/// (sin πx, cos πx) for |x| ≤ 1, within 3e-7 absolutely.
#[inline(always)]
pub fn half_turns<V: Vector>(x: V) -> (V, V) {
    let one = x.splat(1.0);
    let folded = x.min(one - x).max(-one - x);
    (sin_quarter(folded), sin_quarter(x.splat(0.5) - x.abs()))
}

/// sin πy for |y| ≤ ½.
#[inline(always)]
fn sin_quarter<V: Vector>(y: V) -> V {
    let [c0, c2, c4, c6, c8] = SIN_HALF_TURNS;
    let y2 = y * y;
    let series = y2.splat(c8).mul_add_const(y2, c6).mul_add_const(y2, c4);
    y * series.mul_add_const(y2, c2).mul_add_const(y2, c0)
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
mod tests;
