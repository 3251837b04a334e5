//! The warp head: a position in the frame's square that keeps every edge in place, and its determinant.
//!
//! With s = u + (1 − u)·e^(−g), the position is h = u/s and 1 − h = (1 − u)·e^(−g)/s. Since
//! h·(1 − h)/(u·(1 − u)) = e^(−g)/s², the derivative of h along u is e^(−g)/s² + h·(1 − h)·dg: no division by u.

use crate::frame::Square;
use crate::graph::{Graph, Value};
use crate::layers::Dual;
use bake_runtime::spec::WARP_SHIFT_MAX;

/// Position and signed determinant `[N, 1]` of u ↦ position, from the logit shift g `[N, 2]` and its tangents.
///
/// `u` `[N, 2]` strictly between 0 and 1.
pub fn warp(g: &mut Graph, u: Value, shift: Dual) -> (Square, Value) {
    g.scope("warp");
    let limited = g.clip(shift.value, WARP_SHIFT_MAX as f32);
    let negated = g.unary("Neg", limited);
    let odds = g.unary("Exp", negated);
    let rest = g.one_minus(u);
    let b = g.mul(rest, odds);
    let s = g.add(u, b);
    let (position, complement) = (g.div(u, s), g.div(b, s));

    let s2 = g.mul(s, s);
    let direct = g.div(odds, s2);
    // A limited shift is constant: its tangents do not count.
    let bound = g.scalar(WARP_SHIFT_MAX as f32);
    let size = g.unary("Abs", shift.value);
    let free = g.less_or_equal(size, bound);
    let (zero, spread) = (g.scalar(0.0), g.mul(position, complement));
    let spread = g.select(free, spread, zero);
    let [along_x, along_y] = {
        let identity = g.constant(&[2, 1, 2], &[1.0, 0.0, 0.0, 1.0]);
        let (straight, bent) = (g.mul(direct, identity), g.mul(shift.tangents, spread));
        let gradient = g.add(straight, bent);
        g.unstack(gradient)
    };
    let [xx, xy] = g.columns(along_x);
    let [yx, yy] = g.columns(along_y);
    let (diagonal, cross) = (g.mul(xx, yy), g.mul(xy, yx));
    (Square { position, complement }, g.sub(diagonal, cross))
}
