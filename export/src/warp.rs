//! What the two steering outputs of a sampling network make of u: a position in a square, and its determinant.
//!
//! Warp head: with s = u + (1 − u)·e^(−g), the position is h = u/s and 1 − h = (1 − u)·e^(−g)/s. Since
//! h·(1 − h)/(u·(1 − u)) = e^(−g)/s², the derivative of h along u is e^(−g)/s² + h·(1 − h)·dg: no division by u.
//! Disk head: h = σ(g), of which only the second term is left.

use crate::frame::Square;
use crate::graph::{Graph, Value};
use crate::layers::Dual;
use bake_runtime::spec::{DISK_HEIGHT_MIN, WARP_SHIFT_MAX};

/// Position that keeps every edge in place, and the signed determinant `[N, 1]` of u ↦ position, from the logit shift g
/// `[N, 2]` and its tangents.
///
/// `u` strictly between 0 and 1.
pub fn warp(g: &mut Graph, u: &Square, shift: Dual) -> (Square, Value) {
    g.scope("warp");
    let odds = odds(g, shift.value);
    let b = g.mul(u.complement, odds);
    let s = g.add(u.position, b);
    let square = Square {
        position: g.div(u.position, s),
        complement: g.div(b, s),
    };
    let s2 = g.mul(s, s);
    let direct = g.div(odds, s2);
    let identity = g.constant(&[2, 1, 2], &[1.0, 0.0, 0.0, 1.0]);
    let (straight, bent) = (g.mul(direct, identity), bent(g, &square, shift));
    let gradient = g.add(straight, bent);
    let det = determinant(g, gradient);
    (square, det)
}

/// Position σ(g) in the square around the disk, and the signed determinant `[N, 1]` of u ↦ position.
pub fn place(g: &mut Graph, logits: Dual) -> (Square, Value) {
    g.scope("place");
    let odds = odds(g, logits.value);
    let sum = g.add_scalar(odds, 1.0);
    let one = g.scalar(1.0);
    let square = Square {
        position: g.div(one, sum),
        complement: g.div(odds, sum),
    };
    let gradient = bent(g, &square, logits);
    let det = determinant(g, gradient);
    (square, det)
}

/// Unit direction `[N, 3]` over the position `square` around the disk, and dω / d(square), sr, `[N, 1]`: 0 outside of the
/// disk.
pub fn disk_direction(g: &mut Graph, square: &Square) -> (Value, Value) {
    g.scope("disk");
    let xy = g.sub(square.position, square.complement);
    // 1 − x² = 4h·(1 − h), and 1 − x² − y² is that of the larger coordinate less the square of the smaller one.
    let product = g.mul(square.position, square.complement);
    let gaps = g.mul_scalar(product, 4.0);
    let squares = g.mul(xy, xy);
    let ([gap_x, gap_y], [xx, yy]) = (g.columns(gaps), g.columns(squares));
    let (gap, smaller) = (g.min(gap_x, gap_y), g.min(xx, yy));
    let z2 = g.sub(gap, smaller);
    let least = g.scalar((DISK_HEIGHT_MIN * DISK_HEIGHT_MIN) as f32);
    let raised = g.max(z2, least);
    let z = g.unary("Sqrt", raised);
    let inside = g.greater(z2, least);
    let (four, zero) = (g.scalar(4.0), g.scalar(0.0));
    let area = g.div(four, z);
    let area = g.select(inside, area, zero);
    let length2 = {
        let radius2 = g.add(xx, yy);
        g.add(radius2, raised)
    };
    let length = g.unary("Sqrt", length2);
    let v = g.concat(&[xy, z]);
    (g.div(v, length), area)
}

/// e^(−g) for g within its limits.
fn odds(g: &mut Graph, shift: Value) -> Value {
    let limited = g.clip(shift, WARP_SHIFT_MAX as f32);
    let negated = g.unary("Neg", limited);
    g.unary("Exp", negated)
}

/// h·(1 − h)·dg, `[2, N, 2]`; a limited g is constant, so its tangents do not count.
fn bent(g: &mut Graph, square: &Square, shift: Dual) -> Value {
    let bound = g.scalar(WARP_SHIFT_MAX as f32);
    let size = g.unary("Abs", shift.value);
    let free = g.less_or_equal(size, bound);
    let (zero, spread) = (g.scalar(0.0), g.mul(square.position, square.complement));
    let spread = g.select(free, spread, zero);
    g.mul(shift.tangents, spread)
}

/// Determinant `[N, 1]` of the gradient `[2, N, 2]`.
fn determinant(g: &mut Graph, gradient: Value) -> Value {
    let [along_x, along_y] = g.unstack(gradient);
    let [xx, xy] = g.columns(along_x);
    let [yx, yy] = g.columns(along_y);
    let (diagonal, cross) = (g.mul(xx, yy), g.mul(xy, yx));
    g.sub(diagonal, cross)
}
