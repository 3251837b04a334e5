//! What the columns of a block of sums are, and what an activation does to a row of them.

use super::math::sigmoid;
use super::vector::{Several, Vector};

/// Columns of a block with tangents: the value and its derivatives along two inputs.
pub const TANGENT_COLUMNS: usize = 3;

/// What the columns of a block are: where the bias goes and what an activation does to them.
pub trait Columns<V: Vector, const N: usize> {
    /// Adds the bias to a row of sums.
    fn add_bias(sums: &mut [V; N], bias: V);

    /// `A` on `R` rows; those of tangents, which have one formula each, in step.
    fn finish<A: Activate, const R: usize>(rows: &mut [[V; N]; R]);

    /// `A` on all rows, as many in step as hide what each waits for.
    #[inline(always)]
    fn finish_all<A: Activate>(rows: &mut [[V; N]]) {
        let mut rest = rows;
        if N <= TANGENT_COLUMNS && V::REGISTERS >= 32 {
            let groups;
            (groups, rest) = rest.as_chunks_mut();
            for group in groups {
                Self::finish::<A, 8>(group);
            }
        }
        for row in rest.as_chunks_mut().0 {
            Self::finish::<A, 1>(row);
        }
    }
}

/// `N` independent queries per lane.
pub struct Values;

/// One query per lane: its value and two tangents.
pub struct Tangents;

impl<V: Vector, const N: usize> Columns<V, N> for Values {
    #[inline(always)]
    fn add_bias(sums: &mut [V; N], bias: V) {
        for sum in sums {
            *sum = *sum + bias;
        }
    }

    #[inline(always)]
    fn finish<A: Activate, const R: usize>(rows: &mut [[V; N]; R]) {
        for value in rows.as_flattened_mut() {
            *value = A::value(*value);
        }
    }
}

impl<V: Vector> Columns<V, TANGENT_COLUMNS> for Tangents {
    #[inline(always)]
    fn add_bias(sums: &mut [V; TANGENT_COLUMNS], bias: V) {
        sums[0] = sums[0] + bias;
    }

    #[inline(always)]
    fn finish<A: Activate, const R: usize>(rows: &mut [[V; TANGENT_COLUMNS]; R]) {
        let mut columns = [Several([rows[0][0]; R]); TANGENT_COLUMNS];
        for (r, row) in rows.iter().enumerate() {
            for (column, value) in columns.iter_mut().zip(row) {
                column.0[r] = *value;
            }
        }
        let columns = A::tangents(columns);
        for (r, row) in rows.iter_mut().enumerate() {
            for (value, column) in row.iter_mut().zip(&columns) {
                *value = column.0[r];
            }
        }
    }
}

/// A nonlinearity, or none.
pub trait Activate {
    /// Whether it takes an instruction or two.
    const IS_SHORT: bool;

    /// On a value.
    fn value<V: Vector>(x: V) -> V;

    /// On a value and its two tangents.
    fn tangents<V: Vector>(row: [V; TANGENT_COLUMNS]) -> [V; TANGENT_COLUMNS];
}

/// x·σ(x).
pub struct Silu;

/// max(x, 0).
pub struct Relu;

/// Nothing: last layers.
pub struct Linear;

impl Activate for Silu {
    const IS_SHORT: bool = false;

    #[inline(always)]
    fn value<V: Vector>(x: V) -> V {
        x * sigmoid(x)
    }

    #[inline(always)]
    fn tangents<V: Vector>([x, dx, dy]: [V; TANGENT_COLUMNS]) -> [V; TANGENT_COLUMNS] {
        let sigma = sigmoid(x);
        let value = x * sigma;
        // d(x·σ)/dx = σ + x·σ·(1 − σ).
        let slope = value.mul_add(x.splat(1.0) - sigma, sigma);
        [value, slope * dx, slope * dy]
    }
}

impl Activate for Relu {
    const IS_SHORT: bool = true;

    #[inline(always)]
    fn value<V: Vector>(x: V) -> V {
        x.max(x.splat(0.0))
    }

    #[inline(always)]
    fn tangents<V: Vector>(mut row: [V; TANGENT_COLUMNS]) -> [V; TANGENT_COLUMNS] {
        let zero = row[0].splat(0.0);
        let on = zero.less(row[0]);
        for v in &mut row {
            *v = V::select(on, *v, zero);
        }
        row
    }
}

impl Activate for Linear {
    const IS_SHORT: bool = true;

    #[inline(always)]
    fn value<V: Vector>(x: V) -> V {
        x
    }

    #[inline(always)]
    fn tangents<V: Vector>(row: [V; TANGENT_COLUMNS]) -> [V; TANGENT_COLUMNS] {
        row
    }
}
