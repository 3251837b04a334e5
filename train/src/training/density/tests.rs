//! The evaluation loss leads to the mean of noisy values, where losses that are not linear in them lead elsewhere.

use super::*;
use crate::optimiser::Rule;
use crate::training::schedule::Schedule;
use bake_runtime::moments::Moments;
use bake_runtime::spec::Activation;
use glam::DVec3;
use std::f64::consts::PI;
use std::ops::ControlFlow;

/// Shape parameter of the log-normal noise: mean 1, median and mean logarithm at e^(−σ²/2) = 0.32.
const SIGMA: f64 = 1.5;
/// The other noise is mostly this, and else so large that the mean is 1: its median. Its mean logarithm is at 0.32, too.
const USUAL: f64 = 0.25;
/// How often it is more.
const RARELY: f64 = 1.0 / 16.0;
/// Values averaged for a mean gradient.
const DRAWS: usize = 1 << 18;
/// Standard errors allowed: 27 comparisons exceed 4.5 by chance once in 5000 runs.
const SIGMAS: f64 = 4.5;
/// Round-off of f32 in a few operations, relative to the largest of the numbers involved.
const ROUND_OFF: f32 = 1e-5;

/// Steps and batch of a training. Adam remembers the squares of its first gradients, which are large, for a thousand steps.
const STEPS: u64 = 2400;
/// See [`STEPS`].
const BATCH: usize = 1024;
/// The last quarter of the steps, whose learning rate falls to nothing, averages 3·10⁵ values of each place, whose relative
/// deviation is 2.9: a standard error of 0.005, of which there may be 4.5.
const TRAINED_TOL: f64 = 0.024;

/// Two places of two charts: the density of each frame, and the mean of f_cos over it. Blue is so weak that its error is
/// scaled by the brightest channel.
const DENSITY: [[f32; 2]; 2] = [[2.0, 0.5], [0.5, 3.0]];
/// See [`DENSITY`].
const RATIO: [[[f32; 3]; 2]; 2] = [
    [[1.0, 0.3, 0.05], [0.8, 0.8, 0.1]],
    [[0.8, 0.5, 0.1], [1.0, 0.4, 0.06]],
];

/// Skewed noise of mean 1: log-normal for the first chart, rarely large for the second.
fn noise(rng: &mut Rng) -> [f64; 2] {
    let [a, b] = rng.pair();
    let normal = (-2.0 * (1.0 - a).ln()).sqrt() * (2.0 * PI * b).cos();
    let rare = (1.0 - (1.0 - RARELY) * USUAL) / RARELY;
    let jump = if rng.uniform() < RARELY { rare } else { USUAL };
    [(SIGMA * normal - 0.5 * SIGMA * SIGMA).exp(), jump]
}

/// An evaluation at `place` whose f_cos are their means times `factors`.
fn evaluation(place: usize, charts: usize, factors: [f64; 2]) -> Evaluation {
    let mut value = Evaluation::default();
    for i in 0..charts {
        value.density[i] = DENSITY[place][i];
        value.level += DENSITY[place][i] / charts as f32;
        value.f_cos[i] = RATIO[place][i].map(|r| r * DENSITY[place][i] * factors[i] as f32);
    }
    value
}

/// The outputs whose f_cos are the means at `place`, times `factor`.
fn outputs(place: usize, factor: f32) -> [f32; 3 * CHARTS_MAX] {
    let flat = RATIO[place].as_flattened();
    std::array::from_fn(|o| (factor * flat[o]).ln())
}

fn empty(charts: usize) -> EvalLoss {
    let batch = Evaluations {
        features: Vec::new(),
        values: Vec::new(),
    };
    EvalLoss {
        charts,
        width: 0,
        batch,
    }
}

fn slope(loss: &EvalLoss, value: &Evaluation, outputs: &[f32]) -> [f32; 3 * CHARTS_MAX] {
    let mut gradient = [0.0; 3 * CHARTS_MAX];
    loss.of(value, outputs, &mut gradient);
    gradient
}

/// What makes it unbiased under any noise whatever: the mean of the gradients is the gradient at the mean, and that is 0.
#[test]
fn the_gradient_is_linear_in_the_target_and_zero_at_it() {
    for (place, charts) in [(0, 1), (1, 1), (0, 2), (1, 2)] {
        let loss = empty(charts);
        for factor in [0.01, 0.7, 1.0, 30.0] {
            let own = outputs(place, factor);
            let at = |factors| slope(&loss, &evaluation(place, charts, factors), &own);
            let (low, middle, high) = (at([0.0, 8.0]), at([20.0, 5.0]), at([40.0, 2.0]));
            for o in 0..3 * charts {
                let size = low[o].abs().max(high[o].abs());
                let bend = middle[o] - 0.5 * (low[o] + high[o]);
                assert!(bend.abs() < ROUND_OFF * size, "{low:?} {middle:?} {high:?}");
                assert!(low[o] != high[o], "output {o} learns nothing");
                let there = at([factor.into(); 2]);
                assert!(there[o].abs() < ROUND_OFF * size, "{there:?}");
            }
        }
    }
}

/// Mean and standard error of `value`, a number per draw.
fn mean(mut value: impl FnMut() -> f64) -> (f64, f64) {
    let mut moments = Moments::default();
    (0..DRAWS).for_each(|_| moments.add(DVec3::splat(value())));
    let found = moments.estimate();
    (found.mean.x, found.se.x)
}

#[test]
fn gradients_of_noisy_values_vanish_at_the_mean_alone() {
    for (place, charts) in [(0, 1), (0, 2), (1, 2)] {
        let loss = empty(charts);
        for o in 0..3 * charts {
            let at = |factor: f32| {
                let mut rng = Rng::new(&[0xde25, place as u64, o as u64]);
                let own = outputs(place, factor);
                mean(|| slope(&loss, &evaluation(place, charts, noise(&mut rng)), &own)[o].into())
            };
            let (found, se) = at(1.0);
            assert!(found.abs() < SIGMAS * se, "output {o}: {found} ± {se}");
            // A tenth away it pulls back.
            for (factor, sign) in [(0.9, -1.0), (1.1, 1.0)] {
                let (found, se) = at(factor);
                assert!(sign * found > SIGMAS * se, "output {o}, {factor}: {found} ± {se}");
            }
        }
    }
}

/// Why the scale counts as a constant: the loss itself falls towards E f²/E f.
#[test]
fn the_scale_differentiated_as_well_would_lead_above_the_mean() {
    let loss = empty(1);
    let h = 1e-2f32;
    let mut rng = Rng::new(&[0x5ca1e]);
    let (found, se) = mean(|| {
        let value = evaluation(0, 1, noise(&mut rng));
        let at = |factor: f32| loss.of(&value, &outputs(0, factor), &mut [0.0; 3]);
        (at(1.0 + h) - at(1.0 - h)) / f64::from(2.0 * h)
    });
    assert!(found < -SIGMAS * se, "{found} ± {se}");
}

/// The slope of another loss by the logarithm of a prediction, from the prediction and its target.
type Rival = fn(f32, f32) -> f32;

/// L1 relative to the prediction, which counts as a constant: leads to the median.
const L1: Rival = |predicted, target| (predicted - target).signum();
/// Squared difference of logarithms: leads to the mean logarithm.
const LOG: Rival = |predicted, target| 2.0 * (predicted / target).ln();

/// The evaluation loss, or a rival on the same values.
struct Trial {
    own: EvalLoss,
    rival: Option<Rival>,
}

impl TileLoss for Trial {
    #[inline(always)]
    fn features<S: Simd>(&self, simd: S, queries: Range<usize>, rows: &mut Features) {
        self.own.features(simd, queries, rows);
    }

    fn loss<S: Simd>(
        &self,
        simd: S,
        queries: Range<usize>,
        outputs: &Outputs,
        gradient: &mut OutputsMut,
    ) -> f64 {
        let Some(rival) = self.rival else {
            return self.own.loss(simd, queries, outputs, gradient);
        };
        for o in 0..3 * self.own.charts {
            let (i, c) = (o / 3, o % 3);
            for (k, value) in self.own.batch.values[queries.clone()].iter().enumerate() {
                let predicted = value.density[i] * outputs.plane(0, o)[k].exp();
                gradient.plane(0, o)[k] = rival(predicted, value.f_cos[i][c]);
            }
        }
        0.0
    }
}

/// What a network that is told the place alone learns of noisy values, new ones in every step: predicted over mean f_cos,
/// by place and output.
fn learned(rival: Option<Rival>) -> [[f64; 3 * CHARTS_MAX]; 2] {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let plan = Plan {
        stage: "eval",
        steps: STEPS,
        batch: BATCH,
        rate: 0.03,
        schedule: Schedule::WarmUpCosine,
        rule: Rule::Muon,
        seed: 1,
    };
    let count = 3 * CHARTS_MAX;
    let trainer = Trainer::new(plan, &[(2, count)], Activation::Silu, folder.path(), "").expect("no files");
    let draw = |_: u64, rng: &mut Rng| {
        let mut batch = Evaluations {
            features: Vec::with_capacity(2 * BATCH),
            values: Vec::with_capacity(BATCH),
        };
        for k in 0..BATCH {
            let place = k % 2;
            batch.features.extend([1.0 - place as f32, place as f32]);
            batch.values.push(evaluation(place, CHARTS_MAX, noise(rng)));
        }
        let own = EvalLoss {
            charts: CHARTS_MAX,
            width: 2,
            batch,
        };
        Ok((1, Trial { own, rival }))
    };
    let mlp = trainer
        .run(draw, &|_, _| ControlFlow::Continue(()))
        .expect("finite");
    let (weight, bias) = mlp.values.split_at(2 * count);
    [0, 1].map(|place: usize| {
        let means = RATIO[place].as_flattened();
        std::array::from_fn(|o| f64::from((weight[2 * o + place] + bias[o]).exp() / means[o]))
    })
}

#[test]
fn training_leads_to_the_mean_where_other_losses_lead_elsewhere() {
    let median = (-0.5 * SIGMA * SIGMA).exp();
    let logarithm = USUAL.powf(1.0 - RARELY) * ((1.0 - (1.0 - RARELY) * USUAL) / RARELY).powf(RARELY);
    for (rival, expected) in [
        (None, [1.0, 1.0]),
        (Some(L1), [median, USUAL]),
        (Some(LOG), [median, logarithm]),
    ] {
        for (place, found) in learned(rival).iter().enumerate() {
            for (o, found) in found.iter().enumerate() {
                let expected = expected[o / 3];
                assert!(
                    (found / expected - 1.0).abs() < TRAINED_TOL,
                    "place {place}, output {o}: {found}, not {expected}"
                );
            }
        }
    }
}
