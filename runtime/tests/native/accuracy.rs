//! Every tier against the f64 oracle, and tiers against each other; materials with bound parameters as well.

use crate::materials::Kind;
use crate::queries::{Answers, Exact, Queries, backend, run};
use crate::rounding::{Expected, FLOOR, boost_condition, condition, expected, terms};
use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::{BakedMaterial, oracle};

/// Queries per named kind, and per random specification.
const QUERIES: [usize; 2] = [2000, 100];
/// Random specifications.
const SPECIFICATIONS: u64 = 100;

/// The oracle's answers, in the order of [`Answers::columns`], but for the exact densities.
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

/// Round-off that moves do not show, in the order of [`answer`]: what each column may be off by at least.
fn floors(material: &BakedMaterial, query: &Exact, row: &[f64]) -> Vec<f64> {
    let sample = oracle::sample(&material.sample, &query.params, query.wo, query.u);
    let boost = boost_condition(&material.sample, query, &sample);
    let lights = [FLOOR * boost, FLOOR * boost, FLOOR * boost * sample.wi[2]];
    let [of_eval, of_pdf] =
        [&material.eval, &material.pdf].map(|network| condition(network, query, query.wi));
    let mut of_jacobian = boost * terms(&material.sample, query, &sample);
    if material.pdf.spec.outputs() > 1 {
        of_jacobian *= condition(&material.pdf, query, sample.wi) * (row[15] / sample.jacobian).abs();
    }
    let mut floors = Vec::new();
    floors.extend(lights);
    floors.extend(row[3..6].iter().map(|v| FLOOR * v));
    floors.extend(lights);
    floors.extend(row[9..12].iter().map(|v| FLOOR * of_eval * v));
    floors.extend(lights);
    floors.push(FLOOR * of_jacobian);
    floors.push(FLOOR * of_pdf * row[16]);
    floors
}

/// Asserts that `found` is within `factor` tolerances of `reference`, whose default is the expected value.
fn check(found: &Answers, expected: &[Vec<Expected>], reference: Option<&Answers>, factor: f64, what: &str) {
    for (c, ((name, found), expected)) in found.columns().into_iter().zip(expected).enumerate() {
        assert_eq!(found.len(), expected.len());
        for (i, (&value, expected)) in found.iter().zip(expected).enumerate() {
            let reference = reference.map_or(expected.value, |answers| f64::from(answers.columns()[c].1[i]));
            let error = (f64::from(value) - reference).abs();
            assert!(
                error <= factor * expected.tolerance,
                "{what}, {name}, query {i}: {value} instead of {reference}, off by {:.2} tolerances",
                error / expected.tolerance
            );
        }
    }
}

/// The material with those parameters bound that all `queries` share, and the queries without them.
fn bound(backend: &NativeBackend, queries: &Queries) -> (NativeBackend, Queries) {
    let values = queries.params.iter().map(|column| match column[..] {
        [value] => Some(value),
        _ => None,
    });
    let bound = backend
        .bind(&values.collect::<Vec<_>>())
        .expect("finite values, as many as are free");
    let mut left = queries.clone();
    left.params.retain(|column| column.len() > 1);
    (bound, left)
}

#[test]
fn every_tier_agrees_with_the_oracle_and_with_the_others() {
    let named = Kind::NAMED.map(|kind| (kind, QUERIES[0]));
    let any = (0..SPECIFICATIONS).map(|number| (Kind::Any(number), QUERIES[1]));
    for (seed, (kind, count)) in (0..).zip(named.into_iter().chain(any)) {
        let material = kind.build(100 + seed);
        for queries in [Queries::random(200 + seed, count), Queries::hard()] {
            let queries = queries.with_params(&material, 300 + seed);
            let expected = expected(&material, &queries, seed, answer, floors);
            let mut before: Option<Answers> = None;
            for tier in Tier::available() {
                let answers = run(&backend(&material, tier), &queries);
                let what = format!("{kind:?}, {}", tier.name());
                check(&answers, &expected, None, 1.0, &what);
                let below = format!("{what} against the tier below");
                check(&answers, &expected, before.as_ref(), 2.0, &below);
                let (bound, left) = bound(&backend(&material, tier), &queries);
                check(
                    &run(&bound, &left),
                    &expected,
                    None,
                    1.0,
                    &format!("{what}, bound"),
                );
                before = Some(answers);
            }
        }
    }
}
