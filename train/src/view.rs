//! What pictures of a database entry show: per chart the map, what it draws, what it should draw, and the weights.

use crate::card::bins::SIDE;
use crate::error::Result;
use crate::lobes::{LUMINANCE, Lobe, LobeSlice, WALKS, direction_at};
use crate::maps::{MappedSlice, WALK_SEED};
use crate::spline::cell_centre;
use crate::transport::frame_map::ChartMap;
use crate::transport::map::{ImportanceMap, MapImage};
use crate::transport::points::to_disk;
use crate::transport::{Solver, disk_map, measure};
use bake_runtime::Reference;
use glam::DVec3;
use rayon::prelude::*;

/// Cells per side of the picture of weights.
pub const WEIGHT_SIDE: usize = 128;

/// Midpoints per bin and side behind what belongs into a bin.
const BIN_SUB: usize = 4;

/// One chart of an entry.
pub struct ChartView {
    /// Positions on [−1, 1]² of the centres of [`SIDE`]² cells of its own unit square: the chart's square, or the disk for
    /// solvers without charts.
    pub map: Vec<[f64; 2]>,
    /// Whether [−1, 1]² is the disk of directions.
    pub disk: bool,
    /// Shares of samples in [`SIDE`]² bins of it.
    pub bins: Vec<f64>,
    /// Shares that belong there.
    pub reference: Vec<f64>,
    /// f_cos / pdf of the chart's lobe, RGB, at the centres of [`WEIGHT_SIDE`]² cells of its own unit square.
    pub weight: Vec<[f64; 3]>,
}

/// Looks at every chart of `entry`, a slice of `bsdf` made by `solver`.
///
/// # Errors
/// As [`LobeSlice::new`] and [`disk_map::raster`].
pub fn charts(bsdf: &Reference, entry: &MappedSlice, solver: Solver) -> Result<Vec<ChartView>> {
    let slice = LobeSlice::new(bsdf, DVec3::from_array(entry.wo), WALKS, WALK_SEED)?;
    if solver != Solver::Frame {
        return Ok(vec![on_disk(&slice, &entry.charts[0])?]);
    }
    let lobes = match entry.charts.len() {
        1 => vec![Lobe::Whole],
        _ => vec![Lobe::Sharp, Lobe::Smooth],
    };
    let views = entry.charts.iter().zip(lobes);
    Ok(views
        .map(|(chart, lobe)| in_square(&slice, chart, lobe))
        .collect())
}

/// A chart in its own square.
fn in_square(slice: &LobeSlice, chart: &ChartMap, lobe: Lobe) -> ChartView {
    let square = chart.square_map();
    let light = |s: [f64; 2]| {
        let (wi, area) = direction_at(&chart.chart, s);
        slice.f_cos(lobe, wi) * area
    };
    let cell = |v: f64| ((v * SIDE as f64) as usize).min(SIDE - 1);
    let counts = measure::count(measure::BINNING_POINTS, |u| {
        let (s, _) = square.at(u);
        cell(s[1]) * SIDE + cell(s[0])
    });
    let fine = SIDE * BIN_SUB;
    let lit: Vec<f64> = (0..fine * fine)
        .into_par_iter()
        .map(|k| light(cell_centre(k, fine)).dot(LUMINANCE))
        .collect();
    let mut reference = vec![0.0; SIDE * SIDE];
    for (k, light) in lit.iter().enumerate() {
        reference[k / fine / BIN_SUB * SIDE + k % fine / BIN_SUB] += light;
    }
    let total: f64 = reference.iter().sum();
    reference.iter_mut().for_each(|m| *m /= total);
    let weight = (0..WEIGHT_SIDE * WEIGHT_SIDE)
        .map(|k| {
            let (s, determinant) = square.at(cell_centre(k, WEIGHT_SIDE));
            (light(s) * determinant).to_array()
        })
        .collect();
    ChartView {
        map: (0..SIDE * SIDE)
            .map(|k| to_disk(square.at(cell_centre(k, SIDE)).0))
            .collect(),
        disk: false,
        bins: measure::shares(&counts, measure::BINNING_POINTS),
        reference,
        weight,
    }
}

/// The map of a solver without charts.
fn on_disk(slice: &LobeSlice, chart: &ChartMap) -> Result<ChartView> {
    let map = MapImage {
        side: chart.table.cells,
        points: chart.map.iter().map(|p| p.map(f64::from)).collect(),
    };
    let weight = |k: usize| {
        let u = cell_centre(k, WEIGHT_SIDE);
        let [x, y] = map.at(u);
        let z2 = 1.0 - x * x - y * y;
        if z2 <= 0.0 {
            return [0.0; 3];
        }
        // dω = dx dy / z; [−1, 1]² has four times the area of the unit square of u.
        let z = z2.sqrt();
        (slice.f_cos(Lobe::Whole, DVec3::new(x, y, z)) * (4.0 * map.determinant(u).abs() / z)).to_array()
    };
    Ok(ChartView {
        map: (0..SIDE * SIDE).map(|k| map.at(cell_centre(k, SIDE))).collect(),
        disk: true,
        bins: measure::shares(
            &measure::histogram(&map, measure::BINNING_POINTS),
            measure::BINNING_POINTS,
        ),
        reference: measure::reference_bins(&disk_map::raster(slice, SIDE)?),
        weight: (0..WEIGHT_SIDE * WEIGHT_SIDE).map(weight).collect(),
    })
}
