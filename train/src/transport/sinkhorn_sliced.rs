//! The paper's route to an importance map: row-column points of the density, Sinkhorn's plan as the start, sliced
//! transport onto the points, and a permutation as the image.
//!
//! Source: the paper, §4.1 (β(ψ(i)) of every cell) and §5.1, which starts sliced transport from GeomLoss's result because
//! either alone leaves crevices or takes long. How it gets from moved points to the permutation is not said; see
//! [`super::permutation`] for ours.

use std::ops::ControlFlow;

use super::map::MapImage;
use super::points::{row_column_points, source_points};
use super::raster::Raster;
use super::{permutation, sinkhorn, sliced};
use crate::Tick;
use crate::error::{Error, Result};

/// A solved map and what it was made from.
#[derive(Clone, Debug)]
pub struct Solution {
    /// The map.
    pub map: MapImage,
    /// The points on the density.
    pub points: Vec<[f64; 2]>,
    /// Index into `points` of every cell.
    pub permutation: Vec<usize>,
    /// Potentials of the cells and of the points, near optimal ones: a start for [`super::assignment`] and for
    /// [`super::kantorovich`].
    pub duals: [Vec<f64>; 2],
}

/// The map onto `raster` with `side`² cells, `side` ≥ 1; `seed` chooses the directions of sliced transport.
///
/// # Errors
/// [`Error::Interrupted`] when `tick` breaks; [`Error::Density`] when `side` is 0.
pub fn solve(raster: &Raster, side: usize, seed: u64, tick: Tick) -> Result<Solution> {
    let source = source_points(side);
    let points = row_column_points(raster, side * side);
    let problem = sinkhorn::Problem::new(&source, &points)?;
    let total = (problem.updates() + sliced::STEPS + permutation::SHIFTS.len()) as u64;
    let mut done = 0;
    let mut step = || {
        done += 1;
        match tick(done - 1, total) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(Error::Interrupted),
        }
    };
    let plan = problem.solve(&mut step)?;
    let mut moved = plan.barycentres;
    sliced::advect(&mut moved, &points, seed, &mut step)?;
    let mut permutation = permutation::pair(&moved, &points);
    permutation::improve(
        side,
        [&source, &points],
        &plan.duals[1],
        &mut permutation,
        &mut step,
    )?;
    let map = MapImage {
        side,
        points: permutation.iter().map(|j| points[*j]).collect(),
    };
    Ok(Solution {
        map,
        points,
        permutation,
        duals: plan.duals,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::densities::{blobs, disk, lobe, raster};
    use crate::transport::{assignment, marginal, measure};

    const GO_ON: Tick = &|_, _| ControlFlow::Continue(());
    /// Cost over that of the exact assignment; 1.0002 is measured here, 1.008 on an even density, whose cost is noise.
    const COST_RATIO: f64 = 1.01;
    /// Mean squared distance that the unevenness of 1024 points leaves on an even density: (a third of a cell)².
    const EVEN_COST: f64 = 1e-3;

    /// 1024 row-column points stand for a density whose cost is 0.116 to 1.5 %.
    const SEPARABLE_TOL: f64 = 0.02;

    /// Cost over the exact one, from 4096 points.
    fn cost_ratio(raster: &Raster) -> f64 {
        let side = 64;
        let solved = solve(raster, side, 1, GO_ON).expect("nothing breaks");
        let start = Some(&solved.duals[1][..]);
        let exact = assignment::solve(&source_points(side), &solved.points, start).expect("finite points");
        measure::cost(&solved.map, side) / exact.cost
    }

    #[test]
    fn a_narrow_lobe_costs_as_much_as_the_exact_assignment() {
        let ratio = cost_ratio(&lobe(128, [0.6, 0.2], [0.02, 0.01]));
        assert!((1.0..=COST_RATIO).contains(&ratio), "{ratio}");
    }

    #[test]
    fn a_picture_costs_as_much_as_the_exact_assignment() {
        let ratio = cost_ratio(&blobs(128));
        assert!((1.0..=COST_RATIO).contains(&ratio), "{ratio}");
    }

    #[test]
    fn an_even_density_gives_nearly_the_identity() {
        let solved = solve(&raster(16, |_, _| 1.0), 32, 1, GO_ON).expect("nothing breaks");
        let cost = measure::cost(&solved.map, 32);
        assert!(cost < EVEN_COST, "{cost}");
        let mut sorted = solved.permutation.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, Vec::from_iter(0..1024));
    }

    #[test]
    fn the_cost_is_that_of_the_inversion_of_a_separable_density() {
        let raster = raster(64, |x, y| (1.1 + x) * (1.5 - y * y));
        let solved = solve(&raster, 32, 1, GO_ON).expect("nothing breaks");
        let inversion = measure::cost(&marginal::solve(&raster, 32), 32);
        let cost = measure::cost(&solved.map, 32);
        assert!(
            (cost / inversion - 1.0).abs() < SEPARABLE_TOL,
            "{cost} and {inversion}"
        );
    }

    #[test]
    fn bytes_do_not_depend_on_threads() {
        let raster = disk(32);
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let pool = pool.expect("threads start");
            pool.install(|| solve(&raster, 24, 3, GO_ON))
                .expect("nothing breaks")
        };
        let (one, two) = (with(1), with(2));
        assert_eq!(one.map, two.map);
        assert_eq!(one.duals, two.duals);
    }

    #[test]
    fn a_break_ends_it_and_progress_is_whole() {
        let raster = disk(16);
        let stop: Tick = &|done, total| match done * 2 > total {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        assert!(matches!(solve(&raster, 16, 1, stop), Err(Error::Interrupted)));
        let last = std::sync::Mutex::new((0, 0));
        let watch = |done, total| {
            *last.lock().expect("nobody panics") = (done + 1, total);
            ControlFlow::Continue(())
        };
        solve(&raster, 16, 1, &watch).expect("nothing breaks");
        let (done, total) = *last.lock().expect("nobody panics");
        assert_eq!(done, total);
        assert!(matches!(solve(&raster, 0, 1, GO_ON), Err(Error::Density { .. })));
    }
}
