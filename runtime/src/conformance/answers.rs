//! What a backend answers to queries, and when two answers are the same.

use super::cases::Case;
use super::queries::{Queries, refs, slices};
use crate::{Backend, Result};

/// The methods of [`Backend`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// [`Backend::sample_learned`].
    Learned,
    /// [`Backend::sample_jacobian`].
    Jacobian,
    /// [`Backend::eval`].
    Eval,
    /// [`Backend::pdf`].
    Pdf,
}

impl Method {
    /// All of them.
    pub const ALL: [Method; 4] = [Method::Learned, Method::Jacobian, Method::Eval, Method::Pdf];

    /// Calls `backend` with what the method takes of `queries`, and puts what it gives into `answers`.
    ///
    /// # Errors
    /// Those of the backend.
    pub fn call(self, backend: &dyn Backend, queries: &Queries, answers: &mut Answers) -> Result<()> {
        let params = queries.columns();
        let points = queries.points(&params);
        let (u, wi) = (refs(&queries.u), refs(&queries.wi));
        match self {
            Method::Learned => {
                let (wi, weight) = (slices(&mut answers.wi), slices(&mut answers.weight));
                backend.sample_learned(points, u, wi, weight)
            }
            Method::Jacobian => {
                let wi = slices(&mut answers.wi_of_jacobian);
                backend.sample_jacobian(points, u, wi, &mut answers.jacobian)
            }
            Method::Eval => backend.eval(points, wi, slices(&mut answers.f_cos)),
            Method::Pdf => backend.pdf(points, wi, &mut answers.pdf),
        }
    }

    /// The columns of [`Answers::columns`] that it fills.
    pub fn columns(self) -> std::ops::Range<usize> {
        match self {
            Method::Learned => 0..6,
            Method::Jacobian => 6..10,
            Method::Eval => 10..13,
            Method::Pdf => 13..14,
        }
    }
}

/// Everything that a backend answers: arrays with one element per query.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answers {
    /// Directions of [`Backend::sample_learned`].
    pub wi: [Vec<f32>; 3],
    /// Learned weights, RGB.
    pub weight: [Vec<f32>; 3],
    /// Directions of [`Backend::sample_jacobian`].
    pub wi_of_jacobian: [Vec<f32>; 3],
    /// Signed Jacobians, sr.
    pub jacobian: Vec<f32>,
    /// RGB, sr⁻¹.
    pub f_cos: [Vec<f32>; 3],
    /// Learned densities, sr⁻¹.
    pub pdf: Vec<f32>,
}

impl Answers {
    /// Room for `count` answers, filled with `value`.
    pub fn filled(count: usize, value: f32) -> Answers {
        let one = vec![value; count];
        let three = [one.clone(), one.clone(), one.clone()];
        Answers {
            wi: three.clone(),
            weight: three.clone(),
            wi_of_jacobian: three.clone(),
            jacobian: one.clone(),
            f_cos: three,
            pdf: one,
        }
    }

    /// All arrays with their names, in the order of the methods.
    pub fn columns(&self) -> Vec<(&'static str, &[f32])> {
        let all = [
            ("wi", &self.wi[..]),
            ("weight", &self.weight),
            ("wi of jacobian", &self.wi_of_jacobian),
            ("jacobian", std::slice::from_ref(&self.jacobian)),
            ("f_cos", &self.f_cos),
            ("pdf", std::slice::from_ref(&self.pdf)),
        ];
        let columns = all.into_iter().flat_map(|(name, columns)| {
            let named = move |column| (name, Vec::as_slice(column));
            columns.iter().map(named)
        });
        columns.collect()
    }
}

/// Asks `backend` everything, and expects an answer. What it leaves unwritten stays NaN, which no check lets pass.
///
/// # Panics
/// When a method returns an error.
pub fn ask(backend: &dyn Backend, queries: &Queries) -> Answers {
    let mut answers = Answers::filled(queries.len(), f32::NAN);
    for method in Method::ALL {
        let asked = method.call(backend, queries, &mut answers);
        asked.unwrap_or_else(|e| panic!("{method:?} of {} queries: {e}", queries.len()));
    }
    answers
}

/// Asserts that `found` are the bytes of `expected`.
///
/// # Panics
/// When they are not, with the first that differs; `what` says when.
pub fn assert_same_bytes(found: &Answers, expected: &Answers, what: &str) {
    for ((name, found), (_, expected)) in found.columns().into_iter().zip(expected.columns()) {
        assert_eq!(found.len(), expected.len(), "{what}: {name}");
        let differs = |(a, b): (&f32, &f32)| a.to_bits() != b.to_bits();
        if let Some(i) = found.iter().zip(expected).position(differs) {
            panic!("{what}: {name} of query {i} is {} and {}", found[i], expected[i]);
        }
    }
}

/// Asserts that `found` and `expected`, answers to the queries of `case` with these numbers, differ by at most `allowed`
/// times what rounding may change them by; with `allowed` = 0, that they are the same bytes.
///
/// # Panics
/// When they are not; `what` says when.
pub fn assert_same(
    case: &Case,
    numbers: impl Iterator<Item = usize>,
    [found, expected]: [&Answers; 2],
    allowed: f64,
    what: &str,
) {
    if allowed == 0.0 {
        return assert_same_bytes(found, expected, what);
    }
    let numbers: Vec<usize> = numbers.collect();
    let columns = found.columns().into_iter().zip(expected.columns());
    for (((name, found), (_, expected)), rounding) in columns.zip(&case.expected) {
        assert_eq!(
            [found.len(), expected.len()],
            [numbers.len(); 2],
            "{what}: {name}"
        );
        for ((a, b), i) in found.iter().zip(expected).zip(&numbers) {
            let apart = (f64::from(*a) - f64::from(*b)).abs();
            let tolerance = rounding[*i].tolerance;
            assert!(
                apart <= allowed * tolerance,
                "{what}: {name} of query {i} is {a} and {b}, {:.2} tolerances apart",
                apart / tolerance
            );
        }
    }
}
