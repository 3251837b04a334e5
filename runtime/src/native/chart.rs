//! Charts of a query on vectors: the analytic start, what a frame network makes of it, and the way of directions through
//! both. The same maps as [`crate::anchor`], [`crate::frame`] and [`crate::boost`], which say where they come from, in
//! forms whose terms are all positive, so that single precision holds at grazing angles.

use super::math::{exp, ln};
use super::vector::Vector;
use crate::anchor::{ANCHOR_SCALARS, PULL, VARIANCE_MAX};
use crate::concentric::DISK_AREA;
use crate::frame::{FRAME_OUTPUT_MAX, FRAME_OUTPUTS};

/// Smallest squared length that a direction is divided by: far below any that the clamped frame outputs can
/// give a unit vector, so it only keeps vectors that are not unit finite.
const LENGTH_SQUARED_MIN: f32 = 1e-30;

/// 1/[`VARIANCE_MAX`].
const PRECISION_MIN: f32 = (1.0 / VARIANCE_MAX) as f32;

/// Where a chart starts from: a frame without shift, and a boost.
#[derive(Clone, Copy)]
pub struct Start<V> {
    /// A = [[x, 0], [y·shear, y]].
    frame: [V; 3],
    /// Velocity of the boost.
    beta: [V; 2],
    /// √(1 − |β|²), > 0.
    cos: V,
}

impl<V: Vector> Start<V> {
    /// [`crate::chart::Chart::IDENTITY`]; `like` is only the proof.
    #[inline(always)]
    pub fn identity(like: V) -> Self {
        let (zero, one) = (like.splat(0.0), like.splat(1.0));
        Start {
            frame: [one, one, zero],
            beta: [zero; 2],
            cos: one,
        }
    }

    /// [`crate::anchor::mirror_chart`].
    ///
    /// S's diagonal is cos + β²/(1 + cos) of the other axis' β, where 1 − β²/(1 + cos) would cancel.
    #[inline(always)]
    pub fn mirror(wo: [V; 3], alpha: [V; 2]) -> Self {
        let [x, y, z] = wo;
        let sin2 = x.mul_add(x, y * y);
        let (chord_x, chord_y) = (alpha[1] * x, alpha[0] * y);
        let inverse_chord = chord_x
            .mul_add(chord_x, chord_y * chord_y)
            .max(z.splat(LENGTH_SQUARED_MIN))
            .inverse_sqrt();
        let d = (alpha[0] * alpha[1] * z.splat(PULL as f32)).mul_add(sin2 * inverse_chord, z);
        let one = z.splat(1.0);
        let scale = d.mul_add(d, sin2).inverse_sqrt();
        let (bx, by, cos) = (x * scale, y * scale, d * scale);

        let quarter = z.splat(0.25);
        let (qx, qy) = (
            quarter.over(alpha[0] * alpha[0]),
            quarter.over(alpha[1] * alpha[1]),
        );
        let k = (one + cos).reciprocal();
        let (sxx, sxy, syy) = (
            (k * by).mul_add(by, cos),
            -(k * bx) * by,
            (k * bx).mul_add(bx, cos),
        );
        let least = z.splat(PRECISION_MIN);
        let pxx = (sxx * sxx).mul_add(qx, sxy * sxy * qy);
        let pyy = (sxy * sxy).mul_add(qx, syy * syy * qy);
        let pxy = sxy * sxx.mul_add(qx, syy * qy);
        let det = (cos * cos * qx).mul_add(qy, (pxx + pyy + least) * least);
        let capped = pyy + least;
        let (inverse_root, inverse_height) = (det.inverse_sqrt(), capped.inverse_sqrt());
        let height = capped * inverse_height;
        Start {
            frame: [height * inverse_root, inverse_height, -pxy * inverse_root],
            beta: [bx, by],
            cos,
        }
    }

    /// `yes` where `mask` holds, `no` elsewhere.
    #[inline(always)]
    pub fn select(mask: V::Mask, yes: &Self, no: &Self) -> Self {
        let mut selected = *yes;
        for (own, no) in selected.frame.iter_mut().zip(no.frame) {
            *own = V::select(mask, *own, no);
        }
        for (own, no) in selected.beta.iter_mut().zip(no.beta) {
            *own = V::select(mask, *own, no);
        }
        selected.cos = V::select(mask, yes.cos, no.cos);
        selected
    }

    /// [`crate::anchor::anchor_scalars`].
    #[inline(always)]
    pub fn scalars(&self) -> [V; ANCHOR_SCALARS] {
        let ([x, y, shear], one) = (self.frame, self.cos.splat(1.0));
        [
            self.beta[0],
            self.beta[1],
            self.cos,
            half_log(x),
            half_log(y),
            shear * shear.mul_add(shear, one).inverse_sqrt(),
        ]
    }
}

/// 1 + ½·ln v.
#[inline(always)]
fn half_log<V: Vector>(v: V) -> V {
    ln(v).mul_add_const(v.splat(0.5), 1.0)
}

/// [`crate::chart::Chart`] of one vector of queries.
pub struct Chart<V> {
    frame: [V; 3],
    b: [V; 2],
    beta: [V; 2],
    cos: V,
}

impl<V: Vector> Chart<V> {
    /// [`crate::frame::Frame::from_outputs`] from `start`, and its boost.
    #[inline(always)]
    pub fn new(outputs: [V; FRAME_OUTPUTS], start: &Start<V>) -> Self {
        let max = FRAME_OUTPUT_MAX as f32;
        let mut outputs = outputs;
        for output in &mut outputs {
            *output = output.clamp(-max, max);
        }
        let [log_x, log_y, shear, dx, dy] = outputs;
        let (scale_x, scale_y) = (exp(log_x), exp(log_y));
        let (x, y) = (start.frame[0] * scale_x, start.frame[1] * scale_y);
        let shear = start.frame[2].mul_add(scale_x.over(scale_y), shear);
        Chart {
            frame: [x, y, shear],
            b: [x * dx, y * shear.mul_add(dx, dy)],
            beta: start.beta,
            cos: start.cos,
        }
    }

    /// π·det A.
    #[inline(always)]
    fn area(&self) -> V {
        self.cos.splat(DISK_AREA as f32) * self.frame[0] * self.frame[1]
    }

    /// Unit direction of the local direction `local` (unit, z > 0), and dω/ds in the chart's square, sr.
    ///
    /// With V = A·(x, y) + b·z before it is made unit, n its length and P = n²·(1 − v·β) =
    /// ½(|V − nβ|² + z² + n²cos²), the boost gives (n·cos·(V − nβ) + β·(n²cos² − P)/(1 + cos), n·cos·z), of length P.
    #[inline(always)]
    pub fn to_direction(&self, local: [V; 3]) -> ([V; 3], V) {
        let ([x, y, z], [ax, ay, shear]) = (local, self.frame);
        let one = z.splat(1.0);
        let least = z.splat(LENGTH_SQUARED_MIN);
        let v = [
            ax.mul_add(x, self.b[0] * z),
            ay.mul_add(shear.mul_add(x, y), self.b[1] * z),
        ];
        let n2 = v[0].mul_add(v[0], v[1].mul_add(v[1], z * z)).max(least);
        let n = n2 * n2.inverse_sqrt();
        let offset = [(-n).mul_add(self.beta[0], v[0]), (-n).mul_add(self.beta[1], v[1])];
        let ncos = n * self.cos;
        let rest = ncos * ncos;
        let p = z.splat(0.5) * offset[0].mul_add(offset[0], offset[1].mul_add(offset[1], z.mul_add(z, rest)));
        let pull = (rest - p) * (one + self.cos).reciprocal();
        let w = [
            ncos.mul_add(offset[0], self.beta[0] * pull),
            ncos.mul_add(offset[1], self.beta[1] * pull),
            ncos * z,
        ];
        let length2 = w[0].mul_add(w[0], w[1].mul_add(w[1], w[2] * w[2]));
        let scale = length2.max(least).inverse_sqrt();
        let direction = [
            w[0] * scale,
            w[1] * scale,
            (w[2] * scale).max(z.splat(f32::MIN_POSITIVE)),
        ];
        // π·det A/(n³·z) times the boost's n⁴·cos²/P², in steps that stay numbers.
        let squeeze = self.cos.over(p.max(least));
        (direction, self.area() * squeeze * (squeeze * n.over(z)))
    }

    /// Unit local direction of the unit direction `w`, and the chart's density there, sr⁻¹: the inverse of
    /// [`Chart::to_direction`].
    #[inline(always)]
    pub fn to_local(&self, w: [V; 3]) -> ([V; 3], V) {
        let ([x, y, z], [ax, ay, shear]) = (w, self.frame);
        let one = z.splat(1.0);
        let offset = [x + self.beta[0], y + self.beta[1]];
        let rest = self.cos * self.cos;
        // 1 + w·β.
        let p = z.splat(0.5) * offset[0].mul_add(offset[0], offset[1].mul_add(offset[1], z.mul_add(z, rest)));
        let squeeze = self.cos.over(p);
        let pull = (p - rest).over(p * (one + self.cos));
        let v = [
            squeeze.mul_add(offset[0], self.beta[0] * pull),
            squeeze.mul_add(offset[1], self.beta[1] * pull),
            squeeze * z,
        ];
        let px = (-self.b[0]).mul_add(v[2], v[0]).over(ax);
        let py = (-shear).mul_add(px, (-self.b[1]).mul_add(v[2], v[1]).over(ay));
        let m2 = px
            .mul_add(px, py.mul_add(py, v[2] * v[2]))
            .max(z.splat(LENGTH_SQUARED_MIN));
        let scale = m2.inverse_sqrt();
        // The determinant first: it is small where m is large, and m⁴ alone could overflow.
        let density = v[2].over(self.area() * m2 * m2);
        (
            [px * scale, py * scale, v[2] * scale],
            density * (squeeze * squeeze),
        )
    }
}
