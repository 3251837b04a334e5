//! Training of flows: against plain Rust, differences, and itself on other numbers of threads.

use super::*;
use crate::card::fake::vase;
use crate::card::truth::Truth;
use crate::comparators::measure::measure;
use crate::comparators::realnvp::tests::random_flow;
use crate::error::Error;
use crate::maps::{self, Charts, Job};
use crate::{database, places, transport::Solver};
use bake_runtime::bsdf::direction;
use glam::DVec2;
use std::ops::ControlFlow;

/// f32 through four couplings, relative to logarithms of a few units.
const LOG_DENSITY_TOL: f64 = 2e-5;
/// Differences with step 1e-2 of a loss in f32.
const SLOPE_TOL: f64 = 2e-2;
/// What 150 steps of 1024 samples on eight slices reach on another slice: 0.20; untrained 1.38.
const TRAINED_L1: f64 = 0.3;

fn set(material: &Material, count: usize) -> FlowSet {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let places = places::draw(material, count, 1);
    let job = Job {
        material,
        places: &places,
        drawn: "training directions",
        charts: Charts::Fitted,
        solver: Solver::Frame,
        cells: 32,
        seed: 1,
    };
    maps::compute(&job, folder.path(), &|_, _| ControlFlow::Continue(())).expect("bright slices");
    let slices = database::load(folder.path(), count, &job.fingerprint()).expect("just written");
    FlowSet::new(material, &slices)
}

#[test]
fn plain_rust_computes_what_candle_does() {
    let flow = random_flow();
    let trained = Flow::new(&flow.couplings).expect("plain data");
    let mut rng = Rng::new(&[0xca]);
    for _ in 0..200 {
        let wo = direction(89.0 * rng.uniform(), 90.0 * rng.uniform());
        let x = DVec2::from_array(rng.pair().map(|u| 8.0 * u - 4.0));
        let features = flow.condition.features(&[], wo);
        let features: Vec<f32> = features.into_iter().map(|v| v as f32).collect();
        let points = Tensor::new(&[x.to_array().map(|v| v as f32)], &Device::Cpu).expect("plain data");
        let features =
            Tensor::from_vec(features, (1, flow.condition.width()), &Device::Cpu).expect("plain data");
        let found = trained
            .log_density(&points, &features)
            .and_then(|t| t.to_vec1::<f32>());
        let found = f64::from(found.expect("one number")[0]);
        let expected = flow.bind(&[], wo).log_density(x);
        assert!(
            (found - expected).abs() < LOG_DENSITY_TOL * expected.abs().max(1.0),
            "{found} {expected}"
        );
    }
}

#[test]
fn training_lowers_the_binning_error() {
    let material = vase();
    let set = set(&material, 8);
    let bsdf = material.reference().expect("fixed parameters");
    let truth = Truth::new(&bsdf, direction(50.0, 120.0)).expect("a bright slice");
    let after = |steps: u64| {
        let flow = trained(&set, 3, short(steps, 1024, 1)).expect("finite");
        let mut bound = flow.bind(&[], truth.wo);
        let errors = measure(&mut bound, &bsdf, &truth, 0).expect("it knows its density");
        errors.binning_l1
    };
    let (before, after) = (after(0), after(150));
    assert!(
        after < TRAINED_L1 && before > 3.0 * TRAINED_L1,
        "{before} {after}"
    );
}

fn short(steps: u64, batch: usize, seed: u64) -> Plan {
    Plan {
        batch,
        ..plan(steps, seed)
    }
}

fn trained(set: &FlowSet, couplings: usize, plan: Plan) -> Result<RealNvp> {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let go_on: Tick = &|_, _| ControlFlow::Continue(());
    train(set, couplings, plan, folder.path(), "", go_on)
}

#[test]
fn threads_and_interruptions_do_not_change_the_flow() {
    let set = set(&vase(), 2);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.expect("threads");
        pool.install(|| trained(&set, 2, short(4, 256, 5)))
            .expect("finite")
    };
    let whole = with(1);
    assert_eq!(whole, with(2));
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let part = |tick: Tick| train(&set, 2, short(4, 256, 5), folder.path(), "", tick);
    let stopped = part(&|done, _| match done {
        2 => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    });
    assert!(matches!(stopped, Err(Error::Interrupted)));
    let resumed = part(&|done, _| {
        assert!(done >= 2, "it began anew");
        ControlFlow::Continue(())
    });
    assert_eq!(resumed.expect("finite"), whole);
}

/// The oracle: differences of the loss.
#[test]
fn the_gradient_is_that_of_the_loss_tensor_by_tensor() {
    let set = set(&vase(), 2);
    let course = Course {
        set: &set,
        couplings: 2,
        batch: 256,
        seed: 3,
    };
    let values = course.start();
    let blocks = course.blocks();
    assert_eq!(blocks.last().map(|b| b.range().end), Some(values.len()));
    let mut gradient = vec![0.0; values.len()];
    course.slope(0, &values, &mut gradient).expect("plain data");
    let h = 1e-2;
    for block in blocks {
        let at = |side: f32| {
            let mut moved = values.clone();
            // Along the gradient of the block itself, whose derivative is its length.
            let length = length(&gradient[block.range()]);
            for k in block.range() {
                moved[k] += side * h * gradient[k] / length;
            }
            let mut unused = vec![0.0; values.len()];
            course.slope(0, &moved, &mut unused).expect("plain data")
        };
        let found = (at(1.0) - at(-1.0)) / f64::from(2.0 * h);
        let expected = f64::from(length(&gradient[block.range()]));
        assert!(
            (found - expected).abs() < SLOPE_TOL * (expected + 1e-2),
            "{block:?}: {found} {expected}"
        );
    }
}

fn length(v: &[f32]) -> f32 {
    v.iter().map(|x| x * x).sum::<f32>().sqrt()
}
