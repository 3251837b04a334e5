//! Point clouds in compact tiles and clusters: what makes the truncation of Sinkhorn's sums tight, and their first steps
//! cheap.
//!
//! The order is that of a k-d tree (Bentley 1975, *Multidimensional Binary Search Trees Used for Associative
//! Searching*), split at the median of the longer side, so that any aligned run of points is compact.

use std::ops::Range;

/// Points of a tile: queries that share one list of targets.
const TILE: usize = 64;
/// Points of a cluster, which stands for them in the first steps.
pub const CLUSTER: usize = 16;

/// An aligned run of points and the box around it.
#[derive(Clone, Debug)]
pub struct Tile {
    /// Its points.
    pub range: Range<usize>,
    /// Centre of the box.
    pub centre: [f64; 2],
    /// Half its sides.
    pub radius: [f64; 2],
}

/// Weighted points in the order of a k-d tree.
#[derive(Clone, Debug)]
pub struct Cloud {
    /// The points.
    pub points: Vec<[f64; 2]>,
    /// Logarithms of their weights, which add up to 1.
    pub log_weights: Vec<f64>,
    /// Runs of points for joint work.
    pub tiles: Vec<Tile>,
    /// Index of every point in the order given.
    pub order: Vec<usize>,
}

impl Cloud {
    /// `points` of equal weight.
    pub fn new(points: &[[f64; 2]]) -> Cloud {
        let mut order: Vec<usize> = (0..points.len()).collect();
        sort(points, &mut order);
        let weight = -(points.len() as f64).ln();
        let points: Vec<[f64; 2]> = order.iter().map(|k| points[*k]).collect();
        Cloud {
            tiles: runs(&points, TILE),
            log_weights: vec![weight; points.len()],
            points,
            order,
        }
    }

    /// Means of clusters of up to [`CLUSTER`] points, weighted by their number.
    pub fn coarse(&self) -> Cloud {
        let n = self.points.len() as f64;
        let mean =
            |run: &[[f64; 2]]| [0, 1].map(|k| run.iter().map(|p| p[k]).sum::<f64>() / run.len() as f64);
        let clusters = self.points.chunks(CLUSTER);
        let points: Vec<[f64; 2]> = clusters.clone().map(mean).collect();
        Cloud {
            log_weights: clusters.map(|run| (run.len() as f64 / n).ln()).collect(),
            tiles: runs(&points, TILE),
            order: (0..points.len()).collect(),
            points,
        }
    }

    /// Side of the square that holds a cluster, the median over all of them.
    pub fn cluster_size(&self) -> f64 {
        let mut sizes: Vec<f64> = runs(&self.points, CLUSTER)
            .iter()
            .map(|t| 2.0 * (t.radius[0] * t.radius[1]).sqrt())
            .collect();
        sizes.sort_by(f64::total_cmp);
        sizes[sizes.len() / 2]
    }

    /// Values in the order of the cloud, brought back to the order of the points given.
    pub fn restore<T: Copy + Default>(&self, values: &[T]) -> Vec<T> {
        let mut restored = vec![T::default(); values.len()];
        for (k, value) in self.order.iter().zip(values) {
            restored[*k] = *value;
        }
        restored
    }
}

/// Brings `order` into that of the tree. Parts are whole tiles, then whole clusters, so that both are branches of it.
fn sort(points: &[[f64; 2]], order: &mut [usize]) {
    let n = order.len();
    if n <= CLUSTER {
        return;
    }
    let unit = if n > TILE { TILE } else { CLUSTER };
    let middle = (n / 2).next_multiple_of(unit);
    let axis = longer_side(points, order);
    let (low, high) = split_at(points, order, middle, axis);
    sort(points, low);
    sort(points, high);
}

/// Axis along which the points of `list` extend further, the first of equals.
pub fn longer_side(points: &[[f64; 2]], list: &[usize]) -> usize {
    let side = |k: usize| {
        let all = list.iter().map(|i| points[*i][k]);
        all.clone().fold(f64::NEG_INFINITY, f64::max) - all.fold(f64::INFINITY, f64::min)
    };
    usize::from(side(1) > side(0))
}

/// Splits `list` so that its first `middle` < n points are the smallest along `axis`.
pub fn split_at<'a>(
    points: &[[f64; 2]],
    list: &'a mut [usize],
    middle: usize,
    axis: usize,
) -> (&'a mut [usize], &'a mut [usize]) {
    // Equal coordinates are common on grids; the other one, then the index, decide.
    list.select_nth_unstable_by(middle, |i, j| {
        let (a, b) = (points[*i], points[*j]);
        (a[axis].total_cmp(&b[axis]))
            .then(a[1 - axis].total_cmp(&b[1 - axis]))
            .then(i.cmp(j))
    });
    list.split_at_mut(middle)
}

/// Aligned runs of `length` points with their boxes.
fn runs(points: &[[f64; 2]], length: usize) -> Vec<Tile> {
    let run = |(i, run): (usize, &[[f64; 2]])| {
        let bound =
            |k: usize, start: f64, pick: fn(f64, f64) -> f64| run.iter().map(|p| p[k]).fold(start, pick);
        let low = [0, 1].map(|k| bound(k, f64::INFINITY, f64::min));
        let high = [0, 1].map(|k| bound(k, f64::NEG_INFINITY, f64::max));
        Tile {
            range: i * length..i * length + run.len(),
            centre: [0, 1].map(|k| 0.5 * (low[k] + high[k])),
            radius: [0, 1].map(|k| 0.5 * (high[k] - low[k])),
        }
    };
    points.chunks(length).enumerate().map(run).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::Rng;

    /// Round-off of sums of a thousand weights.
    const ROUND_OFF: f64 = 1e-12;

    fn random(n: usize) -> Vec<[f64; 2]> {
        let mut rng = Rng::new(&[42]);
        (0..n).map(|_| [rng.uniform(), rng.uniform()]).collect()
    }

    #[test]
    fn the_order_is_undone_and_weights_are_whole() {
        for n in [1, 16, 17, 65, 1000] {
            let points = random(n);
            let cloud = Cloud::new(&points);
            assert_eq!(cloud.restore(&cloud.points), points);
            for cloud in [&cloud, &cloud.coarse()] {
                let sum: f64 = cloud.log_weights.iter().map(|w| w.exp()).sum();
                assert!((sum - 1.0).abs() < ROUND_OFF);
                let covered: usize = cloud.tiles.iter().map(|t| t.range.len()).sum();
                assert_eq!(covered, cloud.points.len());
            }
        }
    }

    #[test]
    fn tiles_hold_their_points_and_are_compact() {
        let cloud = Cloud::new(&random(4096));
        let mut area = 0.0;
        for tile in &cloud.tiles {
            for p in &cloud.points[tile.range.clone()] {
                assert!((0..2).all(|k| (p[k] - tile.centre[k]).abs() <= tile.radius[k] + ROUND_OFF));
            }
            area += 4.0 * tile.radius[0] * tile.radius[1];
        }
        assert!(area < 1.0, "branches of a tree do not overlap: {area}");
        // Sixteen of 4096 even points share 1/256 of the unit square.
        assert!((0.5..1.0).contains(&(16.0 * cloud.cluster_size())));
    }
}
