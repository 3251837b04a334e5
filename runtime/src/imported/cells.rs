//! Sampling of slices: a density that is constant on the cells of the concentric square, for one tabulated slice,
//! and the mixture of several.
//!
//! The concentric map has constant Jacobian π from the square to the disk, and dω·cos θ = dx dy, so a density p of
//! the square is the density p·cos θ_i/π of `wi` (sr⁻¹), and f_cos over it is π·f/p: no cosine is ever divided by.
//! The mixture is inverted as a whole: cumulative sums of the parts, weighed, are those of the mixture. So one
//! monotone pair of functions carries `u` to the square, and stratified points stay stratified.

use crate::concentric::square_to_hemisphere;
use crate::real::Real;

/// Share of the density that is uniform on the disk, whatever the slice.
///
/// It keeps the density positive where the slice is, but no point of a cell saw it, and the weight below
/// π·f/`UNIFORM_SHARE`; one percent costs one percent of variance at most.
const UNIFORM_SHARE: Real = 0.01;

/// Sums over the cells of the square of one slice; a part of a [`Mixture`].
#[derive(Debug)]
pub(super) struct CellTable {
    /// Mean brightness over the disk, sr⁻¹; zero for a black slice.
    brightness: Real,
    /// Sums of the masses of all rows up to and including this one; the last is 1 but for round-off.
    rows: Vec<Real>,
    /// The same within each row, row by row, in units of the whole table's mass.
    cells: Vec<f32>,
}

impl CellTable {
    /// Tabulates `brightness(x, y)`, a non-negative function of the disk, on `side` × `side` cells of the square.
    ///
    /// A cell's mass is the mean at its corners, the middles of its edges and its centre. Within a cell a slice is
    /// nearly bilinear, so largest at a corner, and nowhere more than nine times this mean: weights stay small
    /// even where cells are as coarse as pixels.
    pub fn new(side: usize, brightness: impl Fn(Real, Real) -> Real) -> CellTable {
        let nodes = 2 * side + 1;
        let at = |k: usize| k as Real / (nodes - 1) as Real;
        let mut values = Vec::with_capacity(nodes * nodes);
        for row in 0..nodes {
            for column in 0..nodes {
                let complement = [at(nodes - 1 - column), at(nodes - 1 - row)];
                let [x, y, _] = square_to_hemisphere([at(column), at(row)], complement);
                values.push(brightness(x, y));
            }
        }
        let mass = |cell: usize| -> Real {
            let first = 2 * (cell / side) * nodes + 2 * (cell % side);
            let rows = [first, first + nodes, first + 2 * nodes];
            rows.iter().flat_map(|&row| &values[row..row + 3]).sum::<Real>() / 9.0
        };
        let masses: Vec<Real> = (0..side * side).map(mass).collect();
        let total: Real = masses.iter().sum();
        let mut table = CellTable {
            brightness: total / (side * side) as Real,
            rows: Vec::with_capacity(side),
            cells: Vec::with_capacity(side * side),
        };
        // A black table has sums of zero, and no part in any mixture.
        let share = |mass: Real| if total > 0.0 { mass / total } else { 0.0 };
        let mut above = 0.0;
        for row in masses.chunks_exact(side) {
            let mut sum = 0.0;
            for &mass in row {
                sum += share(mass);
                table.cells.push(sum as f32);
            }
            above += sum;
            table.rows.push(above);
        }
        table
    }
}

/// A density on the square: a weighed sum of tables and [`UNIFORM_SHARE`].
pub(super) struct Mixture<'a> {
    side: usize,
    parts: [(&'a CellTable, Real); 4],
    /// Mass that is spread evenly over all cells.
    uniform: Real,
}

impl<'a> Mixture<'a> {
    /// The mixture whose density is proportional to Σ weight · slice, as the tables, all of `side`, have them.
    ///
    /// Uniform where all of them are black.
    pub fn new(side: usize, tables: [(&'a CellTable, Real); 4]) -> Mixture<'a> {
        let total: Real = tables.iter().map(|(table, w)| w * table.brightness).sum();
        let uniform = if total > 0.0 { UNIFORM_SHARE } else { 1.0 };
        let share = |brightness: Real| match total > 0.0 {
            true => (1.0 - UNIFORM_SHARE) * brightness / total,
            false => 0.0,
        };
        Mixture {
            side,
            parts: tables.map(|(table, w)| (table, share(w * table.brightness))),
            uniform,
        }
    }

    /// A weighed sum over the parts.
    #[inline]
    fn sum(&self, value: impl Fn(&CellTable) -> Real) -> Real {
        self.parts.iter().map(|(table, share)| share * value(table)).sum()
    }

    /// Mass of all rows up to and including `row`.
    #[inline]
    fn rows(&self, row: usize) -> Real {
        let even = self.uniform * (row + 1) as Real / self.side as Real;
        self.sum(|table| table.rows[row]) + even
    }

    /// Mass of the cells of `row` up to and including `column`.
    #[inline]
    fn cells(&self, row: usize, column: usize) -> Real {
        let even = self.uniform * (column + 1) as Real / (self.side * self.side) as Real;
        self.sum(|table| Real::from(table.cells[row * self.side + column])) + even
    }

    /// Position in the square for `u` in `[0,1)²`, and 1 minus it: its density is [`Mixture::density`].
    pub fn invert(&self, u: [Real; 2]) -> [[Real; 2]; 2] {
        let (row, t) = invert(u[1], self.side, |row| self.rows(row));
        let (column, s) = invert(u[0], self.side, |column| self.cells(row, column));
        let at = |cell: usize, t: Real| (cell as Real + t) / self.side as Real;
        [
            [at(column, s), at(row, t)],
            [
                at(self.side - 1 - column, 1.0 - s),
                at(self.side - 1 - row, 1.0 - t),
            ],
        ]
    }

    /// Density at `s` in `[0,1]²` per unit area of the square; positive, and its integral is 1.
    pub fn density(&self, s: [Real; 2]) -> Real {
        let last = self.side - 1;
        let [column, row] = s.map(|v| ((v * self.side as Real) as usize).min(last));
        // Differences are taken part by part, so that the uniform mass of a cell cannot round to nothing.
        let row_mass = self.sum(|table| match row {
            0 => table.rows[0],
            _ => table.rows[row] - table.rows[row - 1],
        });
        let cell_mass = self.sum(|table| {
            let at = row * self.side + column;
            Real::from(match column {
                0 => table.cells[at],
                _ => table.cells[at] - table.cells[at - 1],
            })
        });
        let side = self.side as Real;
        let rows = (row_mass * side + self.uniform) / self.rows(last);
        // The row's own sum divides, as it does in the inversion, whatever it rounded to.
        rows * (cell_mass * side + self.uniform / side) / self.cells(row, last)
    }
}

/// The cell of `count` where the cumulative sums first exceed the share `u` in `[0,1)` of the last of them, and how
/// far into it that is, in [0, 1].
fn invert(u: Real, count: usize, sums: impl Fn(usize) -> Real) -> (usize, Real) {
    // A NaN counts as 0.
    let target = u.max(0.0) * sums(count - 1);
    let (mut first, mut last) = (0, count - 1);
    while first < last {
        let middle = first.midpoint(last);
        match sums(middle) > target {
            true => last = middle,
            false => first = middle + 1,
        }
    }
    let below = if first == 0 { 0.0 } else { sums(first - 1) };
    // Every cell has its uniform share, so sums rise at each.
    let within = (target - below) / (sums(first) - below);
    (first, within.clamp(0.0, 1.0))
}
