//! Reading queries into vectors and writing results: tails, validity and symmetry.

use super::vector::{Simd, Vector};
use crate::spec::Symmetry;

/// The vectors of one tile, one per column.
pub type Column<V, const N: usize> = [V; N];

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

/// Finite where `w` is a direction above the horizon with finite components, else +∞ or NaN.
#[inline(always)]
fn validity<V: Vector>(w: [V; 3]) -> V {
    let size = w[0].abs() + w[1].abs() + w[2];
    let infinity = size.splat(f32::INFINITY);
    V::select(size.splat(0.0).less(w[2]), size, infinity)
}

/// The cameras of one tile.
pub struct Cameras<V, const N: usize> {
    /// Directions, folded; (0, 0, 1) in queries that are not valid.
    pub wo: [Column<V, N>; 3],
    /// Factors that unfold `wi`.
    pub signs: [Column<V, N>; 2],
    /// Finite in valid queries.
    pub validity: Column<V, N>,
}

impl<V: Vector, const N: usize> Cameras<V, N> {
    /// Reads a tile and folds it by `symmetry`.
    #[inline(always)]
    pub fn read<S: Simd<Vector = V>>(simd: S, symmetry: Symmetry, wo: [&[f32]; 3], start: usize) -> Self {
        let (zero, one) = (simd.splat(0.0), simd.splat(1.0));
        let Symmetry::Quadrant = symmetry;
        let mut cameras = Cameras {
            wo: [
                read(simd, wo[0], start),
                read(simd, wo[1], start),
                read(simd, wo[2], start),
            ],
            signs: [[one; N]; 2],
            validity: [zero; N],
        };
        let Cameras {
            wo: [x, y, z],
            signs: [sign_x, sign_y],
            validity: valid,
        } = &mut cameras;
        for q in 0..N {
            valid[q] = validity([x[q], y[q], z[q]]);
            let ok = valid[q].less(simd.splat(f32::INFINITY));
            sign_x[q] = V::select(x[q].less(zero), -one, one);
            sign_y[q] = V::select(y[q].less(zero), -one, one);
            x[q] = V::select(ok, x[q].abs(), zero);
            y[q] = V::select(ok, y[q].abs(), zero);
            z[q] = V::select(ok, z[q], one);
        }
        cameras
    }

    /// `wo` of vector `q`.
    #[inline(always)]
    pub fn wo(&self, q: usize) -> [V; 3] {
        [self.wo[0][q], self.wo[1][q], self.wo[2][q]]
    }

    /// Reads a tile of lights into `wi`, folded as the cameras were; queries where one is not valid become
    /// (0, 0, 1) and lose their validity.
    #[inline(always)]
    pub fn read_lights<S: Simd<Vector = V>>(
        &mut self,
        simd: S,
        wi: [&[f32]; 3],
        start: usize,
    ) -> [Column<V, N>; 3] {
        let (zero, one) = (simd.splat(0.0), simd.splat(1.0));
        let mut lights = [
            read(simd, wi[0], start),
            read(simd, wi[1], start),
            read(simd, wi[2], start),
        ];
        let [x, y, z] = &mut lights;
        for q in 0..N {
            let valid = validity([x[q], y[q], z[q]]);
            let ok = valid.less(simd.splat(f32::INFINITY));
            self.validity[q] = self.validity[q] + valid;
            x[q] = V::select(ok, self.signs[0][q] * x[q], zero);
            y[q] = V::select(ok, self.signs[1][q] * y[q], zero);
            z[q] = V::select(ok, z[q], one);
        }
        lights
    }
}

/// `value` where it and `validity` are finite, else 0.
#[inline(always)]
pub fn finite_or_zero<V: Vector>(value: V, validity: V) -> V {
    let infinity = value.splat(f32::INFINITY);
    V::select((validity + value.abs()).less(infinity), value, value.splat(0.0))
}
