//! Exact assignment of as many points to points at the least sum of squared distances: the oracle of every other map.
//!
//! Source: Jonker and Volgenant 1987, *A Shortest Augmenting Path Algorithm for Dense and Sparse Linear Assignment
//! Problems*. Deviations: costs are computed when they are needed, so memory grows with n and not n²; the start may come
//! from potentials of another solver, which leaves few rows to augment.

use pulp::Arch;
use std::collections::VecDeque;

use super::kantorovich::c_transform;
use super::paths::Paths;
use super::plane::Plane;
use crate::error::{Error, Result};

/// A row that is displaced this often without finding a free column waits for its augmenting path.
const REDUCTIONS: usize = 4;
/// Coordinates and potentials up to this have squares that are finite, so that every search ends.
const LARGEST: f64 = 1e100;
/// No column.
const FREE: usize = usize::MAX;

/// An optimal assignment with its certificate.
#[derive(Clone, Debug)]
pub struct Assignment {
    /// Target of every source.
    pub permutation: Vec<usize>,
    /// Mean squared distance.
    pub cost: f64,
    /// Feasible potentials of the sources and of the targets, f_i + g_j ≤ |x_i − y_j|², whose means add up to the cost.
    pub duals: [Vec<f64>; 2],
}

/// The state between augmentations: column potentials lie in `plane`.
struct Solver<'a> {
    source: &'a [[f64; 2]],
    target: &'a [[f64; 2]],
    plane: Plane,
    column_of: Vec<usize>,
    row_of: Vec<usize>,
}

/// Assigns every one of `source` to one of `target`, as many points.
///
/// `start_duals` are potentials of the targets, good ones for speed; any finite ones do. Ends with potentials that prove
/// the result up to round-off. Takes O(n²) operations when they are good and O(n³) at worst.
///
/// # Errors
/// [`Error::Density`] when numbers differ, there are no points, or one of them or a potential is not finite or above 10¹⁰⁰.
pub fn solve(source: &[[f64; 2]], target: &[[f64; 2]], start_duals: Option<&[f64]>) -> Result<Assignment> {
    let n = source.len();
    let potentials = start_duals.map_or(n, <[f64]>::len);
    if n == 0 || target.len() != n || potentials != n {
        let found = target.len();
        return Err(Error::Density {
            reason: format!("{n} points cannot be assigned to {found}, with {potentials} potentials"),
        });
    }
    let mut numbers = source
        .iter()
        .chain(target)
        .flatten()
        .chain(start_duals.unwrap_or(&[]));
    if !numbers.all(|v| v.abs() <= LARGEST) {
        return Err(Error::Density {
            reason: "a point or a potential is not a number of common size".into(),
        });
    }
    let zero = vec![0.0; n];
    // The transform back gives every column a row at distance zero.
    let f = c_transform(source, target, start_duals.unwrap_or(&zero));
    let g = c_transform(target, source, &f);
    let mut solver = Solver {
        source,
        target,
        plane: Plane::new(target, &g),
        column_of: vec![FREE; n],
        row_of: vec![FREE; n],
    };
    let free = solver.reduce();
    let mut path = Paths::new(n);
    for row in free {
        solver.augment(row, &mut path);
    }
    let f = c_transform(source, target, &solver.plane.potential);
    let cost = source
        .iter()
        .zip(&solver.column_of)
        .map(|(x, j)| squared_distance(*x, target[*j]))
        .sum::<f64>()
        / n as f64;
    Ok(Assignment {
        permutation: solver.column_of,
        cost,
        duals: [f, solver.plane.potential],
    })
}

fn squared_distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
}

impl Solver<'_> {
    /// Gives every row its nearest column in reduced cost, as far as they are free, and lets rows outbid each other
    /// (augmenting row reduction). Returns the rows left over.
    fn reduce(&mut self) -> Vec<usize> {
        let n = self.source.len();
        let mut queue: VecDeque<usize> = (0..n).collect();
        let mut tries = vec![0; n];
        let mut left = Vec::new();
        while let Some(row) = queue.pop_front() {
            if tries[row] == REDUCTIONS {
                left.push(row);
                continue;
            }
            tries[row] += 1;
            let smallest = self.plane.smallest(self.source[row]);
            let j = smallest.index;
            let displaced = self.row_of[j];
            if displaced != FREE && smallest.second <= smallest.value {
                // Outbidding by nothing would go on for ever.
                left.push(row);
                continue;
            }
            if smallest.second.is_finite() {
                // The price falls until the second column is as good.
                self.plane.potential[j] -= smallest.second - smallest.value;
            }
            self.row_of[j] = row;
            self.column_of[row] = j;
            if displaced != FREE {
                self.column_of[displaced] = FREE;
                queue.push_front(displaced);
            }
        }
        left
    }

    /// Finds the shortest path in reduced costs from a free row to a free column and turns its edges over.
    fn augment(&mut self, start: usize, paths: &mut Paths) {
        paths.distance.fill(f64::INFINITY);
        paths.closed.fill(0.0);
        paths.tree.clear();
        let mut row = start;
        // The length of the path to this row, less the row's potential.
        let mut base = -self.plane.smallest(self.source[start]).value;
        let (last, length) = loop {
            let (column, length) =
                Arch::new().dispatch(|| paths.relax(&self.plane, self.source[row], row, base));
            let next = self.row_of[column];
            if next == FREE {
                break (column, length);
            }
            paths.tree.push((column, length));
            paths.distance[column] = f64::INFINITY;
            paths.closed[column] = f64::INFINITY;
            row = next;
            base = length
                - (squared_distance(self.source[row], self.target[column]) - self.plane.potential[column]);
        };
        for (column, distance) in &paths.tree {
            self.plane.potential[*column] -= length - distance;
        }
        let mut column = last;
        loop {
            let row = paths.before[column] as usize;
            self.row_of[column] = row;
            std::mem::swap(&mut self.column_of[row], &mut column);
            if row == start {
                break;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::densities::raster;
    use crate::transport::marginal;
    use crate::transport::points::source_points;
    use bake_runtime::Rng;

    /// Cost and dual value of the same assignment: round-off of sums of a thousand terms.
    const CERTIFICATE: f64 = 1e-12;

    fn random(rng: &mut Rng, n: usize) -> Vec<[f64; 2]> {
        (0..n).map(|_| [rng.uniform(), rng.uniform()]).collect()
    }

    /// Solves, and checks feasibility and the certificate.
    fn certified(source: &[[f64; 2]], target: &[[f64; 2]], start: Option<&[f64]>) -> Assignment {
        let solved = solve(source, target, start).expect("as many finite points");
        let n = source.len();
        let [f, g] = &solved.duals;
        let dual = (f.iter().sum::<f64>() + g.iter().sum::<f64>()) / n as f64;
        let scale = solved.cost.max(g.iter().fold(0.0, |a, v| v.abs().max(a)));
        assert!(
            (solved.cost - dual).abs() <= CERTIFICATE * scale,
            "{} and {dual}",
            solved.cost
        );
        for (x, f) in source.iter().zip(f) {
            for (y, g) in target.iter().zip(g) {
                assert!(f + g <= squared_distance(*x, *y) + CERTIFICATE * scale);
            }
        }
        let mut sorted = solved.permutation.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, Vec::from_iter(0..n));
        solved
    }

    /// The least sum over all permutations, by trying them.
    fn brute_force(source: &[[f64; 2]], target: &[[f64; 2]], used: &mut Vec<usize>) -> f64 {
        let i = used.len();
        if i == source.len() {
            return 0.0;
        }
        let mut least = f64::INFINITY;
        for j in 0..target.len() {
            if !used.contains(&j) {
                used.push(j);
                let rest = brute_force(source, target, used);
                least = least.min(squared_distance(source[i], target[j]) + rest);
                used.pop();
            }
        }
        least
    }

    #[test]
    fn small_problems_are_solved_as_by_trying_everything() {
        let mut rng = Rng::new(&[51]);
        for n in 1..=7 {
            for _ in 0..20 {
                let (source, target) = (random(&mut rng, n), random(&mut rng, n));
                let least = brute_force(&source, &target, &mut Vec::new()) / n as f64;
                assert!((certified(&source, &target, None).cost - least).abs() <= CERTIFICATE);
            }
        }
    }

    #[test]
    fn any_start_gives_the_same_cost() {
        let mut rng = Rng::new(&[52]);
        let (source, target) = (random(&mut rng, 300), random(&mut rng, 300));
        let cold = certified(&source, &target, None);
        let bad: Vec<f64> = (0..300).map(|_| rng.uniform()).collect();
        for start in [&bad, &cold.duals[1]] {
            let warm = certified(&source, &target, Some(start));
            assert!((warm.cost - cold.cost).abs() <= CERTIFICATE);
        }
    }

    #[test]
    fn points_along_a_line_are_sorted() {
        let mut rng = Rng::new(&[53]);
        let mut line = |n: usize| -> Vec<f64> { (0..n).map(|_| rng.uniform()).collect() };
        let (mut a, mut b) = (line(200), line(200));
        let on_line = |v: &[f64]| -> Vec<[f64; 2]> { v.iter().map(|t| [0.6 * t, 0.8 * t]).collect() };
        let found = certified(&on_line(&a), &on_line(&b), None).cost;
        a.sort_by(f64::total_cmp);
        b.sort_by(f64::total_cmp);
        let expected: f64 = a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / 200.0;
        assert!((found - expected).abs() <= CERTIFICATE);
    }

    /// The gradient of a convex function is optimal for whatever points it is applied to (Brenier 1991).
    #[test]
    fn identity_translation_and_the_affine_map_between_gaussians() {
        let mut rng = Rng::new(&[54]);
        let source: Vec<[f64; 2]> = (0..500)
            .map(|_| {
                let (r, phi) = (
                    (-2.0 * (1.0 - rng.uniform()).ln()).sqrt(),
                    std::f64::consts::TAU * rng.uniform(),
                );
                [0.2 * r * phi.cos(), 0.2 * r * phi.sin()]
            })
            .collect();
        let maps: [fn([f64; 2]) -> [f64; 2]; 3] = [
            |p| p,
            |[x, y]| [x + 0.3, y - 0.4],
            // Symmetric and positive: the optimal map onto the Gaussian of covariance A Σ A.
            |[x, y]| [0.9 * x + 0.2 * y + 0.1, 0.2 * x + 0.3 * y],
        ];
        for map in maps {
            let order: Vec<usize> = (0..500).map(|k| (k * 37) % 500).collect();
            let target: Vec<[f64; 2]> = order.iter().map(|k| map(source[*k])).collect();
            let solved = certified(&source, &target, None);
            assert!((0..500).all(|k| solved.permutation[order[k]] == k));
        }
    }

    #[test]
    fn the_marginal_map_of_a_separable_density_is_optimal() {
        let raster = raster(32, |x, y| (1.2 + x) * (1.0 + y * y));
        let target = marginal::solve(&raster, 24).points;
        let solved = certified(&source_points(24), &target, None);
        assert_eq!(solved.permutation, Vec::from_iter(0..24 * 24));
    }

    #[test]
    fn points_that_coincide_are_shared_out() {
        certified(&source_points(8), &[[0.1, 0.2]; 64], None);
    }

    #[test]
    fn what_cannot_be_assigned_is_an_error() {
        let two = source_points(2);
        let (nan, huge) = ([[f64::NAN; 2]; 4], [[1e200; 2]; 4]);
        for (source, target, start) in [
            (&two[..], &two[..3], None),
            (&[], &[], None),
            (&two, &nan, None),
            (&two, &huge, None),
            (&two, &two, Some(&[0.0; 3][..])),
        ] {
            assert!(matches!(solve(source, target, start), Err(Error::Density { .. })));
        }
    }
}
