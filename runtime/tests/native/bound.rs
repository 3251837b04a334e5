//! Materials with bound parameters, on every tier, against the f64 oracle.

use crate::inverted::backend;
use bake_runtime::Error;
use bake_runtime::conformance::answers::ask;
use bake_runtime::conformance::cases::Case;
use bake_runtime::conformance::checks::assert_expected;
use bake_runtime::conformance::materials::Kind;
use bake_runtime::conformance::queries::Queries;
use bake_runtime::native::{NativeBackend, Tier};

/// Some roundings of a direction.
const BOUND_TOL: f32 = 1e-5;

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
fn bound_parameters_give_the_answers_of_free_ones() {
    let shares = |case: &&Case| case.queries.params.iter().any(|column| column.len() == 1);
    for case in Case::all().filter(shares) {
        for tier in Tier::available() {
            let (bound, left) = bound(&backend(&case.material, tier), &case.queries);
            let what = format!("{:?}, {tier:?}, bound", case.kind);
            assert_expected(&ask(&bound, &left), &case.expected, 1.0, &what);
        }
    }
}

#[test]
fn parameters_are_bound_by_finite_values_one_for_each() {
    let material = Kind::Free.build(1);
    let backend = backend(&material, Tier::best());
    assert!(matches!(
        backend.bind(&[Some(0.3)]),
        Err(Error::BatchLength {
            name: "params",
            expected: 3,
            found: 1
        })
    ));
    let error = backend
        .bind(&[Some(0.3), Some(f32::NAN), None])
        .err()
        .expect("not a number")
        .to_string();
    assert!(error.contains("params[1]"), "{error}");
    let bound = backend.bind(&[Some(0.3), None, Some(0.5)]).expect("one is left");
    let again = bound.bind(&[Some(0.1)]).expect("the last one");
    let whole = backend
        .bind(&[Some(0.3), Some(0.1), Some(0.5)])
        .expect("all of them");
    let queries = Queries::random(9, 100);
    // Folded in one go or one after the other: the bias is rounded once or twice.
    for (once, twice) in ask(&whole, &queries).wi[0]
        .iter()
        .zip(&ask(&again, &queries).wi[0])
    {
        assert!((once - twice).abs() < BOUND_TOL, "{once}, {twice}");
    }
}
