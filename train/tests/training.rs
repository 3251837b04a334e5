//! What training computes is what the runtime's oracle computes: positions, determinants; and maps keep their edges.

use bake_runtime::network::Dense;
use bake_runtime::simd::Tier;
use bake_runtime::spec::SHARE_MIN;
use bake_runtime::{Family, Material, Network, NetworkSpec, Rng, Role, oracle};
use bake_train::charts::ChartsNetwork;
use bake_train::database;
use bake_train::fused::Fused;
use bake_train::maps::{self, Charts, Job, MappedSlice};
use bake_train::places;
use bake_train::presets::Preset;
use bake_train::training::data::TrainingSet;
use bake_train::training::mlp::Mlp;
use bake_train::training::sample::{Warp, u_features};
use bake_train::training::trainer::shape;
use bake_train::transport::Solver;
use std::ops::ControlFlow;

/// f32 through three layers, in a position of f64.
const POSITION_TOL: f64 = 2e-6;
/// The same through two tangents and a product of four factors, relative to their size.
const DET_TOL: f64 = 2e-5;
/// Training picks u in the chart's own square; the oracle finds it again from a u₀ that the share was put into.
const SPLIT_TOL: f64 = 1e-5;
/// Samples compared.
const SAMPLES: usize = 512;

fn vase() -> Material {
    Material::fixed(
        "vase",
        Family::Conductor,
        &[("alpha", &[0.3, 0.1]), ("reflectance", &[1.0, 0.782, 0.344])],
    )
    .expect("valid parameters")
}

fn plastic() -> Material {
    Material::fixed("plastic", Family::Principled, &[("roughness", &[0.3])]).expect("valid parameters")
}

/// A network of charts whose outputs are 0: the charts are the analytic ones, with equal shares.
fn analytic_charts(spec: &NetworkSpec) -> ChartsNetwork {
    let layers = spec.frame_layers().into_iter().map(|(inputs, outputs)| Dense {
        weight: vec![0.0; inputs * outputs],
        bias: vec![0.0; outputs],
        inputs,
        outputs,
    });
    ChartsNetwork {
        spec: spec.charts().expect("the warp preset has charts").clone(),
        symmetry: spec.symmetry,
        activation: spec.activation,
        layers: layers.collect(),
    }
}

/// The first `count` training slices in those charts.
fn mapped(material: &Material, charts: &ChartsNetwork, count: usize) -> Vec<MappedSlice> {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let places = places::draw(material, count, 1);
    let job = Job {
        material,
        places: &places,
        drawn: "training places",
        charts: Charts::Predicted(charts),
        solver: Solver::Frame,
        cells: maps::CELLS,
        seed: 1,
    };
    maps::compute(&job, folder.path(), &|_, _| ControlFlow::Continue(())).expect("bright slices");
    database::load(folder.path(), count, &job.fingerprint()).expect("just written")
}

#[test]
fn training_and_the_oracle_agree_on_the_warp() {
    for material in [vase(), plastic()] {
        let spec = Preset::Warp.spec(Role::Sample, &material).expect("can be baked");
        let charts = analytic_charts(&spec);
        let set = TrainingSet::new(mapped(&material, &charts, 3), &charts);
        let mut rng = Rng::new(&[9]);
        let mlp = Mlp::random(&spec.layers(), &mut rng);
        let picks = set.draw(SAMPLES, &mut rng);
        let shape = shape(&mlp.layers, spec.activation).expect("layers");
        let mut kernel = Fused::new(Tier::best(), shape, 3).expect("the best tier exists");
        let rows = u_features(&picks, &set.place_features(&spec));
        let outputs = kernel.forward(&mlp.values, &rows).expect("whole rows");
        let at = |column: usize, i: usize, c: usize| outputs[(column * SAMPLES + i) * 5 + c];
        let network = Network {
            spec,
            frame: charts.layers.clone(),
            net: mlp.to_dense(),
        };
        let mut compared = 0;
        for (i, pick) in picks.iter().enumerate() {
            let slopes = [0, 1].map(|c| [at(1, i, c), at(2, i, c)]);
            let warp = Warp::new(pick.at, [at(0, i, 0), at(0, i, 1)], slopes);
            let entry = &set.entries[pick.entry];
            let (share, _) = entry.own_chart();
            assert!((SHARE_MIN..=1.0).contains(&share));
            let start = if entry.chart == 0 { 0.0 } else { 1.0 - share };
            let u = pick.at.map(f64::from);
            let truth = oracle::sample(&network, &entry.params, entry.wo, [start + share * u[0], u[1]]);
            if truth.chart != entry.chart {
                continue;
            }
            compared += 1;
            let edge = u.map(|v| v.min(1.0 - v)).into_iter().fold(1.0, f64::min);
            let split = if entry.charts.len() > 1 { SPLIT_TOL } else { 0.0 };
            for (found, expected) in warp.h.iter().zip(&truth.square) {
                assert!(
                    (found - expected).abs() < POSITION_TOL + split,
                    "{found} {expected}"
                );
            }
            let allowed = (DET_TOL + split / edge) * truth.det.abs().max(1.0);
            let found = warp.det();
            assert!(
                (found - truth.det).abs() < allowed,
                "{found} {} at {u:?}",
                truth.det
            );
        }
        assert!(compared > SAMPLES - 4, "{compared}");
    }
}

#[test]
fn maps_carry_edges_to_edges() {
    let material = vase();
    let spec = Preset::Warp.spec(Role::Sample, &material).expect("can be baked");
    let charts = analytic_charts(&spec);
    let set = TrainingSet::new(mapped(&material, &charts, 2), &charts);
    assert_eq!(set.entries.len(), 2);
    for t in [0.1f32, 0.5, 0.9] {
        for entry in &set.entries {
            assert_eq!(entry.map_at([0.0, t])[0], 0.0);
            assert_eq!(entry.map_at([1.0, t])[0], 1.0);
            assert_eq!(entry.map_at([t, 0.0])[1], 0.0);
            assert_eq!(entry.map_at([t, 1.0])[1], 1.0);
        }
    }
}
