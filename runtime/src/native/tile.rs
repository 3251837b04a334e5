//! Reading queries into vectors and writing results: tails, validity and symmetry.

use super::vector::{Simd, Vector};
use crate::backend::Points;
use crate::spec::Symmetry;

/// The vectors of one tile, one per column.
pub type Column<V, const N: usize> = [V; N];

/// Which queries of a batch a tile holds.
#[derive(Clone, Copy)]
pub struct Tile<'a> {
    /// The batch.
    pub points: Points<'a>,
    /// The tile's first query.
    pub start: usize,
    /// Queries of the tile that count.
    pub live: usize,
}

/// Queries that one tile of `N` vectors holds.
pub const fn queries<V: Vector, const N: usize>() -> usize {
    N * V::LANES
}

/// `source` from element `start` on, one tile of it; 0 beyond the end.
#[inline(always)]
pub fn read<S: Simd, const N: usize>(simd: S, source: &[f32], start: usize) -> Column<S::Vector, N> {
    let mut column = [simd.splat(0.0); N];
    for (q, vector) in column.iter_mut().enumerate() {
        let at = start + q * S::Vector::LANES;
        *vector = simd.load(&source[at.min(source.len())..]);
    }
    column
}

/// Writes `value` to `out` at the queries of vector `q` of the tile that begins at `start`.
#[inline(always)]
pub fn write<V: Vector>(value: V, out: &mut [f32], start: usize, q: usize) {
    let at = (start + q * V::LANES).min(out.len());
    let end = (at + V::LANES).min(out.len());
    value.store(&mut out[at..end]);
}

/// The free parameter `values` of a tile: a column of the batch, or one value for all of it.
#[inline(always)]
pub fn read_parameter<S: Simd, const N: usize>(
    simd: S,
    values: &[f32],
    start: usize,
) -> Column<S::Vector, N> {
    match values {
        [value] => [simd.splat(*value); N],
        _ => read(simd, values, start),
    }
}

/// Finite where `w` is a direction above the horizon with finite components, else +∞ or NaN.
#[inline(always)]
fn validity<V: Vector>(w: [V; 3]) -> V {
    let size = w[0].abs() + w[1].abs() + w[2];
    let infinity = size.splat(f32::INFINITY);
    V::select(size.splat(0.0).less(w[2]), size, infinity)
}

/// Where `validity` is finite.
#[inline(always)]
pub fn is_finite<V: Vector>(validity: V) -> V::Mask {
    validity.less(validity.splat(f32::INFINITY))
}

/// `value` where it and `validity` are finite, else 0.
#[inline(always)]
pub fn finite_or_zero<V: Vector>(value: V, validity: V) -> V {
    V::select(is_finite(validity + value.abs()), value, value.splat(0.0))
}

/// The cameras of one tile.
pub struct Cameras<V, const N: usize> {
    /// Directions, folded; (0, 0, 1) in queries that are not valid.
    pub wo: [Column<V, N>; 3],
    /// Finite in valid queries.
    pub validity: Column<V, N>,
    symmetry: Symmetry,
    /// What undoes the folding: the signs of x and y, or cosine and sine of the turn.
    turn: [Column<V, N>; 2],
}

/// Directions are multiplied by this before they are squared, so that those within 1e-37 of the normal still have an
/// azimuth; 2¹²⁰ is a number.
const SQUARED_SCALE: f32 = (1u64 << 60) as f32;

impl<V: Vector, const N: usize> Cameras<V, N> {
    /// No cameras yet; see [`Cameras::read`].
    pub fn none(zero: V) -> Self {
        Cameras {
            wo: [[zero; N]; 3],
            validity: [zero; N],
            symmetry: Symmetry::Quadrant,
            turn: [[zero; N]; 2],
        }
    }

    /// Reads a tile and folds it by `symmetry`.
    #[inline(always)]
    pub fn read<S: Simd<Vector = V>>(&mut self, simd: S, symmetry: Symmetry, points: &Points, start: usize) {
        let (zero, one) = (simd.splat(0.0), simd.splat(1.0));
        self.wo = read_directions(simd, points.wo, start);
        self.symmetry = symmetry;
        let Cameras {
            wo: [x, y, z],
            turn: [turn_x, turn_y],
            validity: valid,
            ..
        } = self;
        for q in 0..N {
            valid[q] = validity([x[q], y[q], z[q]]);
            let ok = is_finite(valid[q]);
            z[q] = V::select(ok, z[q], one);
            let (wx, wy) = (V::select(ok, x[q], zero), V::select(ok, y[q], zero));
            match symmetry {
                Symmetry::Quadrant => {
                    turn_x[q] = V::select(wx.less(zero), -one, one);
                    turn_y[q] = V::select(wy.less(zero), -one, one);
                    (x[q], y[q]) = (wx.abs(), wy.abs());
                }
                Symmetry::Rotation => {
                    let scale = zero.splat(SQUARED_SCALE);
                    let (sx, sy) = (wx * scale, wy * scale);
                    let length = sx.mul_add(sx, sy * sy).sqrt();
                    let slanted = zero.less(length);
                    turn_x[q] = V::select(slanted, sx / length, one);
                    turn_y[q] = V::select(slanted, sy / length, zero);
                    (x[q], y[q]) = (length * zero.splat(1.0 / SQUARED_SCALE), zero);
                }
            }
        }
        for values in points.params {
            let column: Column<V, N> = read_parameter(simd, values, start);
            for (valid, value) in valid.iter_mut().zip(column) {
                *valid = *valid + value.abs();
            }
        }
    }

    /// `wo` of vector `q`.
    #[inline(always)]
    pub fn wo(&self, q: usize) -> [V; 3] {
        [self.wo[0][q], self.wo[1][q], self.wo[2][q]]
    }

    /// `w` of vector `q`, folded as the camera was.
    #[inline(always)]
    pub fn fold(&self, w: [V; 3], q: usize) -> [V; 3] {
        let ([x, y, z], [a, b]) = (w, [self.turn[0][q], self.turn[1][q]]);
        match self.symmetry {
            Symmetry::Quadrant => [a * x, b * y, z],
            Symmetry::Rotation => [a.mul_add(x, b * y), a.mul_add(y, -(b * x)), z],
        }
    }

    /// The direction of vector `q` whose fold is `w`.
    #[inline(always)]
    pub fn unfold(&self, w: [V; 3], q: usize) -> [V; 3] {
        let ([x, y, z], [a, b]) = (w, [self.turn[0][q], self.turn[1][q]]);
        match self.symmetry {
            Symmetry::Quadrant => [a * x, b * y, z],
            Symmetry::Rotation => [a.mul_add(x, -(b * y)), a.mul_add(y, b * x), z],
        }
    }

    /// Folds a tile of lights as the cameras were; queries where one is not valid become (0, 0, 1) and lose their
    /// validity.
    #[inline(always)]
    pub fn fold_lights(&mut self, lights: &mut [Column<V, N>; 3]) {
        let [x, y, z] = lights;
        for q in 0..N {
            let valid = validity([x[q], y[q], z[q]]);
            let (ok, zero) = (is_finite(valid), valid.splat(0.0));
            self.validity[q] = self.validity[q] + valid;
            let w = [
                V::select(ok, x[q], zero),
                V::select(ok, y[q], zero),
                V::select(ok, z[q], zero.splat(1.0)),
            ];
            [x[q], y[q], z[q]] = self.fold(w, q);
        }
    }
}

/// Reads a tile of directions.
#[inline(always)]
pub fn read_directions<S: Simd, const N: usize>(
    simd: S,
    [x, y, z]: [&[f32]; 3],
    start: usize,
) -> [Column<S::Vector, N>; 3] {
    [read(simd, x, start), read(simd, y, start), read(simd, z, start)]
}
