//! The solvers that start from a raster of the disk, behind one call, and the raster of a slice.

use super::frame_map::{ChartMap, Residuals};
use super::map::MapImage;
use super::raster::Raster;
use super::{Solver, assignment, hierarchical, marginal, points, sinkhorn_sliced};
use crate::error::{Error, Result};
use crate::lobes::{LUMINANCE, Lobe, LobeSlice, direction_at};
use crate::slice::SliceTable;
use crate::spline::{cell_centre, edge_cell_centre, edge_cell_weight};
use bake_runtime::chart::Chart;
use glam::DVec3;

/// Midpoints per pixel and side behind the raster of a smooth lobe.
const PIXEL_SUB: usize = 4;

/// Nodes per side of the lattice in the chart of a sharp lobe, which may be far narrower than a pixel.
const LATTICE: usize = 768;

/// Most points that are assigned exactly: the work grows with their square and more.
pub const EXACT_MAX: usize = 4096;

/// The map of `raster` on `side`² cells by any solver but [`Solver::Frame`].
///
/// # Errors
/// [`Error::Density`] for [`Solver::Frame`], which needs no raster, and for [`Solver::Exact`] of more than [`EXACT_MAX`]
/// points; [`Error::Interrupted`] when `tick` breaks.
pub fn image(raster: &Raster, solver: Solver, side: usize, seed: u64, tick: crate::Tick) -> Result<MapImage> {
    match solver {
        Solver::Marginal => Ok(marginal::solve(raster, side)),
        Solver::Hierarchical => Ok(hierarchical::solve(raster, side)),
        Solver::SinkhornSliced => Ok(sinkhorn_sliced::solve(raster, side, seed, tick)?.map),
        Solver::Exact if side * side > EXACT_MAX => Err(Error::Density {
            reason: format!(
                "{} points are too many for an exact assignment; at most {EXACT_MAX}",
                side * side
            ),
        }),
        Solver::Exact => Ok(exact(&sinkhorn_sliced::solve(raster, side, seed, tick)?)?.0),
        Solver::Frame => Err(Error::Density {
            reason: "the solver `frame` starts from a slice, not from its raster".into(),
        }),
    }
}

/// The exact assignment of the points of `near`, which it starts from, and its mean squared distance.
///
/// # Errors
/// As [`assignment::solve`].
pub fn exact(near: &sinkhorn_sliced::Solution) -> Result<(MapImage, f64)> {
    let side = near.map.side;
    let source = points::source_points(side);
    let solved = assignment::solve(&source, &near.points, Some(&near.duals[1]))?;
    let points = solved.permutation.iter().map(|j| near.points[*j]).collect();
    Ok((MapImage { side, points }, solved.cost))
}

/// The raster of a slice's luminance: its density on the disk in `side`² pixels of [−1, 1]².
///
/// # Errors
/// [`Error::Density`] when it is zero everywhere or not finite.
pub fn raster(slice: &LobeSlice, side: usize) -> Result<Raster> {
    let mut mass = vec![0.0; side * side];
    let fine = PIXEL_SUB * side;
    for k in 0..fine * fine {
        let [x, y] = points::to_disk(cell_centre(k, fine));
        let z2 = 1.0 - x * x - y * y;
        if z2 > 0.0 {
            // dω = dx dy / z, and [−1, 1]² has area 4.
            let z = z2.sqrt();
            let light = slice.f_cos(Lobe::Smooth, DVec3::new(x, y, z)).dot(LUMINANCE);
            mass[k / fine / PIXEL_SUB * side + k % fine / PIXEL_SUB] +=
                4.0 * light / z / (fine * fine) as f64;
        }
    }
    if let Some(chart) = slice.sharp_chart() {
        let nodes = LATTICE * LATTICE;
        let pixel = |v: f64| ((0.5 * (v + 1.0) * side as f64) as usize).min(side - 1);
        for k in 0..nodes {
            let (wi, area) = direction_at(&chart, edge_cell_centre(k, LATTICE));
            let light = slice.f_cos(Lobe::Sharp, wi).dot(LUMINANCE);
            mass[pixel(wi.y) * side + pixel(wi.x)] +=
                light * area * edge_cell_weight(k, LATTICE) / nodes as f64;
        }
    }
    Raster::new(side, &mass)
}

/// An entry of the database made by a solver on the disk: its `map` holds positions on [−1, 1]².
///
/// # Errors
/// As [`image`], [`raster`] and [`SliceTable::tabulate`].
pub fn solve(slice: &LobeSlice, solver: Solver, side: usize, seed: u64) -> Result<ChartMap> {
    let raster = raster(slice, side)?;
    let go_on = |_: u64, _: u64| std::ops::ControlFlow::Continue(());
    let made = image(&raster, solver, side, seed, &go_on)?;
    Ok(ChartMap {
        chart: Chart::IDENTITY,
        share: 1.0,
        table: SliceTable::tabulate(slice, Lobe::Whole, &Chart::IDENTITY, side)?,
        map: made.points.iter().map(|p| p.map(|v| v as f32)).collect(),
        potential: Vec::new(),
        residuals: Residuals::default(),
        fallback: false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::card::binned::BinnedSlice;
    use crate::card::bins::SIDE;
    use crate::lobes::WALKS;
    use bake_runtime::bsdf::direction;
    use bake_runtime::principled::{Principled, PrincipledParameters};
    use std::ops::ControlFlow;

    /// Midpoints of pixels at the rim, and lattice cells that a pixel's edge cuts.
    const RASTER_TOL: f64 = 0.01;

    fn slice(bsdf: &Principled) -> LobeSlice<'_> {
        LobeSlice::new(bsdf, direction(50.0, 0.0), WALKS, 0).expect("bright")
    }

    #[test]
    fn the_raster_is_the_reference_in_bins() {
        let bsdf = Principled::new(PrincipledParameters::default()).expect("valid parameters");
        let slice = slice(&bsdf);
        let raster = raster(&slice, SIDE).expect("bright");
        let truth = BinnedSlice::new(&bsdf, slice.wo, &slice.chart(Lobe::Sharp));
        let total: f64 = truth.mass.iter().sum();
        let distance: f64 = raster
            .mass
            .iter()
            .zip(&truth.mass)
            .map(|(a, b)| (a - b / total).abs())
            .sum();
        assert!(distance < RASTER_TOL, "{distance}");
    }

    #[test]
    fn what_a_solver_cannot_do_is_said() {
        let raster = Raster::new(4, &[1.0; 16]).expect("even");
        let go_on = |_: u64, _: u64| ControlFlow::Continue(());
        for (solver, side, word) in [(Solver::Exact, 128, "16384 points"), (Solver::Frame, 16, "slice")] {
            let error = image(&raster, solver, side, 1, &go_on)
                .expect_err("refused")
                .to_string();
            assert!(error.contains(word), "{error}");
        }
    }
}
