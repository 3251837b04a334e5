//! Network inputs: the encodings of `bake_runtime::encoding` as graph operations.

use crate::graph::{Graph, Value};
use bake_runtime::encoding::{Encoding, GRAZING_LOG_OFFSET};

/// Features of `values` `[N, k]`, in the order of [`Encoding::append`].
pub fn encode(g: &mut Graph, encoding: Encoding, values: Value) -> Value {
    match encoding {
        Encoding::Centred => {
            let doubled = g.mul_scalar(values, CENTRED_SLOPE);
            g.add_scalar(doubled, -1.0)
        }
        Encoding::Identity => values,
        Encoding::Grazing => grazing(g, values),
    }
}

/// Derivative of [`Encoding::Centred`].
pub const CENTRED_SLOPE: f32 = 2.0;

fn grazing(g: &mut Graph, w: Value) -> Value {
    let [x, y, z] = g.columns(w);
    let root = g.unary("Sqrt", z);
    let softened = g.add_scalar(z, GRAZING_LOG_OFFSET as f32);
    let log = g.unary("Log", softened);
    let half_log = g.mul_scalar(log, 0.5);
    let decade = g.add_scalar(half_log, 1.0);
    let (xx, yy, xy) = (g.mul(x, x), g.mul(y, y), g.mul(x, y));
    let cos_harmonic = g.sub(xx, yy);
    let sin_harmonic = g.mul_scalar(xy, 2.0);
    g.concat(&[w, root, decade, cos_harmonic, sin_harmonic])
}
