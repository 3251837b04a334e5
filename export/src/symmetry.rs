//! The fold of queries as graph operations: the f32 counterpart of `oracle::fold`.

use crate::graph::{Graph, Value};
use bake_runtime::spec::Symmetry;

/// What carries directions into the folded domain and back.
pub enum Turn {
    /// Signs `[N, 3]`.
    Mirror(Value),
    /// Cosine and sine `[N, 1]` of the azimuth of `wo`.
    Rotation([Value; 2]),
}

impl Turn {
    /// `w` `[N, 3]` folded.
    pub fn fold(&self, g: &mut Graph, w: Value) -> Value {
        match *self {
            Turn::Mirror(signs) => g.mul(w, signs),
            Turn::Rotation([cos, sin]) => {
                let back = g.unary("Neg", sin);
                turned(g, w, [cos, back])
            }
        }
    }

    /// The direction `[N, 3]` whose fold is `w`.
    pub fn unfold(&self, g: &mut Graph, w: Value) -> Value {
        match *self {
            Turn::Mirror(signs) => g.mul(w, signs),
            Turn::Rotation(angle) => turned(g, w, angle),
        }
    }
}

/// `wo` `[N, 3]` folded by `symmetry`, and what folds `wi` with it.
///
/// The sign of z needs no case of its own: it is positive wherever the answer counts.
pub fn fold(g: &mut Graph, symmetry: Symmetry, wo: Value) -> (Value, Turn) {
    g.scope("fold");
    match symmetry {
        Symmetry::Quadrant => {
            let (zero, plus, minus) = (g.scalar(0.0), g.scalar(1.0), g.scalar(-1.0));
            let negative = g.less(wo, zero);
            let signs = g.select(negative, minus, plus);
            (g.unary("Abs", wo), Turn::Mirror(signs))
        }
        Symmetry::Rotation => {
            let [x, y, z] = g.columns(wo);
            // Over the larger component, so that squares of tiny ones do not vanish.
            let sizes = [x, y].map(|c| g.unary("Abs", c));
            let larger = g.max(sizes[0], sizes[1]);
            let (zero, one) = (g.scalar(0.0), g.scalar(1.0));
            let slanted = g.greater(larger, zero);
            let divisor = g.select(slanted, larger, one);
            let [dx, dy] = [x, y].map(|c| g.div(c, divisor));
            let (xx, yy) = (g.mul(dx, dx), g.mul(dy, dy));
            let square = g.add(xx, yy);
            let length = g.unary("Sqrt", square);
            let length = g.select(slanted, length, one);
            let (cos, sin) = (g.div(dx, length), g.div(dy, length));
            let cos = g.select(slanted, cos, one);
            let slant = g.mul(larger, length);
            let across = g.mul(z, zero);
            (g.concat(&[slant, across, z]), Turn::Rotation([cos, sin]))
        }
    }
}

/// `w` turned around the normal by the angle of this cosine and sine.
fn turned(g: &mut Graph, w: Value, [cos, sin]: [Value; 2]) -> Value {
    let [x, y, z] = g.columns(w);
    let (cx, sy, sx, cy) = (g.mul(cos, x), g.mul(sin, y), g.mul(sin, x), g.mul(cos, y));
    let (x, y) = (g.sub(cx, sy), g.add(sx, cy));
    g.concat(&[x, y, z])
}
