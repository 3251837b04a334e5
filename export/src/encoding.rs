//! The scales and encodings of `bake_runtime::encoding` as graph operations, in the order of its features.

use crate::graph::{Graph, Value};
use bake_runtime::encoding::{Encoding, GRAZING_LOG_OFFSET, Scale};
use std::f64::consts::PI;

/// Derivative of [`Encoding::Centred`].
const CENTRED_SLOPE: f32 = 2.0;

/// `x` after `scale`, elementwise.
pub fn scaled(g: &mut Graph, scale: Scale, x: Value) -> Value {
    let transformed = match scale {
        Scale::None => return x,
        Scale::Linear(_) => x,
        Scale::Sqrt(_) => {
            let zero = g.scalar(0.0);
            let positive = g.max(x, zero);
            g.unary("Sqrt", positive)
        }
        Scale::Decay(_) => {
            let negated = g.unary("Neg", x);
            let rest = g.unary("Exp", negated);
            g.one_minus(rest)
        }
    };
    let (offset, factor) = scale.affine();
    let above = g.add_scalar(transformed, -offset as f32);
    g.mul_scalar(above, factor as f32)
}

/// Features `[N, encoding.features(scalars)]` of `values` `[N, scalars]`.
pub fn encode(g: &mut Graph, encoding: Encoding, values: Value, scalars: usize) -> Value {
    let features = encoding.features(scalars);
    match encoding {
        Encoding::Centred => {
            let doubled = g.mul_scalar(values, CENTRED_SLOPE);
            g.add_scalar(doubled, -1.0)
        }
        Encoding::Identity => values,
        Encoding::Grazing => grazing(g, values),
        Encoding::Slant => slant(g, values),
        Encoding::Frequency(k) => {
            let (sin, cos) = half_turns(g, values, k);
            g.interleave(sin, cos, features)
        }
        Encoding::OneBlob(l) => {
            let (_, blobs) = blobs(g, values, l);
            g.flatten(blobs, features)
        }
    }
}

/// Features of `values` as [`encode`] has them, and the derivative of each by its own scalar, `[N, features]`, or
/// `[1, features]` where every query has the same.
pub fn encode_with_slopes(
    g: &mut Graph,
    encoding: Encoding,
    values: Value,
    scalars: usize,
) -> (Value, Value) {
    let features = encoding.features(scalars);
    let constant = |g: &mut Graph, slope: f32| g.constant(&[1, features], &vec![slope; features]);
    match encoding {
        Encoding::Centred => (encode(g, encoding, values, scalars), constant(g, CENTRED_SLOPE)),
        Encoding::Identity => (values, constant(g, 1.0)),
        Encoding::Grazing | Encoding::Slant => unreachable!("directions do not depend on u"),
        Encoding::Frequency(k) => {
            let (sin, cos) = half_turns(g, values, k);
            let rates: Vec<f32> = powers(k).map(|power| (PI * power) as f32).collect();
            let falls: Vec<f32> = rates.iter().map(|rate| -rate).collect();
            let (rates, falls) = (g.constant(&[k], &rates), g.constant(&[k], &falls));
            let (of_sin, of_cos) = (g.mul(cos, rates), g.mul(sin, falls));
            (
                g.interleave(sin, cos, features),
                g.interleave(of_sin, of_cos, features),
            )
        }
        Encoding::OneBlob(l) => {
            let (offsets, blobs) = blobs(g, values, l);
            let product = g.mul(offsets, blobs);
            let slopes = g.mul_scalar(product, -(l as f32));
            (g.flatten(blobs, features), g.flatten(slopes, features))
        }
    }
}

fn grazing(g: &mut Graph, w: Value) -> Value {
    let [x, y, z] = g.columns(w);
    let [root, decade] = heights(g, z);
    let (xx, yy, xy) = (g.mul(x, x), g.mul(y, y), g.mul(x, y));
    let cos_harmonic = g.sub(xx, yy);
    let sin_harmonic = g.mul_scalar(xy, 2.0);
    g.concat(&[w, root, decade, cos_harmonic, sin_harmonic])
}

fn slant(g: &mut Graph, w: Value) -> Value {
    let [x, _, z] = g.columns(w);
    let [root, decade] = heights(g, z);
    g.concat(&[x, z, root, decade])
}

/// √z and 1 + ln(z + [`GRAZING_LOG_OFFSET`])/2.
fn heights(g: &mut Graph, z: Value) -> [Value; 2] {
    let root = g.unary("Sqrt", z);
    let softened = g.add_scalar(z, GRAZING_LOG_OFFSET as f32);
    let log = g.unary("Log", softened);
    let half_log = g.mul_scalar(log, 0.5);
    [root, g.add_scalar(half_log, 1.0)]
}

/// sin and cos of 2ⁱ·π·x for i = 0…k − 1 and every scalar x, each `[N, scalars, k]`.
fn half_turns(g: &mut Graph, values: Value, k: usize) -> (Value, Value) {
    let powers: Vec<f32> = powers(k).map(|power| power as f32).collect();
    let (powers, deep) = (g.constant(&[k], &powers), g.deepen(values, 2));
    let turns = g.mul(deep, powers);
    // Whole turns are taken off exactly, before π rounds what is left: t − 2·round(t/2) in −1..1.
    let halves = g.mul_scalar(turns, 0.5);
    let whole = g.unary("Round", halves);
    let doubled = g.mul_scalar(whole, 2.0);
    let rest = g.sub(turns, doubled);
    let angle = g.mul_scalar(rest, PI as f32);
    (g.unary("Sin", angle), g.unary("Cos", angle))
}

/// 2⁰ … 2^(k − 1).
fn powers(k: usize) -> impl Iterator<Item = f64> {
    (0..k).map(|i| (1u64 << i) as f64)
}

/// Distances t = l·x − i − ½ from the centres of `l` bins, and the Gaussians e^(−t²/2), each `[N, scalars, l]`.
fn blobs(g: &mut Graph, values: Value, l: usize) -> (Value, Value) {
    let centres: Vec<f32> = (0..l).map(|i| i as f32 + 0.5).collect();
    let (centres, deep) = (g.constant(&[l], &centres), g.deepen(values, 2));
    let stretched = g.mul_scalar(deep, l as f32);
    let offsets = g.sub(stretched, centres);
    let squares = g.mul(offsets, offsets);
    let exponents = g.mul_scalar(squares, -0.5);
    (offsets, g.unary("Exp", exponents))
}
