//! The pixels of a slice: a grid on the orthographic disk of `wi`, and bilinear interpolation between them.
//!
//! Row i, column j is the cell with centre x = −1 + (2j+1)/W, y = −1 + (2i+1)/H. A cell is part of the table
//! when its centre lies inside the unit circle, which is decided in integers, so that every program decides alike.

use crate::real::Real;

/// Height and width of the pixel grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DiskGrid {
    /// Rows, along y; at least 1.
    pub height: usize,
    /// Columns, along x; at least 1.
    pub width: usize,
}

/// A cell outside the disk and its nearest neighbours inside; more than one where they are equally near.
pub(super) struct Outside {
    /// Index of the cell, row by row.
    pub cell: usize,
    /// Indices of the neighbours.
    pub nearest: Vec<usize>,
}

impl DiskGrid {
    /// Number of cells, those outside the disk included.
    pub fn cells(&self) -> usize {
        self.height * self.width
    }

    /// cos θ_i of the centre of row `i`, column `j`; `None` where it is not inside the disk.
    pub fn cos(&self, i: usize, j: usize) -> Option<Real> {
        let (h, w) = (self.height as i128, self.width as i128);
        let (x, y) = (2 * j as i128 + 1 - w, 2 * i as i128 + 1 - h);
        // (1 − x² − y²)·(H·W)² in the coordinates of the disk.
        let room = (h * w).pow(2) - (x * h).pow(2) - (y * w).pow(2);
        (room > 0).then(|| (room as Real).sqrt() / (h * w) as Real)
    }

    /// Every cell outside the disk, with the cells whose mean continues the table there.
    ///
    /// Neighbours are nearest on the disk, not in pixels. Equally near ones count alike, so that a symmetric slice
    /// stays symmetric.
    pub fn outside(&self) -> Vec<Outside> {
        // The cells of a row that lie inside are an interval, symmetric about its middle.
        let first: Vec<Option<usize>> = (0..self.height)
            .map(|i| (0..self.width).find(|&j| self.cos(i, j).is_some()))
            .collect();
        let is_outside = |i: usize, j: usize| first[i].is_none_or(|f| j < f || j >= self.width - f);
        (0..self.height)
            .flat_map(|i| (0..self.width).map(move |j| (i, j)))
            .filter(|&(i, j)| is_outside(i, j))
            .map(|(i, j)| Outside {
                cell: i * self.width + j,
                nearest: self.nearest(i, j, &first),
            })
            .collect()
    }

    /// The inside cells nearest to row `i`, column `j`; `first` holds the first inside column of every row.
    fn nearest(&self, i: usize, j: usize, first: &[Option<usize>]) -> Vec<usize> {
        let mut best = i128::MAX;
        let mut cells = Vec::new();
        for away in 0..self.height {
            // Squared distances on the disk in units of (2/(H·W))².
            let down = (away * self.width) as i128;
            if down.pow(2) > best {
                break;
            }
            let above = i.checked_sub(away);
            let below = Some(i + away).filter(|&row| away > 0 && row < self.height);
            for row in above.into_iter().chain(below) {
                let Some(first) = first[row] else { continue };
                let column = j.clamp(first, self.width - 1 - first);
                let across = (column.abs_diff(j) * self.height) as i128;
                let distance = down.pow(2) + across.pow(2);
                if distance < best {
                    best = distance;
                    cells.clear();
                }
                if distance == best {
                    cells.push(row * self.width + column);
                }
            }
        }
        cells
    }

    /// The four cells around the disk point (`x`, `y`) and their bilinear weights, which sum to 1.
    ///
    /// Beyond the outermost centres of the grid the value stays what it is there.
    #[inline]
    pub fn footprint(&self, x: Real, y: Real) -> [(usize, Real); 4] {
        let (left, right, across) = neighbours(x, self.width);
        let (lower, upper, up) = neighbours(y, self.height);
        let (lower, upper) = (lower * self.width, upper * self.width);
        [
            (lower + left, (1.0 - across) * (1.0 - up)),
            (lower + right, across * (1.0 - up)),
            (upper + left, (1.0 - across) * up),
            (upper + right, across * up),
        ]
    }
}

/// The cells of `count` on either side of `at` in [−1, 1], and how far it is from the first to the second.
#[inline]
fn neighbours(at: Real, count: usize) -> (usize, usize, Real) {
    let position = (0.5 * (at + 1.0) * count as Real - 0.5).clamp(0.0, (count - 1) as Real);
    let cell = position as usize;
    (cell, (cell + 1).min(count - 1), position - cell as Real)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Round-off of a handful of operations on numbers of size 1.
    const ROUND_OFF: Real = 1e-14;

    /// The oracle looks at every cell and measures on the disk.
    #[test]
    fn outside_cells_take_their_nearest_neighbours() {
        for (height, width) in [(1, 1), (1, 7), (2, 2), (5, 5), (8, 8), (13, 6), (2, 40), (31, 32)] {
            let grid = DiskGrid { height, width };
            let centre = |cell: usize| {
                let at = |k: usize, n: usize| -1.0 + (2 * k + 1) as Real / n as Real;
                [at(cell % width, width), at(cell / width, height)]
            };
            let inside = |cell: &usize| centre(*cell)[0].hypot(centre(*cell)[1]) < 1.0;
            let outside = grid.outside();
            assert_eq!(
                outside.len(),
                grid.cells() - (0..grid.cells()).filter(inside).count()
            );
            for Outside { cell, nearest } in outside {
                let distance = |other: &usize| {
                    let (a, b) = (centre(cell), centre(*other));
                    (a[0] - b[0]).hypot(a[1] - b[1])
                };
                assert!(!inside(&cell));
                let least = (0..grid.cells())
                    .filter(inside)
                    .map(|other| distance(&other))
                    .fold(Real::INFINITY, Real::min);
                let mut found = nearest;
                found.sort_unstable();
                let expected: Vec<usize> = (0..grid.cells())
                    .filter(inside)
                    .filter(|other| distance(other) <= least + ROUND_OFF)
                    .collect();
                assert_eq!(found, expected, "{height} × {width}, cell {cell}");
            }
        }
    }

    #[test]
    fn cosines_are_those_of_the_centres() {
        let grid = DiskGrid { height: 6, width: 9 };
        for i in 0..6 {
            for j in 0..9 {
                let (x, y) = ((2 * j + 1) as Real / 9.0 - 1.0, (2 * i + 1) as Real / 6.0 - 1.0);
                let squared = 1.0 - x * x - y * y;
                match grid.cos(i, j) {
                    Some(cos) => assert!((cos * cos - squared).abs() < ROUND_OFF),
                    None => assert!(squared <= 0.0),
                }
            }
        }
    }
}
