//! The family of a material: slices over its free inputs, each with its frame, its density table and its
//! importance map.
//!
//! Slices are numbered by a low-discrepancy sequence. Slice k starts its transport from the nearest slice of
//! the earlier half (indices below the largest power of two ≤ k), so that the tree of warm starts, and with
//! it every byte of the result, is the same for any number of threads.

use crate::Tick;
use crate::database;
use crate::error::{Error, Result};
use crate::nn::frame::FrameNetwork;
use crate::slice::{Lobe, LobeSlice, SliceTable, WALKS};
use crate::spline::{EdgeSpline, cell_centre};
use crate::transport::marginal::MarginalMap;
use crate::transport::potential::Potential;
use crate::transport::monge_ampere;
use bake_runtime::bsdf::shifted_r2;
use bake_runtime::chart::Chart;
use bake_runtime::conductor::Conductor;
use bake_runtime::encoding::grazing;
use bake_runtime::frame::{FRAME_OUTPUTS, Frame, mirror_anchor};
use glam::DVec3;
use rayon::prelude::*;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Cells per side of the density tables and of the maps (16·2^k, as the solver wants it).
pub const CELLS: usize = 64;

/// Share of a uniform density mixed into what transport sees: keeps the map's derivative bounded where the
/// BSDF vanishes. It only shapes the proposal; weights come from the true model.
pub const UNIFORM_SHARE: f64 = 0.02;

/// Seed of the walks: every slice uses the same numbers, so that their noise varies smoothly with `wo`.
const WALK_SEED: u64 = 0;

/// Largest polar angle of a training slice, degrees.
pub const THETA_MAX_DEG: f64 = 89.9;

/// Exponent of the draw of θ_o = θ_max·ξ^p: p < 1 puts more slices next to the horizon.
const THETA_EXPONENT: f64 = 0.7;

/// One slice with its map.
#[derive(Clone, Debug)]
pub struct MappedSlice {
    /// Camera direction, folded to x, y ≥ 0.
    pub wo: [f64; 3],
    /// The frame that the frame network predicts there.
    pub frame: Frame,
    /// The density in the frame's square.
    pub table: SliceTable,
    /// Images of the cell centres in the frame's square.
    pub map: Vec<[f32; 2]>,
    /// Potential of the transport, in f32 so that a resumed run warm-starts from the same numbers;
    /// empty where the marginal map stands in.
    pub potential: Vec<f32>,
    /// |c| of the solve, 0 for a fallback.
    pub constant: f64,
}

/// Directions of `count` training slices, folded to the quadrant x, y ≥ 0.
pub fn draw_directions(count: usize) -> Vec<[f64; 3]> {
    (0..count as u64)
        .map(|k| {
            let [a, b] = shifted_r2(k, [0.0; 2]);
            let theta = (THETA_MAX_DEG * a.powf(THETA_EXPONENT)).to_radians();
            let phi = 0.5 * std::f64::consts::PI * b;
            [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
        })
        .collect()
}

/// Fits the lobe frame of every direction; the targets of the frame network.
///
/// # Errors
/// [`Error::Interrupted`] when `tick` breaks.
pub fn fit_frames(
    bsdf: &Conductor,
    directions: &[[f64; 3]],
    tick: Tick,
) -> Result<Vec<[f64; FRAME_OUTPUTS]>> {
    let done = AtomicU64::new(0);
    directions
        .par_iter()
        .map(|&wo| {
            let anchor = mirror_anchor(wo, bsdf.alpha);
            // Single scattering decides the frame: one walk will do.
            let frame = LobeSlice::new(bsdf, DVec3::from_array(wo), 1, 0)?.linear_frame();
            advance(&done, directions.len(), tick)?;
            Ok(frame.to_outputs(anchor))
        })
        .collect()
}

fn advance(done: &AtomicU64, total: usize, tick: Tick) -> Result<()> {
    let count = done.fetch_add(1, Ordering::Relaxed) + 1;
    if tick(count, total as u64).is_break() {
        Err(Error::Interrupted)
    } else {
        Ok(())
    }
}

/// Solves one slice, warm-started from `near`.
fn solve(bsdf: &Conductor, wo: [f64; 3], frame: Frame, near: Option<&MappedSlice>) -> Result<MappedSlice> {
    let slice = LobeSlice::new(bsdf, DVec3::from_array(wo), WALKS, WALK_SEED)?;
    let table = SliceTable::tabulate(&slice, Lobe::Whole, &Chart::of_frame(frame), CELLS)?;
    let softened: Vec<f64> = table
        .luminance()
        .iter()
        .map(|q| (1.0 - UNIFORM_SHARE) * q + UNIFORM_SHARE)
        .collect();
    let logs: Vec<f64> = softened.iter().map(|q| q.ln()).collect();
    let potential: Option<Vec<f64>> = near
        .filter(|n| !n.potential.is_empty())
        .map(|n| n.potential.iter().map(|&v| f64::from(v)).collect());
    let narrow = |map: Vec<[f64; 2]>| map.iter().map(|p| p.map(|v| v.clamp(0.0, 1.0) as f32)).collect();
    Ok(
        match monge_ampere::solve(&logs, CELLS, potential.as_deref()) {
            Some(transport) => MappedSlice {
                wo,
                frame,
                table,
                map: narrow(images(&transport)),
                potential: transport.potential.iter().map(|&v| v as f32).collect(),
                constant: transport.constant.abs(),
            },
            None => MappedSlice {
                wo,
                frame,
                table,
                map: narrow(fallback_map(&EdgeSpline::new(&logs, CELLS))),
                potential: Vec::new(),
                constant: 0.0,
            },
        },
    )
}

/// Images of the cell centres.
fn images(transport: &monge_ampere::Transport) -> Vec<[f64; 2]> {
    let potential = Potential::new(transport.side, &transport.potential);
    (0..CELLS * CELLS)
        .map(|k| potential.at(cell_centre(k, CELLS)).image)
        .collect()
}

/// The marginal map at every cell centre.
fn fallback_map(log_q: &EdgeSpline) -> Vec<[f64; 2]> {
    let mass: Vec<f64> = (0..CELLS * CELLS)
        .map(|k| log_q.at(cell_centre(k, CELLS)).0.exp())
        .collect();
    let map = MarginalMap::new(&mass, CELLS);
    (0..CELLS * CELLS)
        .map(|k| map.at(cell_centre(k, CELLS)))
        .collect()
}

/// Index of the slice that slice `k` starts from: the nearest in feature space of the earlier half.
fn parent(directions: &[[f64; 3]], k: usize) -> Option<usize> {
    let earlier = if k == 0 { 0 } else { 1 << k.ilog2() };
    let here = grazing(directions[k]);
    let distance = |j: &usize| {
        grazing(directions[*j])
            .iter()
            .zip(&here)
            .map(|(a, b)| (a - b) * (a - b))
            .sum::<f64>()
    };
    (0..earlier).min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// Computes the slices and maps of `directions`, keeping finished shards in `folder` and taking up what is there.
///
/// # Errors
/// [`Error::Interrupted`] when `tick` breaks (finished shards stay), [`Error::Slice`] for a slice without energy,
/// [`Error::Checkpoint`] for a shard that cannot be used.
pub fn compute(
    bsdf: &Conductor,
    frames: &FrameNetwork,
    directions: &[[f64; 3]],
    folder: &Path,
    tick: Tick,
) -> Result<Vec<MappedSlice>> {
    let fingerprint = database::fingerprint(bsdf, frames, directions);
    let mut slices: Vec<MappedSlice> = Vec::with_capacity(directions.len());
    let done = AtomicU64::new(0);
    while slices.len() < directions.len() {
        let shard = slices.len() / database::SHARD_SLICES;
        let end = ((shard + 1) * database::SHARD_SLICES).min(directions.len());
        if let Some(stored) = database::load_shard(folder, shard, end - slices.len(), &fingerprint)? {
            done.fetch_add(stored.len() as u64, Ordering::Relaxed);
            slices.extend(stored);
            continue;
        }
        let first = slices.len();
        while slices.len() < end {
            // Indices up to the next power of two depend only on earlier halves, so they run side by side.
            let generation = slices.len().max(1).ilog2() + u32::from(!slices.is_empty());
            let stop = if slices.is_empty() {
                1
            } else {
                (1usize << generation).min(end)
            };
            let solved: Result<Vec<MappedSlice>> = (slices.len()..stop)
                .into_par_iter()
                .map(|k| {
                    let near = parent(directions, k).map(|j| &slices[j]);
                    let slice = solve(bsdf, directions[k], frames.predict(directions[k]), near)?;
                    advance(&done, directions.len(), tick)?;
                    Ok(slice)
                })
                .collect();
            slices.extend(solved?);
        }
        database::save_shard(folder, shard, &slices[first..], &fingerprint)?;
    }
    Ok(slices)
}

/// How many slices fell back to the marginal map, per stratum θ_o ≤ 75°, 75–85°, above.
pub fn fallbacks(slices: &[MappedSlice]) -> [(usize, usize); 3] {
    let mut counts = [(0, 0); 3];
    for slice in slices {
        let theta = slice.wo[2].acos().to_degrees();
        let stratum = usize::from(theta > 75.0) + usize::from(theta > 85.0);
        counts[stratum].0 += usize::from(slice.potential.is_empty());
        counts[stratum].1 += 1;
    }
    counts
}
