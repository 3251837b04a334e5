//! The maps of a material: slices over its free inputs, each with its charts, densities and importance maps, in a
//! database that an interrupted run leaves whole.
//!
//! Slice k starts its transport from the nearest slice of the earlier half ([`crate::places::parent`]), so that the tree
//! of warm starts, and with it every byte of the result, is the same for any number of threads.

use crate::Tick;
use crate::charts::ChartsNetwork;
use crate::database::{self, SHARD_SLICES};
use crate::error::{Error, Result};
use crate::lobes::{Lobe, LobeSlice, WALKS};
use crate::places::{self, Place};
use crate::presets;
use crate::transport::frame_map::{self, ChartMap, UNIFORM_SHARE};
use crate::transport::{Solver, disk_map};
use bake_runtime::chart::Chart;
use bake_runtime::{Family, Material, Setting};
use glam::DVec3;
use rayon::prelude::*;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Cells per side of the density tables and of the maps that networks learn (16·2^k, as the solver wants it).
pub const CELLS: usize = 64;

/// Seed of the walks: every slice uses the same numbers, so that their noise varies smoothly with `wo`.
pub const WALK_SEED: u64 = 0;

/// One slice with its maps.
#[derive(Clone, Debug, PartialEq)]
pub struct MappedSlice {
    /// Values of the material's free scalars.
    pub parameters: Vec<f64>,
    /// Camera direction.
    pub wo: [f64; 3],
    /// One chart, or the sharp and the smooth lobe's.
    pub charts: Vec<ChartMap>,
    /// Error that removing the noise of a stochastic slice costs its density, over its albedo.
    pub smoothing_error: f64,
}

/// Where the charts of slices come from.
#[derive(Clone, Copy)]
pub enum Charts<'a> {
    /// Fitted to every slice, one or two.
    Fitted,
    /// Those that the network predicts, one for each of the family's [`presets::lobes`].
    Predicted(&'a ChartsNetwork),
}

/// What is computed.
#[derive(Clone, Copy)]
pub struct Job<'a> {
    /// The material.
    pub material: &'a Material,
    /// Where slices are made.
    pub places: &'a [Place],
    /// How `places` were drawn, in words; part of the fingerprint.
    pub drawn: &'a str,
    /// Where charts come from.
    pub charts: Charts<'a>,
    /// How maps are made. All but [`Solver::Frame`] map to positions on [−1, 1]² and know no charts.
    pub solver: Solver,
    /// Cells per side of tables and maps, 16·2^k.
    pub cells: usize,
    /// Seed of whatever is random in a solver.
    pub seed: u64,
}

/// What came out, per stratum θ_o ≤ 75°, 75–85°, above.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Maps.
    pub maps: usize,
    /// Maps that fell back to marginal inversion.
    pub fallbacks: usize,
    /// Maps onto a softened density.
    pub softened: usize,
}

/// What came out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Per stratum.
    pub strata: [Counts; 3],
    /// Slices.
    pub slices: usize,
    /// Slices that were computed in this run.
    pub computed: usize,
    /// Mean and largest error of removing the noise of stochastic slices.
    pub smoothing_error: [f64; 2],
}

impl Summary {
    fn add(&mut self, slice: &MappedSlice) {
        let theta = slice.wo[2].acos().to_degrees();
        let counts = &mut self.strata[usize::from(theta > 75.0) + usize::from(theta > 85.0)];
        for chart in &slice.charts {
            counts.maps += 1;
            counts.fallbacks += usize::from(chart.fallback);
            counts.softened += usize::from(chart.residuals.softened > 0.0);
        }
        let [mean, worst] = self.smoothing_error;
        self.slices += 1;
        self.smoothing_error = [
            mean + (slice.smoothing_error - mean) / self.slices as f64,
            worst.max(slice.smoothing_error),
        ];
    }

    /// Share of maps that fell back, of all.
    pub fn fallback_share(&self) -> f64 {
        let sum = |f: fn(&Counts) -> usize| self.strata.iter().map(f).sum::<usize>() as f64;
        sum(|c| c.fallbacks) / sum(|c| c.maps).max(1.0)
    }
}

/// A hash of `words`, for fingerprints.
pub fn hash(words: impl Iterator<Item = u64>) -> u64 {
    words.fold(0, |h: u64, w| {
        h.rotate_left(5).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ w
    })
}

impl Job<'_> {
    /// Largest number of charts of a slice: tables have room for them.
    pub fn charts_max(&self) -> usize {
        match (self.charts, self.solver, self.material.family) {
            (_, Solver::Frame, Family::Layered | Family::Principled) => 2,
            _ => 1,
        }
    }

    /// Everything that the numbers in a shard depend on, as JSON; the number of places does not matter.
    pub fn fingerprint(&self) -> String {
        let frames = match self.charts {
            Charts::Fitted => "fitted".into(),
            Charts::Predicted(network) => format!("predicted {:016x}", network.hash()),
        };
        let table = match self.material.get("file") {
            // A file that cannot be read stops the run before anything is computed.
            Some(Setting::File(path)) => {
                std::fs::read(path).map_or(0, |bytes| hash(bytes.into_iter().map(u64::from)))
            }
            _ => 0,
        };
        serde_json::json!({
            "format": database::FORMAT,
            "table": format!("{table:016x}"),
            "material": self.material,
            "parameters": self.material.free().into_iter().map(|(name, ..)| name).collect::<Vec<_>>(),
            "places": self.drawn,
            "charts": frames,
            "solver": self.solver.name(),
            "cells": self.cells,
            "walks": WALKS,
            "uniform_share": UNIFORM_SHARE,
            "seed": self.seed,
        })
        .to_string()
    }

    /// Makes the slice and the maps of place `k`, warm-started from `near`.
    fn solve(&self, k: usize, near: &[Vec<f32>]) -> Result<MappedSlice> {
        let Place { parameters, wo, .. } = &self.places[k];
        let bsdf = self.material.bind(parameters)?;
        let slice = LobeSlice::new(&bsdf, DVec3::from_array(*wo), WALKS, WALK_SEED)?;
        let charts = match (self.solver, self.charts) {
            (Solver::Frame, charts) => {
                let charts: Vec<(Lobe, Chart)> = match charts {
                    Charts::Fitted => slice.fitted(),
                    Charts::Predicted(network) => {
                        let predicted = network.predict(parameters, *wo).into_iter();
                        let lobes = presets::lobes(self.material.family).iter();
                        lobes
                            .zip(predicted)
                            .map(|(lobe, (_, chart))| (*lobe, chart))
                            .collect()
                    }
                };
                let near: Vec<Option<&[f32]>> = (0..charts.len())
                    .map(|i| match near.len() == charts.len() {
                        true => Some(&near[i][..]).filter(|phi| !phi.is_empty()),
                        false => None,
                    })
                    .collect();
                frame_map::solve(&slice, &charts, self.cells, &near)?
            }
            (solver, _) => vec![disk_map::solve(&slice, solver, self.cells, self.seed)?],
        };
        let albedo = charts.iter().map(|c| c.table.albedo()).sum();
        Ok(MappedSlice {
            parameters: parameters.clone(),
            wo: *wo,
            smoothing_error: slice.smoothing_error(albedo),
            charts,
        })
    }
}

/// Counts one more of `total` as done.
///
/// # Errors
/// [`Error::Interrupted`] when `tick` breaks.
pub(crate) fn advance(done: &AtomicU64, total: usize, tick: Tick) -> Result<()> {
    let count = done.fetch_add(1, Ordering::Relaxed) + 1;
    if tick(count, total as u64).is_break() {
        Err(Error::Interrupted)
    } else {
        Ok(())
    }
}

/// Computes the slices and maps of `job`, keeping finished shards in `folder` and taking up what is there; only
/// potentials stay in memory.
///
/// # Errors
/// [`Error::Interrupted`] when `tick` breaks (finished shards stay), [`Error::Slice`] for a slice without energy,
/// [`Error::Checkpoint`] for a shard that cannot be used.
pub fn compute(job: &Job, folder: &Path, tick: Tick) -> Result<Summary> {
    let fingerprint = job.fingerprint();
    let total = job.places.len();
    let mut summary = Summary::default();
    let mut potentials: Vec<Vec<Vec<f32>>> = Vec::with_capacity(total);
    let done = AtomicU64::new(0);
    let keep = |slice: &MappedSlice| slice.charts.iter().map(|c| c.potential.clone()).collect();
    while potentials.len() < total {
        let first = potentials.len();
        let shard = first / SHARD_SLICES;
        let end = ((shard + 1) * SHARD_SLICES).min(total);
        if let Some(stored) = database::load_shard(folder, shard, end - first, &fingerprint)? {
            done.fetch_add(stored.len() as u64, Ordering::Relaxed);
            stored.iter().for_each(|slice| summary.add(slice));
            potentials.extend(stored.iter().map(keep));
            continue;
        }
        let mut slices: Vec<MappedSlice> = Vec::with_capacity(end - first);
        while potentials.len() < end {
            // Indices up to the next power of two depend only on earlier halves, so they run side by side.
            let start = potentials.len();
            let generation = start.max(1).ilog2() + u32::from(start > 0);
            let stop = if start == 0 {
                1
            } else {
                (1usize << generation).min(end)
            };
            let solved: Result<Vec<MappedSlice>> = (start..stop)
                .into_par_iter()
                .map(|k| {
                    let near = places::parent(job.places, k).map_or(&[][..], |j| &potentials[j]);
                    let slice = job.solve(k, near)?;
                    advance(&done, total, tick)?;
                    Ok(slice)
                })
                .collect();
            let solved = solved?;
            potentials.extend(solved.iter().map(keep));
            slices.extend(solved);
        }
        database::save_shard(folder, shard, &slices, job.charts_max(), &fingerprint)?;
        summary.computed += slices.len();
        slices.iter().for_each(|slice| summary.add(slice));
    }
    Ok(summary)
}
