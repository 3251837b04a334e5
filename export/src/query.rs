//! What is asked of raw queries before the network sees them, and the answer to invalid ones.

use crate::graph::{Graph, Value};
use bake_runtime::NetworkSpec;
use bake_runtime::spec::{EXPONENT_MAX, U_MIN, params_port};

/// Largest f32 below 1, and so the largest u that a renderer can draw.
const U_MAX: f32 = 1.0 - f32::EPSILON / 2.0;

/// The inputs of a graph.
pub struct Query {
    /// Free parameters, `[N, 1]` each.
    pub params: Vec<Value>,
    /// Camera direction, `[N, 3]`.
    pub wo: Value,
    /// u or wi.
    pub other: Value,
    /// `[N, 1]`: whether parameters are finite and `wo` lies above the horizon.
    pub valid: Value,
}

impl Query {
    /// Declares the inputs of the graph of a network: parameters, where any are free, then those of its role.
    pub fn new(g: &mut Graph, spec: &NetworkSpec) -> Query {
        g.scope("query");
        let free = spec.material.free().len();
        let params = (free > 0).then(|| g.input(&params_port(free)));
        let [wo, other] = spec.role.graph_inputs().each_ref().map(|port| g.input(port));
        let above = above_horizon(g, wo);
        let (params, valid) = match params {
            None => (Vec::new(), above),
            Some(params) => {
                let finite = is_finite(g, params);
                (g.column_list(params, free), g.and(finite, above))
            }
        };
        Query {
            params,
            wo,
            other,
            valid,
        }
    }
}

/// `[N, 1]`: whether the direction `w` `[N, 3]` is finite and above the horizon.
pub fn above_horizon(g: &mut Graph, w: Value) -> Value {
    let [_, _, z] = g.columns(w);
    let zero = g.scalar(0.0);
    let above = g.greater(z, zero);
    let finite = is_finite(g, w);
    g.and(above, finite)
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

/// e^x with |x| limited to [`EXPONENT_MAX`].
pub fn bounded_exp(g: &mut Graph, x: Value) -> Value {
    let limited = g.clip(x, EXPONENT_MAX as f32);
    g.unary("Exp", limited)
}
