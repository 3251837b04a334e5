//! What an importance map is judged by, whatever it is made of: cost, folds, stretch, binning and what lies outside.
//!
//! Source: the definitions of the model card for binning; Monge's cost for the rest. Everything is on [−1, 1]², for
//! `u` as well, so that the identity has cost 0, determinant 1 and stretch 1.

use bake_runtime::bsdf::shifted_r2;
use rayon::prelude::*;

use super::map::ImportanceMap;
use super::marginal::MarginalMap;
use super::points::to_disk;
use super::raster::Raster;
use crate::card::bins::{SIDE, l1};
use crate::spline::cell_centre;

/// Nodes per cell and side of the grids of [`fold_fraction`] and [`max_stretch`].
pub const SUB_CELLS: usize = 4;
/// Points of a histogram; fewer say more about themselves than about the map.
pub const BINNING_POINTS: u64 = 1 << 20;
/// Points that one task draws.
const BLOCK: u64 = 1 << 14;

/// Where positions may lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Domain {
    /// The unit disk, for slices.
    Disk,
    /// [−1, 1]², for pictures.
    Square,
}

impl Domain {
    /// Whether `p` lies in it, rim included.
    pub fn contains(self, [x, y]: [f64; 2]) -> bool {
        match self {
            Domain::Disk => x * x + y * y <= 1.0,
            Domain::Square => x.abs() <= 1.0 && y.abs() <= 1.0,
        }
    }
}

/// Mean squared distance on [−1, 1]² between the centres of `side`² cells and their images.
pub fn cost(map: &dyn ImportanceMap, side: usize) -> f64 {
    let sum: f64 = (0..side * side)
        .map(|k| {
            let u = cell_centre(k, side);
            let (p, q) = (map.at(u), to_disk(u));
            (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2)
        })
        .sum();
    sum / (side * side) as f64
}

/// A chart's share of the unit square and the grid over it: nodes are cell centres, never on a break.
struct Chart {
    start: f64,
    width: f64,
    columns: usize,
    rows: usize,
}

impl Chart {
    /// The charts of `map` with [`SUB_CELLS`] nodes per cell and side, at least two columns each.
    fn all(map: &dyn ImportanceMap, side: usize) -> Vec<Chart> {
        let rows = SUB_CELLS * side.max(1);
        let mut ends = map.breaks();
        ends.retain(|end| *end > 0.0 && *end < 1.0);
        ends.sort_by(f64::total_cmp);
        ends.push(1.0);
        let mut start = 0.0;
        let chart = |end: f64| {
            let width = end - start;
            let columns = ((rows as f64 * width).ceil() as usize).max(2);
            let chart = Chart {
                start,
                width,
                columns,
                rows,
            };
            start = end;
            chart
        };
        ends.into_iter().map(chart).filter(|c| c.width > 0.0).collect()
    }

    fn node(&self, column: usize, row: usize) -> [f64; 2] {
        [
            self.start + self.width * (column as f64 + 0.5) / self.columns as f64,
            (row as f64 + 0.5) / self.rows as f64,
        ]
    }
}

/// Share of the unit square in which the determinant of `map` is not positive, by [`SUB_CELLS`]² nodes in each of
/// `side`² cells; every chart has a grid of its own.
pub fn fold_fraction(map: &dyn ImportanceMap, side: usize) -> f64 {
    let share = |chart: &Chart| {
        let folded: usize = (0..chart.rows)
            .into_par_iter()
            .map(|row| {
                let folds = |column: &usize| map.determinant(chart.node(*column, row)) <= 0.0;
                (0..chart.columns).filter(folds).count()
            })
            .sum();
        chart.width * folded as f64 / (chart.rows * chart.columns) as f64
    };
    Chart::all(map, side).iter().map(share).sum()
}

/// Largest singular value of the derivative of `map`, by differences between neighbouring nodes of the grids of
/// [`fold_fraction`], never across a break.
pub fn max_stretch(map: &dyn ImportanceMap, side: usize) -> f64 {
    let largest = |chart: &Chart| {
        let (dx, dy) = (2.0 * chart.width / chart.columns as f64, 2.0 / chart.rows as f64);
        (1..chart.rows)
            .into_par_iter()
            .map(|row| {
                let line = |row: usize| -> Vec<[f64; 2]> {
                    (0..chart.columns).map(|c| map.at(chart.node(c, row))).collect()
                };
                let (below, here) = (line(row - 1), line(row));
                let stretch = |c: usize| {
                    let along = |b: [f64; 2], step: f64| [0, 1].map(|k| (here[c][k] - b[k]) / step);
                    largest_singular_value(along(here[c - 1], dx), along(below[c], dy))
                };
                (1..chart.columns).map(stretch).fold(0.0, f64::max)
            })
            .reduce(|| 0.0, f64::max)
    };
    Chart::all(map, side).iter().map(largest).fold(0.0, f64::max)
}

/// Of the 2 × 2 matrix with columns `a` and `b`.
fn largest_singular_value(a: [f64; 2], b: [f64; 2]) -> f64 {
    // σ₁ is half the sum of the lengths of the matrix's conformal and anticonformal parts.
    let conformal = (a[0] + b[1]).hypot(a[1] - b[0]);
    let anticonformal = (a[0] - b[1]).hypot(a[1] + b[0]);
    0.5 * (conformal + anticonformal)
}

/// Share of `points` R2 points whose image lies outside `domain`.
pub fn outside(map: &dyn ImportanceMap, domain: Domain, points: u64) -> f64 {
    let count = |block: u64| {
        let range = block * BLOCK..((block + 1) * BLOCK).min(points);
        range
            .filter(|i| !domain.contains(map.at(shifted_r2(*i, [0.0; 2]))))
            .count() as u64
    };
    let sum: u64 = (0..points.div_ceil(BLOCK)).into_par_iter().map(count).sum();
    sum as f64 / points as f64
}

/// Images of `points` R2 points counted in 64² bins of [−1, 1]², x fastest; what lies outside counts in the nearest
/// bin. [`l1`] compares it with [`reference_bins`]; [`BINNING_POINTS`] are enough.
pub fn histogram(map: &dyn ImportanceMap, points: u64) -> Vec<u64> {
    count_bins(points, |u| map.at(u))
}

/// Binning L1 of a perfect map onto `bins` (64² masses): the discrepancy of `points` R2 points alone.
pub fn binning_floor(bins: &[f64], points: u64) -> f64 {
    let invert = MarginalMap::new(bins, SIDE);
    l1(&count_bins(points, |u| to_disk(invert.at(u))), bins)
}

/// Counts in the 64² bins of [−1, 1]² of the images of R2 points.
fn count_bins(points: u64, at: impl Fn([f64; 2]) -> [f64; 2] + Sync) -> Vec<u64> {
    let cell = |x: f64| ((0.5 * (x + 1.0) * SIDE as f64) as usize).min(SIDE - 1);
    count(points, |u| {
        let [x, y] = at(u);
        cell(y) * SIDE + cell(x)
    })
}

/// How many of the first `points` R2 points have each `index` below [`SIDE`]².
pub fn count(points: u64, index: impl Fn([f64; 2]) -> usize + Sync) -> Vec<u64> {
    let block = |mut counts: Vec<u64>, block: u64| {
        for i in block * BLOCK..((block + 1) * BLOCK).min(points) {
            counts[index(shifted_r2(i, [0.0; 2]))] += 1;
        }
        counts
    };
    let zero = || vec![0; SIDE * SIDE];
    // Sums of integers do not depend on their order.
    (0..points.div_ceil(BLOCK))
        .into_par_iter()
        .fold(zero, block)
        .reduce(zero, |mut sum, part| {
            sum.iter_mut().zip(&part).for_each(|(s, p)| *s += p);
            sum
        })
}

/// `counts` of [`count`] as shares of the `points` that were drawn.
pub fn shares(counts: &[u64], points: u64) -> Vec<f64> {
    counts.iter().map(|c| *c as f64 / points as f64).collect()
}

/// Mass of `raster` in the 64² bins of [`histogram`]; a pixel across several bins is shared by area.
pub fn reference_bins(raster: &Raster) -> Vec<f64> {
    // Overlap of every pixel with every bin along one axis, as a share of the pixel.
    let overlaps = |pixel: usize| {
        let scale = SIDE as f64 / raster.side as f64;
        let (start, end) = (pixel as f64 * scale, (pixel + 1) as f64 * scale);
        let last = (end.ceil() as usize).min(SIDE);
        (start as usize..last).map(move |bin| {
            let overlap = end.min((bin + 1) as f64) - start.max(bin as f64);
            (bin, (overlap / scale).max(0.0))
        })
    };
    let mut bins = vec![0.0; SIDE * SIDE];
    for (k, mass) in raster.mass.iter().enumerate() {
        for (row, height) in overlaps(k / raster.side) {
            for (column, width) in overlaps(k % raster.side) {
                bins[row * SIDE + column] += mass * height * width;
            }
        }
    }
    bins
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::densities::{blobs, disk, lobe};
    use crate::transport::map::MapImage;
    use crate::transport::{hierarchical, marginal};

    /// Round-off of differences over steps of 1/256.
    const ROUND_OFF: f64 = 1e-10;
    /// Columns are whole, so a break is off by less than one of them.
    const COLUMN_TOL: f64 = 2e-2;
    /// R2 points count an area to about ln n / n; here with 2¹⁶ of them.
    const COUNT_TOL: f64 = 1e-3;

    /// A map given by formulas.
    struct Formula<F, D>(F, D, Vec<f64>);

    impl<F, D> ImportanceMap for Formula<F, D>
    where
        F: Fn([f64; 2]) -> [f64; 2] + Sync,
        D: Fn([f64; 2]) -> f64 + Sync,
    {
        fn at(&self, u: [f64; 2]) -> [f64; 2] {
            self.0(u)
        }

        fn determinant(&self, u: [f64; 2]) -> f64 {
            self.1(u)
        }

        fn breaks(&self) -> Vec<f64> {
            self.2.clone()
        }
    }

    #[test]
    fn identity_translation_and_shear() {
        let identity = Formula(to_disk, |_| 1.0, Vec::new());
        assert_eq!(cost(&identity, 8), 0.0);
        assert_eq!(fold_fraction(&identity, 8), 0.0);
        assert!((max_stretch(&identity, 8) - 1.0).abs() < ROUND_OFF);
        let moved = Formula(
            |u: [f64; 2]| [2.0 * u[0] - 0.7, 2.0 * u[1] - 1.4],
            |_| 1.0,
            Vec::new(),
        );
        assert!((cost(&moved, 8) - 0.25).abs() < ROUND_OFF);
        // x + y, y: the singular values of a unit shear are the golden ratio and its inverse.
        let shear = Formula(
            |u: [f64; 2]| [2.0 * (u[0] + u[1]), 2.0 * u[1]],
            |_| 1.0,
            Vec::new(),
        );
        let golden = 0.5 * (1.0 + 5.0_f64.sqrt());
        assert!((max_stretch(&shear, 8) - golden).abs() < ROUND_OFF);
    }

    #[test]
    fn a_break_is_no_stretch_and_folds_count_by_area() {
        // Two charts, both over the whole square; the second one turned over.
        let at = |u: [f64; 2]| match u[0] < 0.3 {
            true => [2.0 * u[0] / 0.3 - 1.0, 2.0 * u[1] - 1.0],
            false => [1.0 - 2.0 * (u[0] - 0.3) / 0.7, 2.0 * u[1] - 1.0],
        };
        let sign = |u: [f64; 2]| if u[0] < 0.3 { 1.0 / 0.3 } else { -1.0 / 0.7 };
        let charts = Formula(at, sign, vec![0.3]);
        assert!((max_stretch(&charts, 16) - 1.0 / 0.3).abs() < ROUND_OFF);
        assert!((fold_fraction(&charts, 16) - 0.7).abs() < ROUND_OFF);
        let unsaid = Formula(
            |u| [at(u)[0] + 2.0 * f64::from(u8::from(u[0] < 0.3)), at(u)[1]],
            sign,
            Vec::new(),
        );
        assert!((fold_fraction(&unsaid, 16) - 0.7).abs() < COLUMN_TOL);
        assert!(
            max_stretch(&unsaid, 16) > 10.0,
            "the jump is seen where no break is told"
        );
    }

    #[test]
    fn positions_outside_are_counted() {
        let identity = Formula(to_disk, |_| 1.0, Vec::new());
        let corners = 1.0 - 0.25 * std::f64::consts::PI;
        assert!((outside(&identity, Domain::Disk, 1 << 16) - corners).abs() < COUNT_TOL);
        assert_eq!(outside(&identity, Domain::Square, 1 << 16), 0.0);
        let wide = Formula(
            |u: [f64; 2]| [4.0 * u[0] - 2.0, 2.0 * u[1] - 1.0],
            |_| 2.0,
            Vec::new(),
        );
        assert!((outside(&wide, Domain::Square, 1 << 16) - 0.5).abs() < COUNT_TOL);
    }

    #[test]
    fn reference_bins_keep_the_mass_where_it_is() {
        let fine = reference_bins(&blobs(128));
        let by_hand: f64 = [0, 1, 128, 129]
            .iter()
            .map(|k| blobs(128).mass[128 * 10 + 20 + k])
            .sum();
        assert!((fine[5 * SIDE + 10] - by_hand).abs() < ROUND_OFF);
        for side in [1, 63, 100] {
            let bins = reference_bins(&Raster::new(side, &vec![1.0; side * side]).expect("even"));
            let even = 1.0 / (SIDE * SIDE) as f64;
            assert!(bins.iter().all(|b| (b - even).abs() < ROUND_OFF), "{side}");
        }
    }

    /// Binning L1 of bilinear images of 128² cells, marginal and hierarchical: the lobe, whose tail has the largest
    /// cells, gives 0.0285 and 0.0300.
    const IMAGE_L1: [f64; 2] = [0.032, 0.034];

    #[test]
    fn the_inversions_bin_to_the_density() {
        let exact = Formula(to_disk, |_| 1.0, Vec::new());
        let even = vec![1.0; SIDE * SIDE];
        let counts = histogram(&exact, BINNING_POINTS);
        assert_eq!(counts.iter().sum::<u64>(), BINNING_POINTS);
        assert!((l1(&counts, &even) - binning_floor(&even, BINNING_POINTS)).abs() < ROUND_OFF);
        for raster in [disk(128), blobs(128), lobe(128, [0.3, 0.1], [0.2, 0.1])] {
            let bins = reference_bins(&raster);
            let floor = binning_floor(&bins, BINNING_POINTS);
            let images: [MapImage; 2] = [marginal::solve(&raster, 128), hierarchical::solve(&raster, 128)];
            for (image, limit) in images.iter().zip(IMAGE_L1) {
                let found = l1(&histogram(image, BINNING_POINTS), &bins);
                assert!(found > floor && found < limit, "{found} over a floor of {floor}");
            }
        }
    }
}
