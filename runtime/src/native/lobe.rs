//! The geometry of a query on vectors: grazing features, the concentric square and the lobe frame. The same
//! formulas as [`crate::encoding`], [`crate::concentric`] and [`crate::frame`], which say where they come from.

use super::math::{exp, ln, sin_cos};
use super::vector::Vector;
use crate::concentric::DISK_AREA;
use crate::encoding::{GRAZING_FEATURES, GRAZING_LOG_OFFSET};
use crate::frame::{FRAME_OUTPUT_MAX, FRAME_OUTPUTS};
use std::f32::consts::FRAC_PI_4;

/// Smallest squared length that a direction is divided by: far below any that the clamped frame outputs can
/// give a unit vector, so it only keeps vectors that are not unit finite.
const LENGTH_SQUARED_MIN: f32 = 1e-30;

/// [`crate::encoding::grazing`].
#[inline(always)]
pub fn grazing<V: Vector>(w: [V; 3]) -> [V; GRAZING_FEATURES] {
    let [x, y, z] = w;
    let log = ln(z + z.splat(GRAZING_LOG_OFFSET as f32));
    let half_log = log.mul_add_const(z.splat(0.5), 1.0);
    [x, y, z, z.sqrt(), half_log, x.mul_add(x, -(y * y)), (x + x) * y]
}

/// [`crate::concentric::square_to_hemisphere`].
#[inline(always)]
pub fn square_to_hemisphere<V: Vector>(s: [V; 2], complement: [V; 2]) -> [V; 3] {
    let a = s[0] - complement[0];
    let b = s[1] - complement[1];
    // The nearer edge decides, not the larger coordinate: in a corner both coordinates round to 1.
    let (edge_x, edge_y) = (s[0].min(complement[0]), s[1].min(complement[1]));
    let first = edge_x.less(edge_y);
    let edge = V::select(first, edge_x, edge_y);
    let r = V::select(first, a, b);
    let minor = V::select(first, b, a);
    // At the centre both are 0; a divisor that is 1 there makes the ratio 0.
    let zero = r.splat(0.0);
    let divisor = V::select(zero.less(r.abs()), r, r.splat(1.0));
    let (sin, cos) = sin_cos(minor / divisor * r.splat(FRAC_PI_4));
    let (along, across) = (r * cos, r * sin);
    let z2 = r.splat(4.0) * edge * (r.splat(1.0) - edge);
    [
        V::select(first, along, across),
        V::select(first, across, along),
        z2.sqrt(),
    ]
}

/// [`crate::frame::Frame`] of one vector of queries.
pub struct Lobe<V> {
    x: V,
    y: V,
    shear: V,
    b: [V; 2],
}

impl<V: Vector> Lobe<V> {
    /// [`crate::frame::Frame::from_outputs`] around [`crate::frame::mirror_anchor`] of `wo`.
    #[inline(always)]
    pub fn new(outputs: [V; FRAME_OUTPUTS], wo: [V; 3], anchor_alpha: [f32; 2]) -> Self {
        let max = FRAME_OUTPUT_MAX as f32;
        let [log_x, log_y, shear, dx, dy] = outputs;
        let (x, y) = (exp(log_x.clamp(-max, max)), exp(log_y.clamp(-max, max)));
        let (shear, dx, dy) = (shear.clamp(-max, max), dx.clamp(-max, max), dy.clamp(-max, max));
        let along_x = wo[0] * x.splat(anchor_alpha[0]);
        let along_y = wo[1] * x.splat(anchor_alpha[1]);
        let pull = along_x.mul_add(along_x, along_y * along_y).sqrt();
        let scale = x.splat(-1.0) / (wo[2] + pull).max(x.splat(f32::MIN_POSITIVE));
        let b = [
            scale.mul_add(wo[0], x * dx),
            scale.mul_add(wo[1], y * shear.mul_add(dx, dy)),
        ];
        Lobe { x, y, shear, b }
    }

    /// Unit direction of the local direction `local`, and its dω·cos θ/ds over cos θ in the frame's square:
    /// π·det A/(n³·z) with z the height of `local`, sr.
    #[inline(always)]
    pub fn to_direction(&self, local: [V; 3]) -> ([V; 3], V) {
        let [x, y, z] = local;
        let v = [
            self.x.mul_add(x, self.b[0] * z),
            self.y.mul_add(self.shear.mul_add(x, y), self.b[1] * z),
        ];
        let n2 = v[0]
            .mul_add(v[0], v[1].mul_add(v[1], z * z))
            .max(z.splat(LENGTH_SQUARED_MIN));
        let n = n2.sqrt();
        let direction = [v[0] / n, v[1] / n, (z / n).max(z.splat(f32::MIN_POSITIVE))];
        let area = z.splat(DISK_AREA as f32) * self.x * self.y;
        (direction, area / (n2 * n * z))
    }

    /// [`crate::frame::Frame::to_local`]: unit local direction of `w`, and the frame's density there, sr⁻¹.
    #[inline(always)]
    pub fn to_local(&self, w: [V; 3]) -> ([V; 3], V) {
        let [x, y, z] = w;
        let px = (-self.b[0]).mul_add(z, x) / self.x;
        let py = (-self.shear).mul_add(px, (-self.b[1]).mul_add(z, y) / self.y);
        let m2 = px
            .mul_add(px, py.mul_add(py, z * z))
            .max(z.splat(LENGTH_SQUARED_MIN));
        let m = m2.sqrt();
        let area = z.splat(DISK_AREA as f32) * self.x * self.y;
        // The determinant first: it is small where m is large, and m⁴ alone could overflow.
        ([px / m, py / m, z / m], z / (area * m2 * m2))
    }
}
