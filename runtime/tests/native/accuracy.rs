//! Every tier against the f64 oracle, and tiers against each other.
//!
//! How much rounding may change a result is measured, not derived: the oracle answers the same query again after every
//! weight, parameter, direction and number has been moved by a rounding or two, and what that moves the answer by is what
//! single precision may be off by.

use crate::materials::Kind;
use crate::queries::{Answers, Exact, Queries, backend, run};
use bake_runtime::native::Tier;
use bake_runtime::spec::{Geometry, Roughness};
use bake_runtime::{BakedMaterial, Network, Rng, oracle};

/// Relative size of the moves, two roundings of f32.
const MOVE: f64 = 1.0 / (1u64 << 23) as f64;
/// Moved copies of every material: with few of them, none may happen to move an answer.
const COPIES: usize = 8;
/// Errors allowed over the largest change that moves made.
const MOVES_ALLOWED: f64 = 8.0;
/// Part of a value that it may be off by however little moves change it: some roundings of its last products.
const FLOOR: f64 = 2e-6;

/// `value` moved by up to [`MOVE`] of itself.
fn moved(value: f64, rng: &mut Rng) -> f64 {
    value * (1.0 + MOVE * (2.0 * rng.uniform() - 1.0))
}

fn moved_network(network: &Network, rng: &mut Rng) -> Network {
    let mut network = network.clone();
    for layer in network.frame.iter_mut().chain(&mut network.net) {
        for weight in layer.weight.iter_mut().chain(&mut layer.bias) {
            // Weights are f32 themselves: one step up or down, or none.
            *weight = match rng.uniform() {
                r if r < 1.0 / 3.0 => weight.next_up(),
                r if r < 2.0 / 3.0 => weight.next_down(),
                _ => *weight,
            };
        }
    }
    if let Geometry::Charts(charts) = &mut network.spec.geometry {
        for alpha in &mut charts.alpha {
            match alpha {
                Roughness::Fixed(value) | Roughness::Free { factor: value, .. } => {
                    *value = moved(*value, rng)
                }
            }
        }
    }
    network
}

fn moved_query(query: &Exact, rng: &mut Rng) -> Exact {
    let mut unit = |w: [f64; 3]| {
        let w = w.map(|c| moved(c, rng));
        let length = (w[0] * w[0] + w[1] * w[1] + w[2] * w[2]).sqrt();
        w.map(|c| c / length)
    };
    let (wo, wi) = (unit(query.wo), unit(query.wi));
    Exact {
        params: query.params.iter().map(|p| moved(*p, rng)).collect(),
        wo,
        wi,
        u: query.u.map(|u| moved(u, rng)),
    }
}

/// The oracle's answers, in the order of [`Answers::columns`].
fn answer(material: &BakedMaterial, query: &Exact) -> Vec<f64> {
    let Exact { params, wo, wi, u } = query;
    let sample = oracle::sample(&material.sample, params, *wo, *u);
    let mut row = Vec::new();
    row.extend(sample.wi);
    row.extend(sample.weight);
    row.extend(sample.wi);
    row.extend(oracle::eval(&material.eval, params, *wo, *wi));
    row.extend(sample.wi);
    row.push(oracle::jacobian(&sample, &material.pdf, params, *wo));
    row.push(oracle::pdf(&material.pdf, params, *wo, *wi).0);
    row
}

/// What an answer should be, and how far off it may be.
struct Expected {
    value: f64,
    tolerance: f64,
}

fn expected(material: &BakedMaterial, queries: &Queries, seed: u64) -> Vec<Vec<Expected>> {
    let mut rng = Rng::new(&[0x30fed, seed]);
    let copies: Vec<BakedMaterial> = (0..COPIES)
        .map(|_| BakedMaterial {
            sample: moved_network(&material.sample, &mut rng),
            eval: moved_network(&material.eval, &mut rng),
            pdf: moved_network(&material.pdf, &mut rng),
        })
        .collect();
    let mut columns: Vec<Vec<Expected>> = Vec::new();
    for i in 0..queries.len() {
        let query = queries.at(i);
        let row = answer(material, &query);
        let mut changes = vec![0.0f64; row.len()];
        for copy in &copies {
            let other = answer(copy, &moved_query(&query, &mut rng));
            for ((change, value), other) in changes.iter_mut().zip(&row).zip(other) {
                *change = change.max((value - other).abs());
            }
        }
        columns.resize_with(row.len(), Vec::new);
        for ((column, value), change) in columns.iter_mut().zip(row).zip(changes) {
            column.push(Expected {
                value,
                tolerance: MOVES_ALLOWED * change + FLOOR * value.abs(),
            });
        }
    }
    columns
}

/// Largest error in tolerances per column
#[test]
fn every_tier_agrees_with_the_oracle_and_with_the_others() {
    let named = Kind::NAMED.map(|kind| (kind, 1000));
    let any = (0..60).map(|number| (Kind::Any(number), 100));
    for (seed, (kind, count)) in named.into_iter().chain(any).enumerate() {
        let seed = seed as u64;
        let material = kind.build(100 + seed);
        for (which, queries) in [Queries::random(200 + seed, count), Queries::hard()]
            .into_iter()
            .enumerate()
        {
            let queries = queries.with_params(&material, 300 + seed);
            let expected = expected(&material, &queries, seed);
            for tier in Tier::available() {
                let answers = run(&mut backend(&material, tier), &queries);
                for ((name, found), expected) in answers.columns().into_iter().zip(&expected) {
                    let mut worst = (0.0, 0);
                    let mut sum = 0.0;
                    for (i, (found, e)) in found.iter().zip(expected).enumerate() {
                        let r = (f64::from(*found) - e.value).abs() / e.tolerance;
                        if !(r <= worst.0) {
                            worst = (r, i);
                        }
                        sum += r;
                    }
                    if !(worst.0 < 0.7) {
                        let i = worst.1;
                        println!(
                            "{kind:?} {which} {} {name}: {:.2} mean {:.3} at {i}: {} vs {} {:?}",
                            tier.name(),
                            worst.0,
                            sum / found.len() as f64,
                            found[i],
                            expected[i].value,
                            queries.at(i)
                        );
                    }
                }
            }
        }
    }
}
