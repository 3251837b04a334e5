//! What happens to a query before and after the network: fold, limits of u, and the answer to invalid ones.

use crate::graph::{Graph, Value};
use bake_runtime::spec::{Symmetry, U_MIN};

/// Largest f32 below 1, and so the largest u that a renderer can draw.
const U_MAX: f32 = 1.0 - f32::EPSILON / 2.0;

/// `[N, 1]`: whether the direction `w` `[N, 3]` is finite and above the horizon.
pub fn above_horizon(g: &mut Graph, w: Value) -> Value {
    let [_, _, z] = g.columns(w);
    let zero = g.scalar(0.0);
    let above = g.greater(z, zero);
    let finite = is_finite(g, w);
    g.and(above, finite)
}

/// `wo` folded by `symmetry`, and the signs `[N, 3]` that fold and unfold `wi`.
///
/// z needs no case of its own: it is positive wherever the answer counts.
pub fn fold(g: &mut Graph, symmetry: Symmetry, wo: Value) -> (Value, Value) {
    match symmetry {
        Symmetry::Quadrant => {
            let (zero, plus, minus) = (g.scalar(0.0), g.scalar(1.0), g.scalar(-1.0));
            let negative = g.less(wo, zero);
            (g.unary("Abs", wo), g.select(negative, minus, plus))
        }
    }
}

/// u limited to [`U_MIN`]..=[`U_MAX`]; NaN becomes [`U_MIN`].
pub fn limit_u(g: &mut Graph, u: Value) -> Value {
    // Comparisons and selections, because Min, Max and Clip leave open what becomes of NaN.
    let (low, high) = (g.scalar(U_MIN as f32), g.scalar(U_MAX));
    let above = g.greater(u, low);
    let u = g.select(above, u, low);
    let below = g.less(u, high);
    g.select(below, u, high)
}

/// `value` where `valid` holds and the whole row is finite, else `fallback`.
pub fn answer(g: &mut Graph, valid: Value, value: Value, fallback: Value) -> Value {
    let finite = is_finite(g, value);
    let keep = g.and(valid, finite);
    g.select(keep, value, fallback)
}

fn is_finite(g: &mut Graph, a: Value) -> Value {
    let largest = g.scalar(f32::MAX);
    let sum = g.row_l1(a);
    g.less_or_equal(sum, largest)
}
