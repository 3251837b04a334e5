//! Every rule of the optimiser against slow references in double precision, written from the papers.

use bake_runtime::Rng;
use bake_train::optimiser::{Block, Kind, Optimiser, Rule, layout};

/// Layers (inputs, outputs) of the network: hidden matrices that are wide, square and tall.
const LAYERS: [(usize, usize); 5] = [(3, 7), (7, 5), (5, 5), (5, 9), (9, 2)];
/// Steps compared: past the five unrectified steps of RAdam, and eight steps of the slow weights.
const STEPS: u64 = 50;
/// Learning rate: after the steps, parameters have moved by about their own size.
const RATE: f64 = 0.02;
/// Largest difference of a parameter after all steps. Parameters, of order 1, collect the round-off of f32 over
/// [`STEPS`] steps.
const VALUE_TOL: f64 = 2e-6;
/// Largest difference of an element of an orthogonalised matrix of up to 128 × 128: f32 through fifteen products,
/// and the slope of the quintic.
const ORTHOGONAL_TOL: f64 = 1e-5;
/// How near a rate that falls to zero brings every rule to the minimum of a bowl without noise.
const BOWL_TOL: f32 = 1e-3;

/// A bowl around a random point, with noise: the gradient at `value` of step `step`.
fn gradient(value: &[f64], step: u64) -> Vec<f64> {
    let (mut target, mut noise) = (Rng::new(&[51]), Rng::new(&[52, step]));
    value
        .iter()
        .map(|v| v - (2.0 * target.uniform() - 1.0) + 0.5 * (2.0 * noise.uniform() - 1.0))
        .collect()
}

/// Kingma and Ba 2015, Algorithm 1, for one parameter, from all of its gradients up to now.
fn adam_step(history: &[f64], rate: f64) -> f64 {
    let (b1, b2, epsilon) = (0.9, 0.999, 1e-8);
    let t = history.len() as i32;
    let mean = |decay: f64, power: i32| -> f64 {
        let weighted = history.iter().rev().enumerate();
        let sum: f64 = weighted
            .map(|(age, g)| decay.powi(age as i32) * g.powi(power))
            .sum();
        sum * (1.0 - decay) / (1.0 - decay.powi(t))
    };
    rate * mean(b1, 1) / (mean(b2, 2).sqrt() + epsilon)
}

/// Liu et al. 2020, Algorithm 2, for one parameter, with the threshold and the ε of the released code: ε is added
/// to the root of the raw mean square, so that it counts 1/√(1 − β₂ᵗ) times against the corrected one.
fn rectified_step(history: &[f64], rate: f64) -> f64 {
    let (b1, b2, epsilon) = (0.95f64, 0.999f64, 1e-5);
    let t = history.len() as i32;
    let (mut m, mut v) = (0.0, 0.0);
    for g in history {
        m += (1.0 - b1) * (g - m);
        v += (1.0 - b2) * (g * g - v);
    }
    let m = m / (1.0 - b1.powi(t));
    let limit = 2.0 / (1.0 - b2) - 1.0;
    let rho = limit - 2.0 * f64::from(t) * b2.powi(t) / (1.0 - b2.powi(t));
    if rho <= 5.0 {
        return rate * m;
    }
    let r = ((rho - 4.0) * (rho - 2.0) * limit / ((limit - 4.0) * (limit - 2.0) * rho)).sqrt();
    let unbias = 1.0 / (1.0 - b2.powi(t)).sqrt();
    rate * r * m / (v.sqrt() * unbias + epsilon * unbias)
}

/// What the quintic iteration makes of `a`: the polynomial acts on the singular values, found by Jacobi rotations
/// of the columns of `a` (Hestenes 1958), and leaves the singular vectors alone.
fn orthogonalised(a: &[f64], rows: usize, columns: usize) -> Vec<f64> {
    const SWEEPS: usize = 30;
    let norm = a.iter().map(|v| v * v).sum::<f64>().sqrt();
    let mut turned: Vec<Vec<f64>> = (0..columns)
        .map(|j| (0..rows).map(|i| a[i * columns + j] / norm).collect())
        .collect();
    let mut turns: Vec<Vec<f64>> = (0..columns)
        .map(|j| (0..columns).map(|i| f64::from(u8::from(i == j))).collect())
        .collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    for _ in 0..SWEEPS {
        for p in 0..columns {
            for q in p + 1..columns {
                let (pp, qq) = (dot(&turned[p], &turned[p]), dot(&turned[q], &turned[q]));
                let angle = 0.5 * (2.0 * dot(&turned[p], &turned[q])).atan2(pp - qq);
                let (sin, cos) = angle.sin_cos();
                for pair in [&mut turned, &mut turns] {
                    for i in 0..pair[p].len() {
                        let (x, y) = (pair[p][i], pair[q][i]);
                        (pair[p][i], pair[q][i]) = (cos * x + sin * y, cos * y - sin * x);
                    }
                }
            }
        }
    }
    let mut result = vec![0.0; rows * columns];
    for (u, v) in turned.iter().zip(&turns) {
        let singular = dot(u, u).sqrt();
        let mut s = singular;
        for _ in 0..5 {
            s = 3.4445 * s - 4.775 * s.powi(3) + 2.0315 * s.powi(5);
        }
        // Columns that belong to no singular value are zero up to round-off.
        let factor = if singular > 1e-12 { s / singular } else { 0.0 };
        for i in 0..rows {
            for j in 0..columns {
                result[i * columns + j] += factor * u[i] * v[j];
            }
        }
    }
    result
}

/// What `rule` does to `value` in [`STEPS`] steps, in double precision, from the whole history of gradients.
fn reference(rule: Rule, blocks: &[Block], value: &[f32]) -> Vec<f64> {
    let mut value: Vec<f64> = value.iter().map(|v| f64::from(*v)).collect();
    let mut slow = value.clone();
    let mut history = vec![Vec::new(); value.len()];
    for step in 1..=STEPS {
        let mut g = gradient(&value, step);
        if rule == Rule::Ranger {
            for block in blocks.iter().filter(|b| b.kind != Kind::Bias) {
                for row in g[block.range()].chunks_exact_mut(block.columns) {
                    let mean = row.iter().sum::<f64>() / row.len() as f64;
                    row.iter_mut().for_each(|v| *v -= mean);
                }
            }
        }
        history.iter_mut().zip(&g).for_each(|(h, g)| h.push(*g));
        for block in blocks {
            if rule == Rule::Muon && block.kind == Kind::Hidden {
                let momentum: Vec<f64> = history[block.range()]
                    .iter()
                    .map(|h| h.iter().fold(0.0, |m, g| 0.9 * m + g))
                    .collect();
                let scale = RATE * (block.rows as f64 / block.columns as f64).sqrt().max(1.0);
                let turn = orthogonalised(&momentum, block.rows, block.columns);
                for (v, t) in value[block.range()].iter_mut().zip(turn) {
                    *v -= scale * t;
                }
                continue;
            }
            for k in block.range() {
                value[k] -= match rule {
                    Rule::Ranger => rectified_step(&history[k], RATE),
                    _ => adam_step(&history[k], RATE),
                };
            }
        }
        if rule == Rule::Ranger && step % 6 == 0 {
            for (s, v) in slow.iter_mut().zip(&mut value) {
                *s = 0.5 * *s + 0.5 * *v;
                *v = *s;
            }
        }
    }
    value
}

fn start(blocks: &[Block]) -> Vec<f32> {
    let mut rng = Rng::new(&[53]);
    let count = blocks.iter().map(|b| b.rows * b.columns).sum();
    (0..count).map(|_| 2.0 * rng.uniform() as f32 - 1.0).collect()
}

#[test]
fn every_rule_follows_its_reference() {
    let blocks = layout(&LAYERS);
    let value = start(&blocks);
    for rule in [Rule::Muon, Rule::Adam, Rule::Ranger] {
        let mut optimiser = Optimiser::new(rule, blocks.clone(), value.clone());
        for step in 1..=STEPS {
            let here: Vec<f64> = optimiser.value.iter().map(|v| f64::from(*v)).collect();
            let slope: Vec<f32> = gradient(&here, step).into_iter().map(|g| g as f32).collect();
            optimiser.descend(&slope, RATE);
        }
        let expected = reference(rule, &blocks, &value);
        let worst = optimiser.value.iter().zip(&expected);
        let worst = worst.map(|(v, e)| (f64::from(*v) - e).abs()).fold(0.0, f64::max);
        assert!(worst < VALUE_TOL, "{rule:?}: {worst}");
    }
}

#[test]
fn muon_steps_along_orthogonalised_momentum() {
    for (rows, columns) in [(1, 1), (16, 16), (33, 20), (20, 33), (64, 64), (128, 128)] {
        let mut rng = Rng::new(&[54, rows as u64, columns as u64]);
        let slope: Vec<f32> = (0..rows * columns).map(|_| rng.uniform() as f32 - 0.5).collect();
        let block = Block {
            offset: 0,
            rows,
            columns,
            kind: Kind::Hidden,
        };
        let mut optimiser = Optimiser::new(Rule::Muon, vec![block], vec![0.0; rows * columns]);
        optimiser.descend(&slope, 1.0);
        let wide: Vec<f64> = slope.iter().map(|g| f64::from(*g)).collect();
        let scale = (rows as f64 / columns as f64).sqrt().max(1.0);
        let expected = orthogonalised(&wide, rows, columns);
        let worst = optimiser.value.iter().zip(&expected);
        let worst = worst.map(|(v, e)| (f64::from(*v) + scale * e).abs());
        let worst = worst.fold(0.0, f64::max);
        assert!(worst < ORTHOGONAL_TOL, "{rows} × {columns}: {worst}");
    }
}

#[test]
fn every_rule_finds_the_minimum_of_a_bowl() {
    let target = [0.5f32, -0.25, 0.75, 1.0];
    for (rule, columns, kind) in [
        (Rule::Muon, 2, Kind::Hidden),
        (Rule::Muon, 2, Kind::Outer),
        (Rule::Adam, 2, Kind::Outer),
        (Rule::Ranger, 1, Kind::Bias),
    ] {
        let block = Block {
            offset: 0,
            rows: 4 / columns,
            columns,
            kind,
        };
        let mut optimiser = Optimiser::new(rule, vec![block], vec![0.0; 4]);
        for step in 0..2000 {
            let slope: Vec<f32> = optimiser.value.iter().zip(&target).map(|(v, t)| v - t).collect();
            optimiser.descend(&slope, 0.02 * (1.0 - step as f64 / 2000.0));
        }
        let worst = optimiser.value.iter().zip(&target).map(|(v, t)| (v - t).abs());
        assert!(worst.fold(0.0, f32::max) < BOWL_TOL, "{rule:?}");
    }
}
