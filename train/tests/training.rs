//! What training computes with candle is what the runtime's oracle computes: positions, determinants, weights.

use bake_runtime::conductor::Conductor;
use bake_runtime::network::Dense;
use bake_runtime::{Family, Material, Network, NetworkSpec, Rng, Role, oracle};
use bake_train::database;
use bake_train::maps::{self, Charts, Job, MappedSlice};
use bake_train::nn::frame::FrameNetwork;
use bake_train::nn::mlp::Mlp;
use bake_train::training::data::TrainingSet;
use bake_train::training::sample::warp;
use bake_train::transport::Solver;
use std::ops::ControlFlow;

/// f32 through four layers and a sigmoid, against f64.
const POSITION_TOL: f64 = 2e-6;
/// The same through two tangents and a product of four factors, relative to their size.
const DET_TOL: f64 = 2e-5;
/// Training takes 1 − h by subtraction: next to the far edges that costs its round-off over 1 − u, twice.
const FAR_EDGE_TOL: f64 = 4.0 * f32::EPSILON as f64;
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

/// A frame network whose outputs are constant: the frame is the anchor with the roughness as its size.
fn constant_frames(spec: &NetworkSpec, bsdf: &Conductor) -> FrameNetwork {
    let layers = spec.frame_layers().into_iter().map(|(inputs, outputs)| Dense {
        weight: vec![0.0; inputs * outputs],
        bias: vec![0.0; outputs],
        inputs,
        outputs,
    });
    let mut layers: Vec<Dense> = layers.collect();
    let last = layers.last_mut().expect("at least one layer");
    last.bias[0] = bsdf.alpha[0].ln() as f32;
    last.bias[1] = bsdf.alpha[1].ln() as f32;
    FrameNetwork {
        layers,
        anchor_alpha: bsdf.alpha,
    }
}

/// The first `count` training slices in the frames of `frames`.
fn mapped(material: &Material, frames: &FrameNetwork, count: usize) -> Vec<MappedSlice> {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let places = maps::draw_directions(count);
    let job = Job {
        material,
        places: &places,
        drawn: "training directions",
        charts: Charts::Predicted(frames),
        solver: Solver::Frame,
        cells: maps::CELLS,
        seed: 1,
    };
    maps::compute(&job, folder.path(), &|_, _| ControlFlow::Continue(())).expect("bright slices");
    database::load(folder.path(), count, &job.fingerprint()).expect("just written")
}

#[test]
fn candle_and_the_oracle_agree_on_the_warp() {
    let material = vase();
    let bsdf = material.conductor().expect("fixed parameters");
    let spec = NetworkSpec::warp(Role::Sample, material, bsdf.alpha, vec![32; 4], vec![8]);
    let frames = constant_frames(&spec, &bsdf);
    let slices = mapped(&spec.material, &frames, 3);
    let set = TrainingSet::new(&slices);

    let mut rng = Rng::new(&[9]);
    let mlp = Mlp::random(&spec.layers(), &mut rng).expect("layers");
    let batch = set.draw(SAMPLES, &mut rng);
    let (h, det, _) = warp(&mlp, &set, &batch).expect("plain data");
    let h = h.to_vec2::<f32>().expect("two columns");
    let det = det.to_vec1::<f32>().expect("one column");

    let network = Network {
        spec,
        frame: frames.layers.clone(),
        net: mlp.to_dense().expect("plain data"),
    };
    for i in 0..SAMPLES {
        // The grazing features begin with the direction itself.
        let features = set.features[batch.slices[i]];
        let wo = [features[0], features[1], features[2]].map(f64::from);
        let truth = oracle::sample(&network, wo, batch.positions[i].map(f64::from));
        for (found, expected) in h[i].iter().zip(&truth.square) {
            assert!((f64::from(*found) - expected).abs() < POSITION_TOL);
        }
        let far_edge = batch.positions[i]
            .map(|u| 1.0 - f64::from(u))
            .into_iter()
            .fold(1.0, f64::min);
        let allowed = (DET_TOL + FAR_EDGE_TOL / far_edge) * truth.det.abs().max(1.0);
        let found = f64::from(det[i]);
        assert!(
            (found - truth.det).abs() < allowed,
            "{found} {} at {:?}",
            truth.det,
            batch.positions[i]
        );
    }
}

#[test]
fn maps_carry_edges_to_edges() {
    let material = vase();
    let bsdf = material.conductor().expect("fixed parameters");
    let spec = NetworkSpec::warp(Role::Sample, material, bsdf.alpha, vec![8], vec![8]);
    let frames = constant_frames(&spec, &bsdf);
    let slices = mapped(&spec.material, &frames, 2);
    let set = TrainingSet::new(&slices);
    for t in [0.1f32, 0.5, 0.9] {
        for (k, _) in slices.iter().enumerate() {
            assert_eq!(set.map_at(k, [0.0, t])[0], 0.0);
            assert_eq!(set.map_at(k, [1.0, t])[0], 1.0);
            assert_eq!(set.map_at(k, [t, 0.0])[1], 0.0);
            assert_eq!(set.map_at(k, [t, 1.0])[1], 1.0);
        }
    }
}
