//! A training run can be broken off and resumed without a trace, and stops before it takes over what is not finite.

use bake_runtime::Rng;
use bake_runtime::simd::Simd;
use bake_runtime::spec::Activation;
use bake_train::fused::{Features, Outputs, OutputsMut, TileLoss};
use bake_train::optimiser::{Block, Rule, layout};
use bake_train::training::run::{CHECKPOINT_STEPS, CURVE_STEPS, HeldOut, Plan, Run};
use bake_train::training::schedule::Schedule;
use bake_train::training::trainer::Trainer;
use bake_train::{Error, Result};
use safetensors::SafeTensors;
use std::ops::{ControlFlow, Range};
use std::path::Path;

/// Past two checkpoints, ending between rows of the curve.
const STEPS: u64 = 2 * CHECKPOINT_STEPS + CURVE_STEPS / 2;
/// Steps at which runs are broken off: between rows, at a checkpoint, between steps of the slow weights.
const BREAKS: [u64; 3] = [CURVE_STEPS + 37, CHECKPOINT_STEPS, STEPS - 1];
/// A step at which a run goes wrong, past the first checkpoint.
const BAD_STEP: u64 = CHECKPOINT_STEPS + CURVE_STEPS + 9;

fn plan(rule: Rule) -> Plan {
    Plan {
        stage: "test",
        steps: STEPS,
        batch: 64,
        rate: 0.01,
        schedule: Schedule::FlatCosine,
        rule,
        seed: 7,
    }
}

fn blocks() -> Vec<Block> {
    layout(&[(3, 4), (4, 5), (5, 4), (4, 2)])
}

fn start(plan: Plan, folder: &Path, context: &str) -> Result<Run> {
    let end = blocks().last().expect("four layers").range().end;
    let mut rng = Rng::new(&[plan.seed]);
    let value = (0..end).map(|_| rng.uniform() as f32).collect();
    Run::new(plan, blocks(), value, folder, context)
}

/// A noisy bowl: its loss, and its slope.
fn bowl(step: u64, value: &[f32], gradient: &mut [f32]) -> Result<f64> {
    let mut rng = Rng::new(&[71, step]);
    let mut loss = 0.0;
    for (g, v) in gradient.iter_mut().zip(value) {
        *g = v - 0.5 + 0.1 * (rng.uniform() as f32 - 0.5);
        loss += 0.5 * f64::from(g.powi(2));
    }
    Ok(loss)
}

/// An error that is measured from the parameters alone.
fn distance(value: &[f32]) -> Result<Vec<f64>> {
    Ok(vec![value.iter().map(|v| f64::from((v - 0.5).abs())).sum()])
}

const HELD_OUT: HeldOut = HeldOut {
    names: &["distance"],
    measure: &distance,
};

fn go_on(_: u64, _: u64) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// The tensors of the checkpoint in `folder`, apart from the seconds, and the rows of its curve without them.
fn left(folder: &Path) -> (Vec<(String, Vec<u8>)>, Vec<String>) {
    let bytes = std::fs::read(folder.join("train-test.safetensors")).expect("a checkpoint");
    let file = SafeTensors::deserialize(&bytes).expect("a whole checkpoint");
    let tensors = file.tensors().into_iter();
    let mut tensors: Vec<_> = tensors.map(|(name, view)| (name, view.data().to_vec())).collect();
    tensors.retain(|(name, _)| name != "seconds");
    tensors.sort();
    let text = std::fs::read_to_string(folder.join("train-test.csv")).expect("a curve");
    let rows = text.lines().map(|line| {
        let mut fields: Vec<&str> = line.split(',').collect();
        fields.remove(1);
        fields.join(",")
    });
    (tensors, rows.collect())
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder can be made")
}

#[test]
fn a_run_in_pieces_is_the_run_in_one() {
    for rule in [Rule::Muon, Rule::Adam, Rule::Ranger] {
        let (whole, pieces) = (folder(), folder());
        let run = start(plan(rule), whole.path(), "").expect("nothing to resume");
        let expected = run.descend(bowl, HELD_OUT, &go_on).expect("a bowl");
        for stop in BREAKS {
            let run = start(plan(rule), pieces.path(), "").expect("its own checkpoint");
            let tick = |step: u64, _: u64| match step == stop {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            };
            let broken = run.descend(bowl, HELD_OUT, &tick);
            assert!(matches!(broken, Err(Error::Interrupted)), "{rule:?}");
        }
        let run = start(plan(rule), pieces.path(), "").expect("its own checkpoint");
        let found = run.descend(bowl, HELD_OUT, &go_on).expect("a bowl");
        assert_eq!(found, expected, "{rule:?}");
        let (left, right) = (left(whole.path()), left(pieces.path()));
        assert_eq!(left, right, "{rule:?}");
        let (tensors, rows) = left;
        let slow = tensors
            .iter()
            .find(|(name, _)| name == "slow")
            .expect("slow weights");
        assert_eq!(slow.1.is_empty(), rule != Rule::Ranger);
        // The header, one row per interval, and one at the end; errors at checkpoints and at the end.
        assert_eq!(rows.len() as u64, 1 + STEPS / CURVE_STEPS + 1);
        assert_eq!(rows.iter().filter(|row| !row.ends_with(',')).count(), 1 + 2 + 1);
    }
}

#[test]
fn rows_hold_the_mean_loss_and_the_rate() {
    let place = folder();
    let run = start(plan(Rule::Adam), place.path(), "").expect("nothing to resume");
    run.descend(|step, _, _| Ok(step as f64), HELD_OUT, &go_on)
        .expect("no slope");
    let (_, rows) = left(place.path());
    // Steps are counted from 0; the last row is the mean of half an interval.
    assert!(rows[1].starts_with("100,1e-2,4.95e1,"), "{}", rows[1]);
    assert!(rows[2].starts_with("200,1e-2,1.495e2,"), "{}", rows[2]);
    assert!(rows[11].starts_with("1050,"), "{}", rows[11]);
    assert!(rows[11].contains(",1.0245e3,"), "{}", rows[11]);
}

#[test]
fn what_is_not_finite_stops_the_run_and_is_not_saved() {
    type Fault = fn(f64, &mut [f32]) -> f64;
    let faults: [(&str, Fault); 5] = [
        ("the loss is", |_, _| f64::NAN),
        ("the loss is", |_, _| f64::INFINITY),
        ("the gradient is", |loss, gradient| {
            gradient[11] = f32::NAN;
            loss
        }),
        ("the gradient is", |loss, gradient| {
            gradient[0] = f32::NEG_INFINITY;
            loss
        }),
        // Its square is beyond f32.
        ("the optimiser's next state is", |loss, gradient| {
            gradient[0] = 1e30;
            loss
        }),
    ];
    let whole = folder();
    let run = start(plan(Rule::Adam), whole.path(), "").expect("nothing to resume");
    let expected = run.descend(bowl, HELD_OUT, &go_on).expect("a bowl");
    for (what, fault) in faults {
        let place = folder();
        let run = start(plan(Rule::Adam), place.path(), "").expect("nothing to resume");
        let slope = |step: u64, value: &[f32], gradient: &mut [f32]| {
            let loss = bowl(step, value, gradient)?;
            Ok(match step == BAD_STEP {
                true => fault(loss, gradient),
                false => loss,
            })
        };
        let error = run.descend(slope, HELD_OUT, &go_on).expect_err("a fault");
        let words = error.to_string();
        assert!(
            words.starts_with(&format!("test: {what} not finite at step {BAD_STEP}, ")),
            "{words}"
        );
        assert!(
            words.ends_with("the last good checkpoint, of 500 steps, is kept"),
            "{words}"
        );
        // The curve shows the way there; the checkpoint goes on as if nothing had happened.
        let (tensors, rows) = left(place.path());
        assert!(rows.last().expect("rows").starts_with("600,"), "{rows:?}");
        let step = tensors.iter().find(|(name, _)| name == "step").expect("a step");
        assert_eq!(step.1, CHECKPOINT_STEPS.to_le_bytes());
        let run = start(plan(Rule::Adam), place.path(), "").expect("its own checkpoint");
        let found = run.descend(bowl, HELD_OUT, &go_on).expect("a bowl");
        assert_eq!(found, expected);
        assert_eq!(left(place.path()), left(whole.path()));
    }
}

#[test]
fn a_run_that_fails_before_its_first_checkpoint_leaves_none() {
    let place = folder();
    let run = start(plan(Rule::Muon), place.path(), "").expect("nothing to resume");
    let error = run.descend(|_, _, _| Ok(f64::NAN), HELD_OUT, &go_on);
    let words = error.expect_err("a fault").to_string();
    let expected =
        "test: the loss is not finite at step 0, where the loss is NaN; no checkpoint had been written yet";
    assert_eq!(words, expected);
    assert!(!place.path().join("train-test.safetensors").exists());
}

/// A loss that is the output, with the slope that it claims to have.
struct Slope(f32);

impl TileLoss for Slope {
    fn features<S: Simd>(&self, _: S, queries: Range<usize>, rows: &mut Features) {
        for query in 0..queries.len() {
            rows.row(0, query).fill(1.0);
        }
    }

    fn loss<S: Simd>(&self, _: S, _: Range<usize>, outputs: &Outputs, gradient: &mut OutputsMut) -> f64 {
        gradient.plane(0, 0).fill(self.0);
        outputs.plane(0, 0).iter().map(|v| f64::from(*v)).sum()
    }
}

#[test]
fn a_network_whose_gradient_is_not_finite_does_not_move() {
    let place = folder();
    let layers = [(2, 3), (3, 1)];
    let trainer = Trainer::new(plan(Rule::Muon), &layers, Activation::Silu, place.path(), "")
        .expect("nothing to resume");
    let loss = |step: u64, _: &mut Rng| {
        let slope = if step == CHECKPOINT_STEPS + 3 {
            f32::NAN
        } else {
            1.0
        };
        Ok((1, Slope(slope)))
    };
    let error = trainer.run(loss, &go_on);
    let words = error.map(|_| ()).expect_err("a fault").to_string();
    assert!(
        words.starts_with("test: the gradient is not finite at step 503, where the loss is "),
        "{words}"
    );
    assert!(!words.contains("NaN"), "{words}");
    let (tensors, _) = left(place.path());
    let value = tensors
        .iter()
        .find(|(name, _)| name == "value")
        .expect("parameters");
    let (numbers, _) = value.1.as_chunks::<4>();
    assert!(numbers.iter().all(|v| f32::from_le_bytes(*v).is_finite()));
}

#[test]
fn a_checkpoint_of_another_run_is_refused_by_its_difference() {
    let place = folder();
    let own = plan(Rule::Adam);
    let context = |alpha: &str| format!("Material {{ {} alpha: {alpha} }}", "reflectance: 1, ".repeat(20));
    let run = start(own.clone(), place.path(), &context("0.3")).expect("nothing to resume");
    run.descend(bowl, HELD_OUT, &go_on).expect("a bowl");
    let refusal = |plan: Plan, context: &str| match start(plan, place.path(), context) {
        Err(error @ Error::Checkpoint { .. }) => error.to_string(),
        _ => panic!("the checkpoint of another run was taken"),
    };
    let cases = [
        (
            Plan {
                steps: 2000,
                ..own.clone()
            },
            "steps 1050 instead of 2000",
        ),
        (
            Plan {
                batch: 128,
                ..own.clone()
            },
            "batch 64 instead of 128",
        ),
        (
            Plan {
                rate: 0.5,
                ..own.clone()
            },
            "rate 0.01 instead of 0.5",
        ),
        (
            Plan {
                seed: 8,
                ..own.clone()
            },
            "seed 7 instead of 8",
        ),
        (
            Plan {
                rule: Rule::Ranger,
                ..own.clone()
            },
            "rule Adam instead of Ranger",
        ),
        (
            Plan {
                schedule: Schedule::Cosine,
                ..own.clone()
            },
            "schedule FlatCosine instead of Cosine",
        ),
        (
            Plan {
                steps: 1,
                seed: 8,
                ..own.clone()
            },
            "steps 1050 instead of 1; seed 7 instead of 8",
        ),
    ];
    for (plan, words) in cases {
        let found = refusal(plan, &context("0.3"));
        let whole = format!("it belongs to another training run: {words}; delete it to start over");
        assert!(found.ends_with(&whole), "{found}");
    }
    // Of long texts only the part that differs is shown.
    let found = refusal(own.clone(), &context("0.25"));
    assert!(
        found.contains("alpha: 0.3 }") && found.contains("alpha: 0.25 }"),
        "{found}"
    );
    assert!(found.contains("context …") && found.len() < 300, "{found}");

    let value = vec![0.0; layout(&[(3, 4), (4, 2)]).last().expect("two layers").range().end];
    let small = Run::new(
        own.clone(),
        layout(&[(3, 4), (4, 2)]),
        value,
        place.path(),
        &context("0.3"),
    );
    let words = small.map(|_| ()).expect_err("another network").to_string();
    assert!(
        words.contains("tensors 4×3 4×1 5×4") && words.contains("instead of 4×3 4×1 2×4"),
        "{words}"
    );

    let other = Plan {
        stage: "other",
        ..own
    };
    let file = |stage: &str| place.path().join(format!("train-{stage}.safetensors"));
    std::fs::copy(file("test"), file("other")).expect("the folder is writable");
    assert!(refusal(other, &context("0.3")).contains("stage test instead of other"));
}
