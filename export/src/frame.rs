//! The lobe frame as graph operations: the f32 counterpart of `bake_runtime::frame` and `concentric`.
//!
//! Deviation in form, not in value: with b = A·δ, the point A·(x, y) + b·z is computed as A·((x, y) + δ·z).

use crate::anchor::Start;
use crate::graph::{Graph, Value};
use bake_runtime::concentric::DISK_AREA;
use std::f32::consts::FRAC_PI_4;

/// A frame; every value is `[N, 1]`.
#[derive(Clone, Copy)]
pub struct Frame {
    /// First diagonal element of A.
    pub x: Value,
    /// Second diagonal element of A.
    pub y: Value,
    /// A\[1\]\[0\] / A\[1\]\[1\].
    pub shear: Value,
    /// Shift δ in front of A.
    pub delta: [Value; 2],
}

/// A position in a square, `h` and 1 − h kept apart; both `[N, 2]`.
pub struct Square {
    /// h.
    pub position: Value,
    /// 1 − h, more precise next to the edges than a subtraction.
    pub complement: Value,
}

impl Frame {
    /// The frame of the `outputs` of a frame network, within their limits, `[N, 1]` each; it changes `start`, or the
    /// identity.
    pub fn from_outputs(g: &mut Graph, outputs: [Value; 5], start: Option<&Start>) -> Frame {
        let [log_x, log_y, shear, delta_x, delta_y] = outputs;
        let [x, y] = [log_x, log_y].map(|log| g.unary("Exp", log));
        let delta = [delta_x, delta_y];
        match start {
            None => Frame { x, y, shear, delta },
            Some(start) => {
                let ratio = g.div(x, y);
                let sheared = g.mul(start.shear, ratio);
                Frame {
                    x: g.mul(start.x, x),
                    y: g.mul(start.y, y),
                    shear: g.add(sheared, shear),
                    delta,
                }
            }
        }
    }

    /// Unit direction at `square`, `[N, 1]` each component, and dω / d(square), sr, `[N, 1]`.
    pub fn square_to_direction(self, g: &mut Graph, square: &Square) -> ([Value; 3], Value) {
        let [lx, ly, z] = square_to_hemisphere(g, square);
        let [px, py] = [(lx, self.delta[0]), (ly, self.delta[1])].map(|(l, delta)| {
            let shift = g.mul(delta, z);
            g.add(l, shift)
        });
        let sheared = g.mul(self.shear, px);
        let py = g.add(sheared, py);
        let v = [g.mul(self.x, px), g.mul(self.y, py), z];
        let n2 = squared_length(g, v);
        let n = g.unary("Sqrt", n2);
        // π·det A / n⁴ over cos θ = z/n.
        let n3 = g.mul(n2, n);
        let n3z = g.mul(n3, z);
        let area = self.area(g);
        (v.map(|c| g.div(c, n)), g.div(area, n3z))
    }

    /// Unit local direction of the unit direction `w`, and the frame's density at `w`, sr⁻¹, `[N, 1]`.
    pub fn to_local(self, g: &mut Graph, [wx, wy, z]: [Value; 3]) -> ([Value; 3], Value) {
        let (qx, qy) = (g.div(wx, self.x), g.div(wy, self.y));
        let sheared = g.mul(self.shear, qx);
        let qy = g.sub(qy, sheared);
        let [px, py] = [(qx, self.delta[0]), (qy, self.delta[1])].map(|(q, delta)| {
            let shift = g.mul(delta, z);
            g.sub(q, shift)
        });
        let p = [px, py, z];
        let m2 = squared_length(g, p);
        let m = g.unary("Sqrt", m2);
        let m4 = g.mul(m2, m2);
        let area = self.area(g);
        let spread = g.mul(area, m4);
        (p.map(|c| g.div(c, m)), g.div(z, spread))
    }

    /// π·det A.
    fn area(self, g: &mut Graph) -> Value {
        let det = g.mul(self.x, self.y);
        g.mul_scalar(det, DISK_AREA as f32)
    }
}

/// Shirley and Chiu's concentric map, then up to the hemisphere: x, y, z, each `[N, 1]`.
fn square_to_hemisphere(g: &mut Graph, square: &Square) -> [Value; 3] {
    let centred = g.sub(square.position, square.complement);
    let edges = g.min(square.position, square.complement);
    let [a, b] = g.columns(centred);
    let [edge_a, edge_b] = g.columns(edges);
    // |a| > |b|, asked of the edges: in a corner both sizes round to 1, and the wrong edge would be taken.
    let first = g.less(edge_a, edge_b);
    let r = g.select(first, a, b);
    let other = g.select(first, b, a);
    let edge = g.select(first, edge_a, edge_b);
    // At the very centre both are 0: any divisor but 0 gives the ratio 0 there.
    let (zero, one) = (g.scalar(0.0), g.scalar(1.0));
    let size = g.unary("Abs", r);
    let off_centre = g.greater(size, zero);
    let divisor = g.select(off_centre, r, one);
    let ratio = g.div(other, divisor);
    let angle = g.mul_scalar(ratio, FRAC_PI_4);
    let (cos, sin) = (g.unary("Cos", angle), g.unary("Sin", angle));
    let (along, across) = (g.mul(r, cos), g.mul(r, sin));
    let x = g.select(first, along, across);
    let y = g.select(first, across, along);
    // |r| = 1 − 2·edge, so z² = 1 − r² = 4·edge·(1 − edge).
    let far = g.one_minus(edge);
    let product = g.mul(edge, far);
    let z2 = g.mul_scalar(product, 4.0);
    [x, y, g.unary("Sqrt", z2)]
}

/// `v` of length 1.
pub fn normalized(g: &mut Graph, v: [Value; 3]) -> [Value; 3] {
    let n2 = squared_length(g, v);
    let n = g.unary("Sqrt", n2);
    v.map(|c| g.div(c, n))
}

fn squared_length(g: &mut Graph, v: [Value; 3]) -> Value {
    let [xx, yy, zz] = v.map(|c| g.mul(c, c));
    let xy = g.add(xx, yy);
    g.add(xy, zz)
}
