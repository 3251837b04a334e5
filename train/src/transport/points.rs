//! The point sets of the paper's route: even cells of the square as sources, row-column points of a density as targets.
//!
//! Source: the paper, §4.1 (one target point per cell of the map) and §5.1 (row-column sampling of the slice).

use bake_runtime::bsdf::shifted_r2;

use super::marginal::MarginalMap;
use super::raster::Raster;
use crate::spline::cell_centre;

/// A point of the unit square on [−1, 1]².
pub fn to_disk(u: [f64; 2]) -> [f64; 2] {
    u.map(|u| 2.0 * u - 1.0)
}

/// `n` points on [−1, 1]² distributed as `raster`: the first `n` of the R2 sequence through the inversion of the
/// marginal of the rows and of the conditional of the columns, which keeps them even along both.
pub fn row_column_points(raster: &Raster, n: usize) -> Vec<[f64; 2]> {
    let invert = MarginalMap::new(&raster.mass, raster.side);
    (0..n as u64)
        .map(|i| to_disk(invert.at(shifted_r2(i, [0.0; 2]))))
        .collect()
}

/// Centres of the cells of a `side` × `side` grid over [−1, 1]², x fastest.
pub fn source_points(side: usize) -> Vec<[f64; 2]> {
    (0..side * side).map(|k| to_disk(cell_centre(k, side))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::densities::blobs;

    /// 4096 R2 points count the mass of half the square to about ln n / n.
    const COUNT_TOL: f64 = 4e-3;

    #[test]
    fn points_follow_the_density() {
        let raster = blobs(40);
        let n = 4096;
        let points = row_column_points(&raster, n);
        let expected: f64 = (0..1600).filter(|k| k % 40 < 20).map(|k| raster.mass[k]).sum();
        let left = points.iter().filter(|p| p[0] < 0.0).count() as f64 / n as f64;
        assert!((left - expected).abs() < COUNT_TOL, "{left} against {expected}");
        assert!(points.iter().flatten().all(|x| (-1.0..=1.0).contains(x)));
    }

    #[test]
    fn a_single_pixel_holds_all_points() {
        let mut values = vec![0.0; 64];
        values[2 * 8 + 5] = 3.0;
        let raster = Raster::new(8, &values).expect("one pixel is a density");
        for [x, y] in row_column_points(&raster, 100) {
            assert!((0.25..=0.5).contains(&x) && (-0.5..=-0.25).contains(&y));
        }
    }

    #[test]
    fn sources_are_the_even_grid() {
        assert_eq!(
            source_points(2),
            [[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]]
        );
    }
}
