//! From the scalars of a tile to the features that enter a network: the formulas of [`crate::encoding`] on vectors.

use super::columns::TANGENT_COLUMNS;
use super::math::{EXP_MAX, decay, exp, half_turns, ln, within_a_turn};
use super::stack::Buffers;
use super::tile::{Column, read_parameter};
use super::vector::{ROUND, Simd, Task, Vector};
use crate::anchor::ANCHOR_SCALARS;
use crate::encoding::{Encoding, GRAZING_FEATURES, GRAZING_LOG_OFFSET, Quantity, SLANT_FEATURES, Scale};
use crate::spec::{CHARTS_MAX, Input};
use std::f32::consts::PI;
use std::ops::Range;

/// One input of a network, ready for vectors.
#[derive(Clone)]
pub struct Feature {
    /// What enters.
    pub quantity: Quantity,
    /// How it becomes features.
    pub encoding: Encoding,
    /// Where these stand among all features of the network.
    pub rows: Range<usize>,
    /// Where the first of them stands among the features of the frame network, if that has the same.
    in_frame: Option<usize>,
    scale: Scale,
    /// Of the scale, see [`Scale::affine`].
    offset: f32,
    factor: f32,
}

impl Feature {
    /// `inputs` of one network, ready for vectors.
    pub fn all(inputs: &[Input]) -> Vec<Feature> {
        let mut start = 0;
        let feature = |input: &Input| {
            let rows = start..start + input.features();
            start = rows.end;
            Feature::new(input, rows)
        };
        inputs.iter().map(feature).collect()
    }

    /// Tells `inputs` of a network which of them its frame network, of the inputs `of_frame`, has as well.
    pub fn share(inputs: &mut [Feature], of_frame: &[Feature]) {
        for input in inputs {
            let same = |other: &&Feature| {
                (other.quantity, other.encoding, other.scale) == (input.quantity, input.encoding, input.scale)
            };
            input.in_frame = of_frame.iter().find(same).map(|other| other.rows.start);
        }
    }

    fn new(input: &Input, rows: Range<usize>) -> Feature {
        let (offset, factor) = input.scale.affine();
        Feature {
            quantity: input.quantity,
            encoding: input.encoding,
            rows,
            in_frame: None,
            scale: input.scale,
            offset: offset as f32,
            factor: factor as f32,
        }
    }

    /// The features of the single number `value`, in f64.
    pub fn of_number(&self, value: f64) -> Vec<f64> {
        let mut features = Vec::new();
        self.encoding.append(&[self.scale.apply(value)], &mut features);
        features
    }

    /// [`Scale::apply`].
    #[inline(always)]
    fn scaled<V: Vector>(&self, x: V) -> V {
        let t = match self.scale {
            Scale::None => return x,
            Scale::Linear(_) => x,
            Scale::Sqrt(_) => x.max(x.splat(0.0)).sqrt(),
            Scale::Decay(_) => decay(x.clamp(-EXP_MAX, EXP_MAX)),
        };
        (t - x.splat(self.offset)) * x.splat(self.factor)
    }
}

/// Everything that the inputs of one tile are made of, [`crate::features::Point`] in columns; what the tile does not have
/// is empty.
pub struct Scalars<'a, V, const N: usize> {
    /// The free parameters of the batch.
    pub params: &'a [&'a [f32]],
    /// The tile's first query.
    pub start: usize,
    /// Camera directions, folded.
    pub wo: &'a [Column<V, N>; 3],
    /// Scalars of the mirror chart.
    pub anchor: &'a [Column<V, N>; ANCHOR_SCALARS],
    /// Uniform numbers of the drawn chart.
    pub u: &'a [Column<V, N>],
    /// ±1 for the drawn chart.
    pub chart: &'a [Column<V, N>],
    /// x and y of the light's direction, folded.
    pub wi: &'a [Column<V, N>],
    /// The light's direction in the frame of every chart.
    pub local: [&'a [Column<V, N>]; CHARTS_MAX],
}

impl<V: Vector, const N: usize> Scalars<'_, V, N> {
    /// Writes the features of `inputs` to their rows of the input of `buffers`. Those that the frame network has as well are
    /// taken from there.
    #[inline(always)]
    pub fn encode<S: Simd<Vector = V>>(&self, simd: S, inputs: &[Feature], buffers: &mut Buffers<V, N>) {
        simd.enter(Encode {
            simd,
            scalars: self,
            inputs,
            buffers,
        });
    }
}

/// [`Scalars::encode`]: a task of its own, so that all networks share one copy of its code.
struct Encode<'a, 'b, S: Simd, const N: usize> {
    simd: S,
    scalars: &'a Scalars<'b, S::Vector, N>,
    inputs: &'a [Feature],
    buffers: &'a mut Buffers<S::Vector, N>,
}

impl<S: Simd, const N: usize> Task for Encode<'_, '_, S, N> {
    #[inline(always)]
    fn run(self) {
        let (simd, all) = (self.simd, self.scalars);
        let (out, of_frame) = self.buffers.input_and_kept();
        for input in self.inputs {
            if let Some(start) = input.in_frame {
                out[input.rows.clone()].copy_from_slice(&of_frame[start..start + input.rows.len()]);
                continue;
            }
            let own;
            let scalars: &[Column<S::Vector, N>] = match input.quantity {
                Quantity::U => all.u,
                Quantity::Wo => all.wo,
                Quantity::WoDisk => &all.wo[..2],
                Quantity::WiDisk => all.wi,
                Quantity::Local(chart) => all.local[chart],
                Quantity::Anchor => all.anchor,
                Quantity::Chart => all.chart,
                Quantity::Parameter(parameter) => {
                    own = [read_parameter(simd, all.params[parameter], all.start)];
                    &own
                }
            };
            input.append(scalars, &mut out[input.rows.clone()]);
        }
    }
}

impl Feature {
    /// [`Encoding::append`] on the columns `scalars`, to `rows`.
    #[inline(always)]
    fn append<V: Vector, const N: usize>(&self, scalars: &[Column<V, N>], rows: &mut [Column<V, N>]) {
        match self.encoding {
            Encoding::Grazing => {
                for q in 0..N {
                    let features = grazing([scalars[0][q], scalars[1][q], scalars[2][q]]);
                    for (row, &feature) in rows.iter_mut().zip(&features) {
                        row[q] = feature;
                    }
                }
            }
            Encoding::Slant => {
                for q in 0..N {
                    let features = slant([scalars[0][q], scalars[1][q], scalars[2][q]]);
                    for (row, &feature) in rows.iter_mut().zip(&features) {
                        row[q] = feature;
                    }
                }
            }
            encoding => {
                for (scalar, rows) in scalars.iter().zip(rows.chunks_exact_mut(encoding.features(1))) {
                    let mut scaled = *scalar;
                    if self.scale != Scale::None {
                        for x in &mut scaled {
                            *x = self.scaled(*x);
                        }
                    }
                    append_scalar(encoding, scaled, rows);
                }
            }
        }
    }
}

/// Writes the features of one scalar to `rows`.
#[inline(always)]
fn append_scalar<V: Vector, const N: usize>(
    encoding: Encoding,
    mut scalar: Column<V, N>,
    rows: &mut [Column<V, N>],
) {
    match encoding {
        // Those of whole directions have been written.
        Encoding::Identity | Encoding::Grazing | Encoding::Slant => rows[0] = scalar,
        Encoding::Centred => {
            for (to, s) in rows[0].iter_mut().zip(scalar) {
                *to = s + s - s.splat(1.0);
            }
        }
        Encoding::Frequency(_) => {
            for x in &mut scalar {
                *x = first_turn(*x);
            }
            for [sin, cos] in rows.as_chunks_mut::<2>().0 {
                for q in 0..N {
                    (sin[q], cos[q]) = half_turns(scalar[q]);
                    scalar[q] = next_turn(scalar[q]);
                }
            }
        }
        Encoding::OneBlob(l) => {
            for (i, row) in rows.iter_mut().enumerate() {
                for (to, &x) in row.iter_mut().zip(&scalar) {
                    *to = blob(x, i, l).0;
                }
            }
        }
    }
}

/// Writes the features of `inputs`, all of them of u, with their derivatives by u₀ and u₁, to their rows of `out`.
#[inline(always)]
pub fn encode_tangents<V: Vector>(inputs: &[Feature], u: [V; 2], out: &mut [[V; TANGENT_COLUMNS]]) {
    for input in inputs {
        let encoding = input.encoding;
        let mut rest = &mut out[input.rows.clone()];
        for (j, x) in u.into_iter().enumerate() {
            let (rows, after) = rest.split_at_mut(encoding.features(1));
            rest = after;
            match encoding {
                Encoding::Centred => rows[0] = slopes(j, x + x - x.splat(1.0), x.splat(2.0)),
                // Directions do not depend on u: no specification has their encodings here.
                Encoding::Identity | Encoding::Grazing | Encoding::Slant => {
                    rows[0] = slopes(j, x, x.splat(1.0))
                }
                Encoding::Frequency(_) => {
                    let (mut turned, mut speed) = (first_turn(x), PI);
                    for [sin_row, cos_row] in rows.as_chunks_mut::<2>().0 {
                        let (sin, cos) = half_turns(turned);
                        *sin_row = slopes(j, sin, cos * x.splat(speed));
                        *cos_row = slopes(j, cos, sin * x.splat(-speed));
                        (turned, speed) = (next_turn(turned), 2.0 * speed);
                    }
                }
                Encoding::OneBlob(l) => {
                    for (i, out) in rows.iter_mut().enumerate() {
                        let (value, slope) = blob(x, i, l);
                        *out = slopes(j, value, slope);
                    }
                }
            }
        }
    }
}

/// A value that depends on coordinate `j` of u alone, with this slope.
#[inline(always)]
fn slopes<V: Vector>(j: usize, value: V, slope: V) -> [V; TANGENT_COLUMNS] {
    let zero = value.splat(0.0);
    match j {
        0 => [value, slope, zero],
        _ => [value, zero, slope],
    }
}

/// Half turns that a frequency encoding takes: beyond 2²² every f32 is a whole number of turns, or nearly.
const HALF_TURNS_MAX: f32 = (1u32 << 22) as f32;

/// x in half turns, less whole turns, as [`half_turns`] takes it.
#[inline(always)]
fn first_turn<V: Vector>(x: V) -> V {
    within_a_turn(x.clamp(-HALF_TURNS_MAX, HALF_TURNS_MAX))
}

/// 2x less whole turns for |x| ≤ 1, exactly.
#[inline(always)]
fn next_turn<V: Vector>(x: V) -> V {
    let turns = (x + x.splat(ROUND)) - x.splat(ROUND);
    let rest = x - turns;
    rest + rest
}

/// Value and derivative of Gaussian `i` of `l` at `x`.
#[inline(always)]
fn blob<V: Vector>(x: V, i: usize, l: usize) -> (V, V) {
    let t = x.mul_add_const(x.splat(l as f32), -0.5 - i as f32);
    let value = exp((t * t * x.splat(-0.5)).max(x.splat(-EXP_MAX)));
    (value, t * value * x.splat(-(l as f32)))
}

/// [`crate::encoding::grazing`].
#[inline(always)]
fn grazing<V: Vector>(w: [V; 3]) -> [V; GRAZING_FEATURES] {
    let [x, y, z] = w;
    let [_, _, root, log] = slant(w);
    [x, y, z, root, log, x.mul_add(x, -(y * y)), (x + x) * y]
}

/// [`crate::encoding::slant`].
#[inline(always)]
fn slant<V: Vector>(w: [V; 3]) -> [V; SLANT_FEATURES] {
    let [x, _, z] = w;
    let log = ln(z + z.splat(GRAZING_LOG_OFFSET as f32));
    [x, z, z.sqrt(), log.mul_add_const(z.splat(0.5), 1.0)]
}
