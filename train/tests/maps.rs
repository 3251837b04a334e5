//! What the maps of the solver `frame` must reach, on slices of every family: where their samples fall, folds, and
//! how often a marginal map has to stand in.
//!
//! Truth comes from the reference models alone ([`BinnedSlice`]), never from a table that a map was solved from.

use bake_runtime::bsdf::direction;
use bake_runtime::chart::Chart;
use bake_runtime::field::Fields;
use bake_runtime::{Material, Reference};
use bake_train::card::binned::BinnedSlice;
use bake_train::card::bins::l1;
use bake_train::lobes::{LobeSlice, WALKS};
use bake_train::maps::{CELLS, Charts, Job, WALK_SEED, compute};
use bake_train::places;
use bake_train::transport::frame_map::{FrameMap, solve};
use bake_train::transport::{Solver, measure};
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::path::Path;

/// Cells per side of the maps that limits hold for.
const FINE: usize = 128;
/// R2 points behind a binning: their own discrepancy in 64² bins is then about 0.002.
const POINTS: u64 = 1 << 22;
/// Largest binning L1 up to [`STEEP_DEG`] and beyond it.
const BINNING_L1_MAX: [f64; 2] = [0.02, 0.05];
/// Polar angle of `wo` beyond which the second limit holds, degrees.
const STEEP_DEG: f64 = 75.0;
/// Largest share of the square that folds; as above.
const FOLDS_MAX: f64 = 1e-4;
/// Largest share of a limit that the floor of its measurement may take: beyond it, a limit says little about maps.
const FLOOR_SHARE: f64 = 0.25;

/// Slices of a family behind the share that falls back, and the largest such share.
const DRAWN: usize = 200;
const FALLBACKS_MAX: f64 = 0.02;

/// Azimuth of `wo`, degrees: no axis of the surface, nor the middle between two.
const PHI_DEG: f64 = 30.0;

/// What is measured on a slice.
#[derive(Debug)]
struct Measured {
    theta: f64,
    binning_l1: f64,
    floor: f64,
    folds: f64,
    fallback: bool,
}

impl Measured {
    /// The limit of its binning L1.
    fn limit(&self) -> f64 {
        BINNING_L1_MAX[usize::from(self.theta > STEEP_DEG)]
    }
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
    let maps = solve(&slice, &slice.fitted(), FINE, &[]).expect("bright lobes");
    let map = FrameMap::new(&maps);
    let truth = BinnedSlice::new(&bsdf, wo, &slice.sharp_chart().unwrap_or(Chart::IDENTITY));
    let counts = measure::count(POINTS, |u| truth.bins.index(map.direction(u).0));
    Measured {
        theta,
        binning_l1: l1(&counts, &truth.mass),
        floor: truth.floor(POINTS),
        folds: measure::fold_fraction(&map, FINE),
        fallback: maps.iter().any(|m| m.fallback),
    }
}

fn assert_limits(cases: &[(String, f64)]) {
    cases.par_iter().for_each(|(json, theta)| {
        let found = measured(json, *theta);
        assert!(!found.fallback, "{json}: {found:?}");
        assert!(found.binning_l1 <= found.limit(), "{json}: {found:?}");
        assert!(found.folds <= FOLDS_MAX, "{json}: {found:?}");
        assert!(found.floor <= FLOOR_SHARE * found.limit(), "{json}: {found:?}");
    });
}

/// Every roughness once in either stratum, the worst directions of a wider table first.
#[test]
fn conductors() {
    assert_limits(&[
        (conductor([0.1, 0.1]), 10.0),
        (conductor([0.1, 0.5]), 75.0),
        (conductor([0.01, 0.01]), 75.0),
        (conductor([0.3, 0.3]), 75.0),
        (conductor([0.001, 0.001]), 89.0),
        (conductor([0.01, 0.01]), 89.0),
        (conductor([0.1, 0.1]), 89.0),
        (conductor([0.3, 0.1]), 89.0),
        (conductor([0.1, 0.5]), 89.0),
        (conductor([1.0, 1.0]), 89.0),
        (conductor([0.01, 0.3]), 85.0),
    ]);
}

#[test]
fn layered_and_principled_surfaces() {
    assert_limits(&[
        (layered(0.05), 45.0),
        (layered(0.2), 89.0),
        (layered(0.5), 75.0),
        (layered(0.5), 85.0),
        (principled(0.1, 0.0), 75.0),
        (principled(0.5, 0.0), 89.0),
        (principled(1.0, 1.0), 45.0),
        (principled(0.5, 1.0), 85.0),
        (principled(0.1, 1.0), 89.0),
    ]);
}

/// Needles, thirty times as long as wide and seen from 87° on off their axes, are too much for Newton's method: a marginal map
/// stands in, says so, and keeps the limit.
#[test]
fn needles_next_to_the_horizon() {
    let needles = [
        ([0.01, 0.3], 89.0),
        ([0.3, 0.01], 87.0),
        ([0.03, 0.3], 89.0),
        ([0.05, 0.5], 87.0),
    ];
    let fallbacks = needles.par_iter().map(|(alpha, theta)| {
        let found = measured(&conductor(*alpha), *theta);
        assert!(found.binning_l1 <= found.limit(), "{alpha:?}: {found:?}");
        assert!(found.folds <= FOLDS_MAX, "{alpha:?}: {found:?}");
        usize::from(found.fallback)
    });
    assert!((1..=2).contains(&fallbacks.sum::<usize>()));
}

/// Over the whole domain of every family, up to 89.9°.
#[test]
fn few_drawn_slices_fall_back() {
    let free = |min: f64, max: f64| format!(r#"{{"min":{min},"max":{max}}}"#);
    let (unit, alpha) = (free(0.0, 1.0), free(0.01, 1.0));
    for json in [
        format!(r#"{{"family":"conductor","alpha":[{alpha},{alpha}],"reflectance":[{unit},{unit},{unit}]}}"#),
        format!(
            r#"{{"family":"layered","alpha":{},"eta":{},"sigma_t":{},"albedo":[{unit},{unit},{unit}],"base":[{unit},{unit},{unit}],"g":0}}"#,
            free(0.01, 0.6),
            free(1.2, 2.0),
            free(0.0, 5.0)
        ),
        format!(
            r#"{{"family":"principled","base_color":[{unit},{unit},{unit}],"metallic":{unit},"roughness":{},"specular":{unit}}}"#,
            free(0.1, 1.0)
        ),
    ] {
        let material = material(&json);
        let places = places::draw(&material, DRAWN, 1);
        let job = Job {
            material: &material,
            places: &places,
            drawn: "drawn",
            charts: Charts::Fitted,
            solver: Solver::Frame,
            cells: CELLS,
            seed: 1,
        };
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        let summary = compute(&job, folder.path(), &|_, _| ControlFlow::Continue(())).expect("bright slices");
        assert_eq!((summary.slices, summary.computed), (DRAWN, DRAWN));
        assert!(summary.strata.iter().all(|s| s.maps > 0), "{summary:?}");
        assert!(summary.fallback_share() <= FALLBACKS_MAX, "{json}: {summary:?}");
    }
}
