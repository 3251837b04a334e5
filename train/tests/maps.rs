//! What the maps of the solver `frame` must reach, on slices of every family: where their samples fall, folds, and
//! how often a marginal map has to stand in.
//!
//! Truth comes from the reference models alone ([`BinnedSlice`]), never from a table that a map was solved from.

use bake_runtime::bsdf::{direction, shifted_r2};
use bake_runtime::chart::Chart;
use bake_runtime::field::Fields;
use bake_runtime::{Material, Reference};
use bake_train::card::binned::BinnedSlice;
use bake_train::card::bins::{SIDE, l1};
use bake_train::lobes::{LUMINANCE, Lobe, LobeSlice, WALKS};
use bake_train::maps::{CELLS, Charts, Job, Summary, WALK_SEED, compute};
use bake_train::places;
use bake_train::transport::frame_map::{FrameMap, solve};
use bake_train::transport::map::ImportanceMap;
use bake_train::transport::{Solver, measure};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::path::Path;

/// Cells per side of the maps that limits hold for.
const FINE: usize = 128;
/// R2 points behind a binning: their own discrepancy in 64² bins is then about 0.002.
const POINTS: u64 = 1 << 22;
/// Points that one task bins.
const BLOCK: u64 = 1 << 14;
/// Largest binning L1 up to [`STEEP_DEG`] and beyond it: what the issue of these maps asks for.
const BINNING_L1_MAX: [f64; 2] = [0.02, 0.05];
/// Polar angle of `wo` beyond which the second limit holds, degrees.
const STEEP_DEG: f64 = 75.0;
/// Largest share of the square that folds; as above.
const FOLDS_MAX: f64 = 1e-4;
/// Largest share of a limit that the floor of its measurement may take: beyond it, a limit says little about maps.
const FLOOR_SHARE: f64 = 0.25;

/// Azimuth of `wo`, degrees: no axis of the surface, nor the middle between two.
const PHI_DEG: f64 = 30.0;

/// What is measured on a slice.
struct Measured {
    name: String,
    theta: f64,
    binning_l1: f64,
    floor: f64,
    folds: f64,
    fallbacks: usize,
}

fn material(json: &str) -> Material {
    let fields: Fields = serde_json::from_str(json).expect("valid JSON");
    Material::read("m", fields, Path::new("")).expect("known parameters")
}

fn conductor(alpha: [f64; 2]) -> String {
    format!(r#"{{"family":"conductor","alpha":{alpha:?},"reflectance":[1,0.782,0.344]}}"#)
}

fn layered(alpha: f64) -> String {
    format!(
        r#"{{"family":"layered","alpha":{alpha},"sigma_t":0.8,"albedo":[0.9,0.6,0.3],"base":[0.8,0.5,0.2],"g":0}}"#
    )
}

fn principled(roughness: f64, metallic: f64) -> String {
    format!(r#"{{"family":"principled","roughness":{roughness},"metallic":{metallic}}}"#)
}

fn measured(json: &str, theta: f64) -> Measured {
    let bsdf: Reference = material(json).bind(&[]).expect("nothing is free");
    let wo = direction(theta, PHI_DEG);
    let slice = LobeSlice::new(&bsdf, wo, WALKS, WALK_SEED).expect("a bright slice");
    let charts: Vec<_> = slice.charts().into_iter().map(|l| (l, slice.chart(l))).collect();
    let maps = solve(&slice, &charts, FINE, &[]).expect("bright lobes");
    let map = FrameMap::new(&maps);
    let truth = BinnedSlice::new(&bsdf, wo, &slice.sharp_chart().unwrap_or(Chart::IDENTITY));
    let counts = (0..POINTS / BLOCK)
        .into_par_iter()
        .map(|block| {
            let mut counts = vec![0u64; SIDE * SIDE];
            for i in block * BLOCK..(block + 1) * BLOCK {
                counts[truth.bins.index(map.direction(shifted_r2(i, [0.0; 2])).0)] += 1;
            }
            counts
        })
        .reduce(
            || vec![0; SIDE * SIDE],
            |a, b| a.iter().zip(b).map(|(a, b)| a + b).collect(),
        );
    Measured {
        name: json.to_string(),
        theta,
        binning_l1: l1(&counts, &truth.mass),
        floor: truth.floor(POINTS),
        folds: measure::fold_fraction(&map, FINE),
        fallbacks: maps.iter().filter(|m| m.fallback).count(),
    }
}

#[test]
fn explore() {
    let mut cases = Vec::new();
    for a in [[0.001, 0.001], [0.01, 0.01], [0.1, 0.1], [0.3, 0.3], [1.0, 1.0], [0.3, 0.1], [0.1, 0.5], [0.01, 0.3]] {
        cases.push(conductor(a));
    }
    for a in [0.05, 0.2, 0.5] {
        cases.push(layered(a));
    }
    for r in [0.1, 0.5, 1.0] {
        for m in [0.0, 1.0] {
            cases.push(principled(r, m));
        }
    }
    for json in cases {
        for theta in [10.0, 45.0, 75.0, 85.0, 89.0] {
            let clock = std::time::Instant::now();
            let m = measured(&json, theta);
            eprintln!(
                "{theta} bin {:.4} floor {:.4} folds {:.1e} fb {} {:.2}s {}",
                m.binning_l1,
                m.floor,
                m.folds,
                m.fallbacks,
                clock.elapsed().as_secs_f64(),
                m.name
            );
        }
    }
}
