//! Maps of the unit square onto itself that keep its edges: the gradient of a potential, or marginal inversion in its
//! place; and the map of a picture, whose domain is the square itself.

use super::continuation;
use super::map::ImportanceMap;
use super::marginal::MarginalMap;
use super::points::to_disk;
use super::potential::Potential;
use super::raster::{Raster, Sums};
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
                // Round-off of differences may leave nothing of a black cell.
                let mean = sums.mean(side(k % cells), side(k / cells));
                mean.max(EVEN_SHARE).ln()
            })
            .collect();
        let scale = super::smoothing::mass(&log_q, cells).ln();
        log_q.iter_mut().for_each(|l| *l -= scale);
        let square = match continuation::solve(&log_q, cells, None) {
            Some(solved) => SquareMap::Potential(Potential::new(cells, &solved.transport.potential)),
            None => SquareMap::marginal(&log_q, cells),
        };
        PictureMap { square }
    }

    /// Whether the marginal map stands in.
    pub fn is_fallback(&self) -> bool {
        matches!(self.square, SquareMap::Marginal(_))
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

    /// Binning L1 of a smooth picture on 64² cells: the cells' own resolution, and the even share.
    const PICTURE_L1: f64 = 0.03;

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
