//! Importance maps: what every solver gives, whatever it is made of, and the image that the paper stores.
//!
//! Source: the paper, §4.1 and the binning of Fig. 6, which interpolates between the cells of the image.

use crate::spline::cell_centre;

/// A map from uniform numbers to positions on [−1, 1]², the orthographic disk of directions for a slice and the whole
/// square for a picture.
pub trait ImportanceMap: Sync {
    /// Position of `u` in `[0,1)²`.
    fn at(&self, u: [f64; 2]) -> [f64; 2];

    /// Determinant of the derivative at `u` in the map's own square, > 0 where the map keeps its orientation.
    fn determinant(&self, u: [f64; 2]) -> f64;

    /// Values of u₀ inside (0, 1) at which one chart ends and the next begins; the map jumps there.
    fn breaks(&self) -> Vec<f64> {
        Vec::new()
    }
}

/// The map as the paper stores it: positions of the cell centres of the unit square, bilinear between them.
#[derive(Clone, Debug, PartialEq)]
pub struct MapImage {
    /// Cells per side.
    pub side: usize,
    /// Positions on [−1, 1]², `side`², u₀ fastest.
    pub points: Vec<[f64; 2]>,
}

impl MapImage {
    /// The image of `map` at the centres of `side`² cells.
    pub fn of(side: usize, map: impl FnMut([f64; 2]) -> [f64; 2]) -> MapImage {
        let points = (0..side * side).map(|k| cell_centre(k, side)).map(map).collect();
        MapImage { side, points }
    }

    /// The four cells around `u`, u₀ fastest, and the place of `u` between them, outside [0, 1] in the outer half
    /// cells. An image of one cell is constant.
    fn patch(&self, u: [f64; 2]) -> ([[f64; 2]; 4], [f64; 2]) {
        let last = self.side.saturating_sub(2);
        let step = usize::from(self.side > 1);
        let [i, j] = u.map(|u| ((u * self.side as f64 - 0.5).max(0.0) as usize).min(last));
        let corner = |a: usize, b: usize| self.points[(j + b * step) * self.side + i + a * step];
        let place = |u: f64, i: usize| u * self.side as f64 - 0.5 - i as f64;
        (
            [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)],
            [place(u[0], i), place(u[1], j)],
        )
    }
}

/// Bilinear between cell centres, linear beyond them: in the outer half cells a position may leave the disk or the
/// square, which the measures count.
impl ImportanceMap for MapImage {
    fn at(&self, u: [f64; 2]) -> [f64; 2] {
        let ([a, b, c, d], [s, t]) = self.patch(u);
        [0, 1].map(|k| (1.0 - t) * ((1.0 - s) * a[k] + s * b[k]) + t * ((1.0 - s) * c[k] + s * d[k]))
    }

    /// Of the bilinear patch around `u`, positions and `u` both on [−1, 1]²: 1 for the identity.
    fn determinant(&self, u: [f64; 2]) -> f64 {
        let ([a, b, c, d], [s, t]) = self.patch(u);
        let scale = 0.5 * self.side as f64;
        let along0 = [0, 1].map(|k| scale * ((1.0 - t) * (b[k] - a[k]) + t * (d[k] - c[k])));
        let along1 = [0, 1].map(|k| scale * ((1.0 - s) * (c[k] - a[k]) + s * (d[k] - b[k])));
        along0[0] * along1[1] - along0[1] * along1[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::Rng;

    /// Round-off of a few sums and products of numbers near 1.
    const ROUND_OFF: f64 = 1e-13;
    /// Central differences inside a patch, where the map is quadratic: round-off over the step.
    const STEP: f64 = 1e-5;
    const DIFFERENCE_TOL: f64 = 1e-9;

    fn close(a: [f64; 2], b: [f64; 2]) -> bool {
        (a[0] - b[0]).abs() < ROUND_OFF && (a[1] - b[1]).abs() < ROUND_OFF
    }

    #[test]
    fn an_affine_map_is_its_own_image_up_to_the_borders() {
        let affine = |u: [f64; 2]| [0.2 + 0.9 * u[0] - 0.3 * u[1], -0.7 + 0.4 * u[0] + 1.2 * u[1]];
        let image = MapImage::of(5, affine);
        for u in [[0.0, 0.0], [0.999, 0.001], [0.5, 0.5], [0.31, 0.87], [0.05, 0.95]] {
            assert!(close(image.at(u), affine(u)), "{u:?}");
            assert!((image.determinant(u) - 0.25 * (0.9 * 1.2 + 0.3 * 0.4)).abs() < ROUND_OFF);
        }
        let mirrored = MapImage::of(4, |u| [1.0 - 2.0 * u[0], 2.0 * u[1] - 1.0]);
        assert!((mirrored.determinant([0.3, 0.6]) + 1.0).abs() < ROUND_OFF);
    }

    #[test]
    fn cell_centres_are_hit_and_the_determinant_is_that_of_differences() {
        let mut rng = Rng::new(&[11]);
        let image = MapImage::of(6, |_| [rng.uniform(), rng.uniform()]);
        for k in 0..36 {
            assert!(close(image.at(cell_centre(k, 6)), image.points[k]));
        }
        let difference = |u: [f64; 2], axis: usize| {
            let at = |sign: f64| image.at([0, 1].map(|k| u[k] + if k == axis { sign * STEP } else { 0.0 }));
            let (after, before) = (at(1.0), at(-1.0));
            // Positions over u on [−1, 1]², where the step is twice as long.
            [0, 1].map(|k| (after[k] - before[k]) / (4.0 * STEP))
        };
        for u in [[0.03, 0.97], [0.4, 0.1], [0.5, 0.6], [0.99, 0.01]] {
            let (a, b) = (difference(u, 0), difference(u, 1));
            let determinant = a[0] * b[1] - a[1] * b[0];
            assert!(
                (image.determinant(u) - determinant).abs() < DIFFERENCE_TOL,
                "{u:?}"
            );
        }
    }

    #[test]
    fn an_image_of_one_cell_is_constant() {
        let image = MapImage {
            side: 1,
            points: vec![[0.25, -0.5]],
        };
        assert!(close(image.at([0.9, 0.1]), [0.25, -0.5]));
        assert_eq!(image.determinant([0.9, 0.1]), 0.0);
    }
}
