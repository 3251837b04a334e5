//! The lobe frame as graph operations: the f32 counterpart of `bake_runtime::frame` and `concentric`.
//!
//! Deviation in form, not in value: with b = anchor + A·δ, the point A·(x, y) + b·z is computed as
//! A·((x, y) + δ·z) + anchor·z, which saves forming b.

use crate::features::encode;
use crate::graph::{Graph, Value};
use crate::layers::forward;
use bake_runtime::Network;
use bake_runtime::concentric::DISK_AREA;
use bake_runtime::encoding::Encoding;
use bake_runtime::frame::FRAME_OUTPUT_MAX;
use std::f32::consts::FRAC_PI_4;

/// A predicted frame; every value is `[N, 1]`.
pub struct Frame {
    log_x: Value,
    log_y: Value,
    shear: Value,
    delta: [Value; 2],
    anchor: [Value; 2],
}

/// A position in a frame's square, `h` and 1 − h kept apart; both `[N, 2]`.
pub struct Square {
    /// h.
    pub position: Value,
    /// 1 − h, more precise next to the edges than a subtraction.
    pub complement: Value,
}

impl Frame {
    /// The frame that `network` predicts for the folded `wo` `[N, 3]`.
    pub fn predict(g: &mut Graph, network: &Network, wo: Value) -> Frame {
        g.scope("frame");
        let features = encode(g, Encoding::Grazing, wo);
        let outputs = forward(g, "frame", &network.frame, network.spec.activation, features);
        let outputs = g.clip(outputs, FRAME_OUTPUT_MAX as f32);
        let [log_x, log_y, shear, delta_x, delta_y] = g.columns(outputs);
        let anchor = mirror_anchor(g, wo, network.spec.frame.anchor_alpha);
        Frame {
            log_x,
            log_y,
            shear,
            delta: [delta_x, delta_y],
            anchor,
        }
    }

    /// Direction `[N, 3]` at `square`, and dω / d(square), sr, `[N, 1]`.
    pub fn square_to_direction(&self, g: &mut Graph, square: &Square) -> (Value, Value) {
        g.scope("direction");
        let [lx, ly, z] = square_to_hemisphere(g, square);
        let [px, py] = [(lx, self.delta[0]), (ly, self.delta[1])].map(|(l, delta)| {
            let shift = g.mul(delta, z);
            g.add(l, shift)
        });
        let (x, y) = (g.unary("Exp", self.log_x), g.unary("Exp", self.log_y));
        let sheared = g.mul(self.shear, px);
        let py = g.add(sheared, py);
        let [vx, vy] = [(x, px, self.anchor[0]), (y, py, self.anchor[1])].map(|(scale, p, anchor)| {
            let (scaled, centre) = (g.mul(scale, p), g.mul(anchor, z));
            g.add(scaled, centre)
        });
        let n2 = squared_length(g, [vx, vy, z]);
        let n = g.unary("Sqrt", n2);
        let v = g.concat(&[vx, vy, z]);
        // π·det A / n⁴ over cos θ = z/n.
        let det = g.mul(x, y);
        let area = g.mul_scalar(det, DISK_AREA as f32);
        let n3 = g.mul(n2, n);
        let n3z = g.mul(n3, z);
        (g.div(v, n), g.div(area, n3z))
    }

    /// Local direction `[N, 3]` of `w` `[N, 3]`, and the frame's density at `w`, sr⁻¹, `[N, 1]`.
    pub fn to_local(&self, g: &mut Graph, w: Value) -> (Value, Value) {
        g.scope("local");
        let [wx, wy, z] = g.columns(w);
        let [qx, qy] =
            [(wx, self.anchor[0], self.log_x), (wy, self.anchor[1], self.log_y)].map(|(w, anchor, log)| {
                let centre = g.mul(anchor, z);
                let offset = g.sub(w, centre);
                let scale = g.unary("Exp", log);
                g.div(offset, scale)
            });
        let sheared = g.mul(self.shear, qx);
        let qy = g.sub(qy, sheared);
        let [px, py] = [(qx, self.delta[0]), (qy, self.delta[1])].map(|(q, delta)| {
            let shift = g.mul(delta, z);
            g.sub(q, shift)
        });
        let m2 = squared_length(g, [px, py, z]);
        let m = g.unary("Sqrt", m2);
        let p = g.concat(&[px, py, z]);
        let log_det = g.add(self.log_x, self.log_y);
        let det = g.unary("Exp", log_det);
        let area = g.mul_scalar(det, DISK_AREA as f32);
        let m4 = g.mul(m2, m2);
        let spread = g.mul(area, m4);
        (g.div(p, m), g.div(z, spread))
    }
}

/// Slopes −(x, y) / (z + |(α_x·x, α_y·y)|) of the folded `wo`.
fn mirror_anchor(g: &mut Graph, wo: Value, alpha: [f64; 2]) -> [Value; 2] {
    let [x, y, z] = g.columns(wo);
    let (ax, ay) = (g.mul_scalar(x, alpha[0] as f32), g.mul_scalar(y, alpha[1] as f32));
    let (axx, ayy) = (g.mul(ax, ax), g.mul(ay, ay));
    let pull2 = g.add(axx, ayy);
    let pull = g.unary("Sqrt", pull2);
    let sum = g.add(z, pull);
    let smallest = g.scalar(f32::MIN_POSITIVE);
    let distance = g.max(sum, smallest);
    [x, y].map(|c| {
        let slope = g.div(c, distance);
        g.unary("Neg", slope)
    })
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

fn squared_length(g: &mut Graph, v: [Value; 3]) -> Value {
    let [xx, yy, zz] = v.map(|c| g.mul(c, c));
    let xy = g.add(xx, yy);
    g.add(xy, zz)
}
