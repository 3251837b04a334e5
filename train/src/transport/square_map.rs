//! Maps of the unit square onto itself that keep its edges: the gradient of a potential, or marginal inversion in its
//! place; and the map of a picture, whose domain is the square itself.

use super::continuation;
use super::map::ImportanceMap;
use super::marginal::MarginalMap;
use super::points::to_disk;
use super::potential::Potential;
use super::raster::Raster;
use crate::spline::{Spline, crowd, edge_cell_centre, edge_cell_weight};

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
const EVEN_SHARE: f64 = 0.02;

/// Least and most mass, of 1, that the cells of the map must see in a picture: a dot between their centres is not seen at
/// all, and the map would be one of the black around it.
const SEEN: [f64; 2] = [0.5, 2.0];

impl PictureMap {
    /// Solves the map of `raster` on `cells`² cells (16·2^k); the marginal map stands in where that fails, or
    /// where the cells do not see the picture.
    pub fn new(raster: &Raster, cells: usize) -> PictureMap {
        let density: Vec<f64> = raster
            .mass
            .iter()
            .map(|m| (1.0 - EVEN_SHARE) * m * raster.mass.len() as f64 + EVEN_SHARE)
            .collect();
        let logs: Vec<f64> = density.iter().map(|q| q.ln()).collect();
        let spline = Spline::new(&logs, raster.side);
        let mut log_q: Vec<f64> = (0..cells * cells)
            .map(|k| spline.at(edge_cell_centre(k, cells)).0)
            .collect();
        let seen = super::smoothing::mass(&log_q, cells);
        log_q.iter_mut().for_each(|l| *l -= seen.ln());
        let fits = (SEEN[0]..=SEEN[1]).contains(&seen);
        match fits.then(|| continuation::solve(&log_q, cells, None)).flatten() {
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

impl ImportanceMap for PictureMap {
    fn at(&self, u: [f64; 2]) -> [f64; 2] {
        to_disk(self.square.at(u).0)
    }

    fn determinant(&self, u: [f64; 2]) -> f64 {
        self.square.at(u).1
    }
}
