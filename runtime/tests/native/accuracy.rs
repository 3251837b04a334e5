//! Every tier against the f64 oracle, and tiers against each other.

use crate::materials::Kind;
use crate::queries::{Answers, Queries, backend, run};
use crate::rounding::{Expected, expected};
use bake_runtime::native::Tier;

/// Queries per named kind, and per random specification.
const QUERIES: [usize; 2] = [2000, 100];
/// Random specifications.
const SPECIFICATIONS: u64 = 100;

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

#[test]
fn every_tier_agrees_with_the_oracle_and_with_the_others() {
    let named = Kind::NAMED.map(|kind| (kind, QUERIES[0]));
    let any = (0..SPECIFICATIONS).map(|number| (Kind::Any(number), QUERIES[1]));
    for (seed, (kind, count)) in (0..).zip(named.into_iter().chain(any)) {
        let material = kind.build(100 + seed);
        for queries in [Queries::random(200 + seed, count), Queries::hard()] {
            let queries = queries.with_params(&material, 300 + seed);
            let expected = expected(&material, &queries, seed);
            let mut before: Option<Answers> = None;
            for tier in Tier::available() {
                let answers = run(&mut backend(&material, tier), &queries);
                let what = format!("{kind:?}, {}", tier.name());
                check(&answers, &expected, None, 1.0, &what);
                let below = format!("{what} against the tier below");
                check(&answers, &expected, before.as_ref(), 2.0, &below);
                before = Some(answers);
            }
        }
    }
}
