//! Maps of the unit square onto itself that keep its edges: the gradient of a potential, or marginal inversion in its
//! place; and the map of a picture, whose domain is the square itself.

use super::continuation;
use super::map::ImportanceMap;
use super::marginal::MarginalMap;
use super::points::to_disk;
use super::potential::Potential;
use super::raster::Raster;
use crate::spline::{crowd, edge_cell_weight};

/// A map of the unit square onto itself.
#[derive(Clone, Debug)]
pub enum SquareMap {
    /// The gradient of a potential.
    Potential(Potential),
    /// The marginal map in crowded coordinates.
    Marginal(MarginalMap),
}

impl SquareMap {
    /// The marginal map onto exp(`log_q`), one value per crowded cell.
    pub fn marginal(log_q: &[f64], cells: usize) -> SquareMap {
        let mass: Vec<f64> = log_q
            .iter()
            .enumerate()
            .map(|(k, l)| l.exp() * edge_cell_weight(k, cells))
            .collect();
        SquareMap::Marginal(MarginalMap::new(&mass, cells))
    }

    /// Image of `u` in the square, and the determinant of the map's derivative there.
    pub fn at(&self, u: [f64; 2]) -> ([f64; 2], f64) {
        match self {
            SquareMap::Potential(potential) => {
                let local = potential.at(u);
                // Round-off of f32 coefficients may leave the square by a hair.
                (local.image.map(|v| v.clamp(0.0, 1.0)), local.determinant())
            }
            SquareMap::Marginal(map) => {
                let (t, determinant) = map.with_determinant(u);
                // Derivative of the smoothstep that crowds the cells.
                let slope = |t: f64| 6.0 * t * (1.0 - t);
                (t.map(crowd), determinant * slope(t[0]) * slope(t[1]))
            }
        }
    }
}

/// The map of a picture onto [−1, 1]².
#[derive(Clone, Debug)]
pub struct PictureMap {
    square: SquareMap,
    /// Mass that the picture had to be softened by, uniform share included.
    pub softened: f64,
}

/// Share of an even density mixed into a picture, whose black parts have none.
const EVEN_SHARE: f64 = 0.005;

impl PictureMap {
    /// Solves the map of `raster` on `cells`² cells (16·2^k); the marginal map stands in where that fails.
    pub fn new(raster: &Raster, cells: usize) -> PictureMap {
        let density: Vec<f64> = raster
            .mass
            .iter()
            .map(|m| (1.0 - EVEN_SHARE) * m * raster.mass.len() as f64 + EVEN_SHARE)
            .collect();
        let sums = Sums::new(&density, raster.side);
        let mut log_q: Vec<f64> = (0..cells * cells)
            .map(|k| {
                let side = |i: usize| [i, i + 1].map(|i| crowd(i as f64 / cells as f64));
                sums.mean(side(k % cells), side(k / cells)).ln()
            })
            .collect();
        let scale = super::smoothing::mass(&log_q, cells).ln();
        log_q.iter_mut().for_each(|l| *l -= scale);
        match continuation::solve(&log_q, cells, None) {
            Some(solved) => PictureMap {
                square: SquareMap::Potential(Potential::new(cells, &solved.transport.potential)),
                softened: solved.softened + EVEN_SHARE,
            },
            None => PictureMap {
                square: SquareMap::marginal(&log_q, cells),
                softened: EVEN_SHARE,
            },
        }
    }

    /// Whether the marginal map stands in.
    pub fn is_fallback(&self) -> bool {
        matches!(self.square, SquareMap::Marginal(_))
    }
}

/// Sums of a raster's values below and left of every point of the unit square.
struct Sums {
    side: usize,
    /// At the corners of pixels, `(side + 1)`².
    corners: Vec<f64>,
}

impl Sums {
    fn new(values: &[f64], side: usize) -> Sums {
        let wide = side + 1;
        let mut corners = vec![0.0; wide * wide];
        for j in 0..side {
            let mut row = 0.0;
            for i in 0..side {
                row += values[j * side + i];
                corners[(j + 1) * wide + i + 1] = corners[j * wide + i + 1] + row;
            }
        }
        Sums { side, corners }
    }

    /// The sum up to `(x, y)`: bilinear between corners, as values are constant in pixels.
    fn at(&self, x: f64, y: f64) -> f64 {
        let locate = |v: f64| {
            let v = v * self.side as f64;
            let i = (v as usize).min(self.side - 1);
            (i, v - i as f64)
        };
        let ((i, s), (j, t)) = (locate(x), locate(y));
        let corner = |i: usize, j: usize| self.corners[j * (self.side + 1) + i];
        (1.0 - t) * ((1.0 - s) * corner(i, j) + s * corner(i + 1, j))
            + t * ((1.0 - s) * corner(i, j + 1) + s * corner(i + 1, j + 1))
    }

    /// Mean value over a rectangle of the unit square.
    fn mean(&self, [left, right]: [f64; 2], [bottom, top]: [f64; 2]) -> f64 {
        let sum = self.at(right, top) - self.at(left, top) - self.at(right, bottom) + self.at(left, bottom);
        let pixels = (right - left) * (top - bottom) * (self.side * self.side) as f64;
        // Round-off of differences may leave nothing of a black cell.
        (sum / pixels).max(EVEN_SHARE)
    }
}

impl ImportanceMap for PictureMap {
    fn at(&self, u: [f64; 2]) -> [f64; 2] {
        to_disk(self.square.at(u).0)
    }

    fn determinant(&self, u: [f64; 2]) -> f64 {
        self.square.at(u).1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::card::bins::l1;
    use crate::transport::densities::blobs;
    use crate::transport::measure;

    /// Round-off of sums of a few thousand values.
    const ROUND_OFF: f64 = 1e-9;
    /// Binning L1 of a smooth picture on 64² cells: the cells' own resolution, and the even share.
    const PICTURE_L1: f64 = 0.03;

    #[test]
    fn sums_are_means_of_pixels() {
        let values: Vec<f64> = (0..16).map(|k| 1.0 + k as f64).collect();
        let sums = Sums::new(&values, 4);
        assert!((sums.mean([0.25, 0.5], [0.5, 0.75]) - 10.0).abs() < ROUND_OFF);
        assert!((sums.mean([0.0, 1.0], [0.0, 1.0]) - 8.5).abs() < ROUND_OFF);
        assert!((sums.mean([0.125, 0.375], [0.0, 0.25]) - 1.5).abs() < ROUND_OFF);
    }

    #[test]
    fn a_picture_is_drawn_as_it_is_and_nothing_falls_outside() {
        let raster = blobs(128);
        let map = PictureMap::new(&raster, 64);
        assert!(!map.is_fallback());
        let counts = measure::histogram(&map, measure::BINNING_POINTS);
        let found = l1(&counts, &measure::reference_bins(&raster));
        assert!(found < PICTURE_L1, "{found}");
        assert_eq!(measure::outside(&map, measure::Domain::Square, 1 << 16), 0.0);
        assert_eq!(measure::fold_fraction(&map, 64), 0.0);
    }
}
