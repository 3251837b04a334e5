//! The marginal map: invert the marginal of the second coordinate, then the conditional of the first.
//! It exists for every density, so it stands in where Newton's method fails; it also carries edges to edges.

use super::map::MapImage;
use super::points::to_disk;
use super::raster::Raster;

/// The marginal map onto cell masses.
#[derive(Clone, Debug)]
pub struct MarginalMap {
    cells: usize,
    /// Cumulated masses within each row, `cells + 1` per row.
    rows: Vec<Vec<f64>>,
    /// Cumulated row masses.
    marginal: Vec<f64>,
}

/// Running sums, from 0; empty cells get the smallest mass, so that every sum can be inverted.
fn cumulate(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sums = vec![0.0];
    for v in values {
        sums.push(sums[sums.len() - 1] + v.max(f64::MIN_POSITIVE));
    }
    sums
}

impl MarginalMap {
    /// The map onto `mass` (`cells`², row-major, first coordinate along rows).
    pub fn new(mass: &[f64], cells: usize) -> MarginalMap {
        let rows: Vec<Vec<f64>> = mass
            .chunks_exact(cells)
            .map(|row| cumulate(row.iter().copied()))
            .collect();
        let marginal = cumulate(rows.iter().map(|r| r[cells]));
        MarginalMap {
            cells,
            rows,
            marginal,
        }
    }

    /// Image of `u` in the unit square.
    pub fn at(&self, u: [f64; 2]) -> [f64; 2] {
        self.with_determinant(u).0
    }

    /// Image of `u` in the unit square, and the determinant of the derivative there, > 0.
    pub fn with_determinant(&self, u: [f64; 2]) -> ([f64; 2], f64) {
        let cells = self.cells as f64;
        let invert = |sums: &[f64], u: f64| {
            let target = u * sums[self.cells];
            let cell = sums.partition_point(|s| *s <= target).clamp(1, self.cells) - 1;
            let mass = sums[cell + 1] - sums[cell];
            let t = ((target - sums[cell]) / mass).clamp(0.0, 1.0);
            (cell, (cell as f64 + t) / cells, sums[self.cells] / (mass * cells))
        };
        let (row, y, slope_y) = invert(&self.marginal, u[1]);
        let (_, x, slope_x) = invert(&self.rows[row], u[0]);
        ([x, y], slope_x * slope_y)
    }
}

/// Image of the marginal map onto `raster` at the centres of `side`² cells.
pub fn solve(raster: &Raster, side: usize) -> MapImage {
    let map = MarginalMap::new(&raster.mass, raster.side);
    MapImage::of(side, |u| to_disk(map.at(u)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spline::cell_centre;

    /// The density is piecewise constant on 64 cells, the closed form continuous.
    const CELL_TOL: f64 = 1e-3;

    #[test]
    fn separable_density_is_inverted() {
        let mass: Vec<f64> = (0..64 * 64).map(|k| 1.0 + cell_centre(k, 64)[0]).collect();
        let map = MarginalMap::new(&mass, 64);
        for u in (0..256).map(|k| cell_centre(k, 16)) {
            let image = map.at(u);
            assert!((image[0] - ((1.0 + 3.0 * u[0]).sqrt() - 1.0)).abs() < CELL_TOL);
            assert!((image[1] - u[1]).abs() < CELL_TOL);
        }
    }
}
