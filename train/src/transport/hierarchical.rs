//! Hierarchical sample warping: halve the raster again and again, and let each uniform number choose a half and be
//! stretched over it.
//!
//! Source: Clarberg, Jarosz, Akenine-Möller and Jensen 2005, *Wavelet Importance Sampling*, §4. Deviation: rows and
//! columns are halved at the middle pixel, so a raster of any side will do; for powers of two the warp is theirs.

use super::map::MapImage;
use super::points::to_disk;
use super::raster::{Raster, Sums};

/// The warp of one density.
struct Warp {
    side: usize,
    sums: Sums,
}

impl Warp {
    fn new(raster: &Raster) -> Warp {
        Warp {
            side: raster.side,
            sums: Sums::new(&raster.mass, raster.side),
        }
    }

    /// Mass of the pixels in a range of columns and a range of rows.
    fn mass(&self, [[x0, x1], [y0, y1]]: [[usize; 2]; 2]) -> f64 {
        let at = |x: usize, y: usize| self.sums.corner(x, y);
        (at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0)).max(0.0)
    }

    /// Image of `u` in the unit square.
    fn at(&self, mut u: [f64; 2]) -> [f64; 2] {
        let mut ranges = [[0, self.side]; 2];
        while ranges.iter().any(|[start, end]| end - start > 1) {
            // Rows before columns, as Clarberg et al. do.
            for axis in [1, 0] {
                let [start, end] = ranges[axis];
                if end - start == 1 {
                    continue;
                }
                let all = self.mass(ranges);
                let middle = start + (end - start) / 2;
                ranges[axis] = [start, middle];
                let share = if all > 0.0 {
                    (self.mass(ranges) / all).min(1.0)
                } else {
                    0.5
                };
                if u[axis] < share {
                    u[axis] /= share;
                } else {
                    u[axis] = ((u[axis] - share) / (1.0 - share)).clamp(0.0, 1.0);
                    ranges[axis] = [middle, end];
                }
            }
        }
        [0, 1].map(|k| (ranges[k][0] as f64 + u[k]) / self.side as f64)
    }
}

/// Image of the warp onto `raster` at the centres of `side`² cells.
pub fn solve(raster: &Raster, side: usize) -> MapImage {
    let warp = Warp::new(raster);
    MapImage::of(side, |u| to_disk(warp.at(u)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spline::cell_centre;
    use crate::transport::densities::blobs;

    /// Round-off of ten halvings.
    const ROUND_OFF: f64 = 1e-12;
    /// Even samples count a pixel's mass to about one row of them.
    const COUNT_TOL: f64 = 2e-3;

    #[test]
    fn an_even_density_gives_the_identity() {
        for side in [1, 4, 7] {
            let raster = Raster::new(side, &vec![2.0; side * side]).expect("even");
            let image = solve(&raster, 9);
            for (k, p) in image.points.iter().enumerate() {
                let u = to_disk(cell_centre(k, 9));
                assert!((p[0] - u[0]).abs() < ROUND_OFF && (p[1] - u[1]).abs() < ROUND_OFF);
            }
        }
    }

    #[test]
    fn every_pixel_gets_its_mass_whatever_the_side() {
        for side in [8, 11] {
            let raster = blobs(side);
            let warp = Warp::new(&raster);
            let n = 1000;
            let mut counts = vec![0.0; side * side];
            for k in 0..n * n {
                let [x, y] = warp.at(cell_centre(k, n)).map(|v| (v * side as f64) as usize);
                counts[y * side + x] += 1.0 / (n * n) as f64;
            }
            for (count, mass) in counts.iter().zip(&raster.mass) {
                assert!((count - mass).abs() < COUNT_TOL, "{count} against {mass}");
            }
        }
    }

    #[test]
    fn two_by_two_pixels_are_warped_as_by_hand() {
        // Rows have 0.3 and 0.7, so u₁ = 0.65 lies half way up the second, whose pixels have 3/7 and 4/7.
        let raster = Raster::new(2, &[1.0, 2.0, 3.0, 4.0]).expect("positive");
        let [x, y] = Warp::new(&raster).at([5.0 / 7.0, 0.65]);
        assert!((x - 0.75).abs() < ROUND_OFF && (y - 0.75).abs() < ROUND_OFF);
    }

    #[test]
    fn an_empty_pixel_is_never_reached() {
        let raster = Raster::new(3, &[0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]).expect("two pixels");
        let warp = Warp::new(&raster);
        for k in 0..400 {
            let [x, y] = warp.at(cell_centre(k, 20)).map(|v| (v * 3.0) as usize);
            assert!(matches!((x, y), (1, 0) | (2, 1)), "{x}, {y}");
        }
    }
}
