//! From moved points to a one-to-one assignment, and its improvement window by window.
//!
//! The start halves both sets again and again at the median of the same axis (two k-d trees matched branch by branch), so
//! it never runs out of partners as greedy matching does. The improvement reassigns the sources of a window of the grid
//! exactly among the targets they hold, in overlapping windows: what 2-opt does with pairs, done with a few hundred.

use rayon::prelude::*;

use super::assignment;
use super::cloud::{longer_side, split_at};
use crate::error::Result;

/// Cells per side of a window. With 8, an even density keeps 1 % of its cost that 16 removes.
const WINDOW: usize = 16;
/// Where the first window ends along x and y, one sweep after the other.
pub const SHIFTS: [[usize; 2]; 4] = [
    [WINDOW, WINDOW],
    [WINDOW / 2, WINDOW / 2],
    [WINDOW / 2, WINDOW],
    [WINDOW, WINDOW / 2],
];

/// Target of every one of `moved`, as many points: near ones, each once.
pub fn pair(moved: &[[f64; 2]], target: &[[f64; 2]]) -> Vec<usize> {
    let mut from: Vec<usize> = (0..moved.len()).collect();
    let mut to: Vec<usize> = (0..target.len()).collect();
    let mut permutation = vec![0; moved.len()];
    halve([moved, target], [&mut from, &mut to], &mut permutation);
    permutation
}

fn halve(points: [&[[f64; 2]]; 2], lists: [&mut [usize]; 2], permutation: &mut [usize]) {
    let [from, to] = lists;
    let n = from.len();
    if n <= 1 {
        from.iter().zip(to).for_each(|(i, j)| permutation[*i] = *j);
        return;
    }
    let axis = longer_side(points[1], to);
    let (a, b) = split_at(points[0], from, n / 2, axis);
    let (c, d) = split_at(points[1], to, n / 2, axis);
    halve(points, [a, c], permutation);
    halve(points, [b, d], permutation);
}

/// Reassigns the targets within every window of the `side` × `side` grid of `source` exactly; `permutation` gives every
/// source its target. `potential` on the targets, near an optimal one, makes it fast. `step` is called before each of the
/// sweeps, one for each of [`SHIFTS`].
///
/// # Errors
/// That of `step`; [`crate::Error::Density`] when a point is not finite.
pub fn improve(
    side: usize,
    [source, target]: [&[[f64; 2]]; 2],
    potential: &[f64],
    permutation: &mut [usize],
    mut step: impl FnMut() -> Result<()>,
) -> Result<()> {
    for [x, y] in SHIFTS {
        step()?;
        let columns = ranges(x, side);
        let windows: Vec<Vec<usize>> = ranges(y, side)
            .iter()
            .flat_map(|[bottom, top]| {
                columns
                    .iter()
                    .map(move |[left, right]| (*bottom..*top, *left..*right))
            })
            .map(|(rows, columns)| {
                rows.flat_map(|r| columns.clone().map(move |c| r * side + c))
                    .collect()
            })
            .collect();
        let assigned: Vec<Vec<usize>> = windows
            .par_iter()
            .map(|cells| {
                let held: Vec<usize> = cells.iter().map(|i| permutation[*i]).collect();
                let sources: Vec<[f64; 2]> = cells.iter().map(|i| source[*i]).collect();
                let targets: Vec<[f64; 2]> = held.iter().map(|j| target[*j]).collect();
                let start: Vec<f64> = held.iter().map(|j| potential[*j]).collect();
                let best = assignment::solve(&sources, &targets, Some(&start))?;
                Ok(best.permutation.iter().map(|k| held[*k]).collect())
            })
            .collect::<Result<_>>()?;
        for (i, j) in windows.iter().flatten().zip(assigned.iter().flatten()) {
            permutation[*i] = *j;
        }
    }
    Ok(())
}

/// Ranges that cover 0..`side`: the first up to `first`, the others a window each.
fn ranges(first: usize, side: usize) -> Vec<[usize; 2]> {
    let starts = std::iter::once(0).chain((first..side).step_by(WINDOW));
    let ends = (first..side).step_by(WINDOW).chain(std::iter::once(side));
    starts.zip(ends).map(|(a, b)| [a, b]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::points::source_points;
    use bake_runtime::Rng;

    fn sorted(permutation: &[usize]) -> Vec<usize> {
        let mut sorted = permutation.to_vec();
        sorted.sort_unstable();
        sorted
    }

    #[test]
    fn the_same_points_are_paired_with_themselves() {
        let mut rng = Rng::new(&[41]);
        let points: Vec<[f64; 2]> = (0..301).map(|_| [rng.uniform(), rng.uniform()]).collect();
        let order: Vec<usize> = (0..301).map(|k| (k * 100) % 301).collect();
        let shuffled: Vec<[f64; 2]> = order.iter().map(|k| points[*k]).collect();
        assert_eq!(pair(&shuffled, &points), order);
    }

    #[test]
    fn windows_cover_the_grid_once() {
        for side in [1, 7, 16, 40] {
            for first in [8, 16] {
                let ranges = ranges(first, side);
                let cells: Vec<usize> = ranges.iter().flat_map(|[a, b]| *a..*b).collect();
                assert_eq!(cells, Vec::from_iter(0..side));
            }
        }
    }

    #[test]
    fn improvement_keeps_a_permutation_and_undoes_local_disorder() {
        let side = 20;
        let points = source_points(side);
        let mut permutation: Vec<usize> = (0..side * side).collect();
        for k in (0..side * side - 1).step_by(2) {
            permutation.swap(k, k + 1);
        }
        let zero = vec![0.0; side * side];
        improve(side, [&points, &points], &zero, &mut permutation, || Ok(())).expect("finite points");
        assert_eq!(permutation, Vec::from_iter(0..side * side));
        let mut far: Vec<usize> = (0..side * side).rev().collect();
        improve(side, [&points, &points], &zero, &mut far, || Ok(())).expect("finite points");
        assert_eq!(sorted(&far), permutation);
    }
}
