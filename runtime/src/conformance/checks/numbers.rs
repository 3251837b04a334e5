//! What is answered: the oracle's numbers, within what rounding explains, and never what no renderer can use.

use crate::conformance::answers::{Answers, ask};
use crate::conformance::cases::Case;
use crate::conformance::rounding::Expected;
use crate::conformance::{Make, Tolerance};

/// Factor on the weights of networks that saturate every clamp: of shifts, exponents, frames and shares.
const SATURATION: f32 = 1e4;

/// Every answer is the oracle's, within [`Tolerance::rounding`].
///
/// # Panics
/// With the answer that is furthest off, in tolerances.
pub fn agrees_with_the_oracle(make: Make, tolerance: Tolerance) {
    for case in Case::all() {
        let answers = ask(&*make(&case.material), &case.queries);
        assert_expected(
            &answers,
            &case.expected,
            tolerance.rounding,
            &format!("{:?}", case.kind),
        );
    }
}

/// Asserts that `found` are within `factor` tolerances of `expected`.
///
/// # Panics
/// With the answer that is furthest off, in tolerances; `what` says whose.
pub fn assert_expected(found: &Answers, expected: &[Vec<Expected>], factor: f64, what: &str) {
    let mut worst = (0.0, String::new());
    for ((name, found), expected) in found.columns().into_iter().zip(expected) {
        assert_eq!(found.len(), expected.len(), "{what}: {name}");
        for (i, (&found, Expected { value, tolerance })) in found.iter().zip(expected).enumerate() {
            // What is no number is infinitely far off.
            let error = (f64::from(found) - value).abs();
            let error = if error.is_nan() { f64::INFINITY } else { error };
            if error > worst.0 * tolerance {
                worst = (
                    error / tolerance,
                    format!("{name} of query {i} is {found} instead of {value}"),
                );
            }
        }
    }
    let (worst, place) = worst;
    assert!(worst <= factor, "{what}: {place}, off by {worst:.2} tolerances");
}

/// Outputs are finite, `wi` is unit and above the horizon, weights, values and densities are not negative; Jacobians may be.
///
/// # Panics
/// With the first answer that is not so.
pub fn directions_are_unit_and_everything_is_finite(make: Make, tolerance: Tolerance) {
    for case in Case::some() {
        let answers = ask(&*make(&case.material), &case.queries);
        assert_usable(&answers, tolerance, &format!("{:?}", case.kind));
    }
}

/// The same of networks whose outputs meet every clamp.
///
/// # Panics
/// With the first answer that is not so.
pub fn saturated_networks_stay_finite(make: Make, tolerance: Tolerance) {
    for case in Case::some() {
        let mut material = case.material.clone();
        for network in [&mut material.sample, &mut material.eval, &mut material.pdf] {
            let layers = network.net.iter_mut().chain(&mut network.frame);
            layers.for_each(|layer| layer.weight.iter_mut().for_each(|w| *w *= SATURATION));
        }
        let answers = ask(&*make(&material), &case.queries);
        assert_usable(&answers, tolerance, &format!("{:?}, saturated", case.kind));
    }
}

fn assert_usable(answers: &Answers, tolerance: Tolerance, what: &str) {
    assert_finite(answers, what);
    let signed = |name: &str| name == "jacobian" || name.starts_with("wi");
    for (name, column) in answers.columns().into_iter().filter(|(name, _)| !signed(name)) {
        if let Some(i) = column.iter().position(|v| *v < 0.0) {
            panic!("{what}: {name} of query {i} is {}", column[i]);
        }
    }
    for wi in [&answers.wi, &answers.wi_of_jacobian] {
        for i in 0..wi[0].len() {
            let w = wi.each_ref().map(|column| f64::from(column[i]));
            let length = (w[0] * w[0] + w[1] * w[1] + w[2] * w[2]).sqrt();
            assert!(
                (length - 1.0).abs() < tolerance.length && w[2] > 0.0,
                "{what}: wi of query {i} is {w:?}, of length {length}"
            );
        }
    }
}

/// Asserts that all answers are finite.
///
/// # Panics
/// With the first that is not; `what` says whose.
pub fn assert_finite(answers: &Answers, what: &str) {
    for (name, column) in answers.columns() {
        if let Some(i) = column.iter().position(|v| !v.is_finite()) {
            panic!("{what}: {name} of query {i} is {}", column[i]);
        }
    }
}
