//! What is no query: invalid ones among valid ones, numbers that no renderer should ask with, slices that do not fit.

use super::numbers::assert_finite;
use crate::Error;
use crate::conformance::answers::{Answers, Method, ask};
use crate::conformance::cases::Case;
use crate::conformance::materials::Kind;
use crate::conformance::queries::Queries;
use crate::conformance::{Make, Tolerance};

const NAN: f32 = f32::NAN;
const INFINITY: f32 = f32::INFINITY;
/// Directions that are not finite or not above the horizon.
const INVALID: [[f32; 3]; 12] = [
    [0.0, 0.6, -0.8],
    [1.0, 0.0, 0.0],
    [0.0, 0.0, -0.0],
    [0.0, 0.0, 0.0],
    [0.6, 0.8, -1e-20],
    [NAN, 0.0, 1.0],
    [0.0, NAN, 1.0],
    [0.0, 0.0, NAN],
    [INFINITY, 0.0, 1.0],
    [0.0, -INFINITY, 1.0],
    [0.0, 0.0, INFINITY],
    [NAN, NAN, NAN],
];
/// Every so many queries one is invalid, the first of them here: no two in one vector of sixteen, and one in its middle.
const STEP: usize = 17;
const FIRST: usize = 3;
/// Queries of a batch with invalid ones.
const AMONG: usize = STEP * INVALID.len();

/// u at and beyond the ends of their range.
const ODD_U: [f32; 8] = [
    0.0,
    1.0 - f32::EPSILON / 2.0,
    1.0,
    NAN,
    -1.0,
    2.0,
    INFINITY,
    -INFINITY,
];
/// Lengths of directions that are not unit: squares of the outer ones leave the range of f32.
const ODD_LENGTHS: [f32; 6] = [1e-30, 1e-10, 0.5, 2.0, 1e10, 1e30];
/// Values far outside of what parameters may be.
const ODD_VALUES: [f32; 4] = [-1.0, 1e30, 0.0, -1e30];
/// Queries of a batch of odd numbers: all pairs of u, and more than once all of the rest.
const ODD: usize = 192;

/// Queries of a batch whose slices do not fit.
const FITTING: usize = 8;
/// Written to what no call may touch.
const UNTOUCHED: f32 = 42.5;

/// A query with a direction that is not finite or not above the horizon, or a parameter that is not finite, gives zeros and
/// `wi` = (0, 0, 1); the others of its batch are answered as if it were valid.
///
/// # Panics
/// With the first answer that is not so.
pub fn invalid_queries_give_zeros_and_leave_their_neighbours_alone(make: Make, _: Tolerance) {
    let invalid = |i: usize| i % STEP == FIRST;
    for case in Case::some() {
        let backend = make(&case.material);
        let valid = case.queries.select((0..AMONG).map(|i| i % case.queries.len()));
        let expected = ask(&*backend, &valid);
        let check = |queries: &Queries, methods: &[Method], invalid: &dyn Fn(usize) -> bool, what: &str| {
            let what = format!("{:?}, invalid {what}", case.kind);
            assert_answers(&ask(&*backend, queries), &expected, methods, invalid, &what);
        };
        let (mut of_wo, mut of_wi) = (valid.clone(), valid.clone());
        for (k, direction) in INVALID.iter().enumerate() {
            for (c, &component) in direction.iter().enumerate() {
                of_wo.wo[c][STEP * k + FIRST] = component;
                of_wi.wi[c][STEP * k + FIRST] = component;
            }
        }
        check(&of_wo, &Method::ALL, &invalid, "wo");
        check(&of_wi, &[Method::Eval, Method::Pdf], &invalid, "wi");
        for p in 0..valid.params.len() {
            let mut of_params = valid.clone();
            let column = &mut of_params.params[p];
            if column.len() == 1 {
                column[0] = NAN;
                check(&of_params, &Method::ALL, &|_| true, "parameter of all queries");
                column_of(&mut of_params, p, valid.params[p][0]);
            }
            for k in 0..INVALID.len() {
                of_params.params[p][STEP * k + FIRST] = [NAN, INFINITY, -INFINITY][k % 3];
            }
            check(&of_params, &Method::ALL, &invalid, "parameter");
        }
    }
}

/// Gives parameter `p` of `queries` a column of `value`.
fn column_of(queries: &mut Queries, p: usize, value: f32) {
    queries.params[p] = vec![value; queries.len()];
}

/// Asserts that `found` are zeros and the normal for the queries that are `invalid` for these methods, and `expected` elsewhere.
fn assert_answers(
    found: &Answers,
    expected: &Answers,
    methods: &[Method],
    invalid: &dyn Fn(usize) -> bool,
    what: &str,
) {
    let (found, expected) = (found.columns(), expected.columns());
    for method in Method::ALL {
        let columns = method.columns();
        for c in columns.clone() {
            let (name, found) = found[c];
            let up = name.starts_with("wi") && c == columns.start + 2;
            for (i, found) in found.iter().enumerate() {
                let refused = methods.contains(&method) && invalid(i);
                let expected = match (refused, up) {
                    (true, true) => 1.0,
                    (true, false) => 0.0,
                    (false, _) => expected[c].1[i],
                };
                assert!(
                    *found == expected,
                    "{what}: {name} of query {i} is {found} instead of {expected}"
                );
            }
        }
    }
}

/// Answers are finite for any u, for directions that are not unit and for finite parameters outside of their ranges.
///
/// # Panics
/// With the first that is not.
pub fn odd_numbers_give_finite_answers(make: Make, _: Tolerance) {
    for case in Case::some() {
        let backend = make(&case.material);
        let plain = case.queries.select((0..ODD).map(|i| i % case.queries.len()));
        let (mut of_u, mut of_wo, mut of_wi) = (plain.clone(), plain.clone(), plain.clone());
        let mut of_params = plain;
        for i in 0..ODD {
            of_u.u[0][i] = ODD_U[i % ODD_U.len()];
            of_u.u[1][i] = ODD_U[i / ODD_U.len() % ODD_U.len()];
            let length = ODD_LENGTHS[i % ODD_LENGTHS.len()];
            (0..3).for_each(|c| of_wo.wo[c][i] *= length);
            (0..3).for_each(|c| of_wi.wi[c][i] *= length);
            for column in of_params.params.iter_mut().filter(|column| column.len() > 1) {
                column[i] = ODD_VALUES[i % ODD_VALUES.len()];
            }
        }
        let mut of_all = of_u.clone();
        (of_all.wo, of_all.wi) = (of_wo.wo.clone(), of_wi.wi.clone());
        of_all.params = of_params.params.clone();
        let odd = [
            (of_u, "u"),
            (of_wo, "wo"),
            (of_wi, "wi"),
            (of_params, "parameters"),
            (of_all, "everything"),
        ];
        for (queries, what) in odd {
            assert_finite(&ask(&*backend, &queries), &format!("{:?}, odd {what}", case.kind));
        }
    }
}

/// Slices that do not fit to the number of queries, or of parameters, are [`Error::BatchLength`] with the argument's name and
/// both lengths, and nothing is written.
///
/// # Panics
/// With the first call that does otherwise.
pub fn slices_of_wrong_length_are_named_and_nothing_is_written(make: Make, _: Tolerance) {
    let material = Kind::Free.build(0);
    let backend = make(&material);
    let fitting = Queries::random(0, FITTING).with_params(&material, 0);
    let free = fitting.params.len();
    let check = |method: Method, queries: &Queries, outputs: &mut Answers, [name, of]: [&str; 2], lengths| {
        let before = outputs.clone();
        match method.call(&*backend, queries, outputs) {
            Err(Error::BatchLength {
                name: named,
                expected,
                found,
            }) => assert_eq!((named, [expected, found]), (name, lengths), "{method:?}, {of}"),
            other => panic!("{method:?}, {of}: {other:?} instead of an error of `{name}`, {lengths:?}"),
        }
        assert_eq!(*outputs, before, "{method:?}, {of}: outputs were written to");
    };
    for length in [0, FITTING - 1, FITTING + 1] {
        for method in Method::ALL {
            let inputs = |name, change: &dyn Fn(&mut Queries), lengths| {
                let mut queries = fitting.clone();
                change(&mut queries);
                let mut outputs = Answers::filled(FITTING, UNTOUCHED);
                check(method, &queries, &mut outputs, [name, "inputs"], lengths);
            };
            let lengths = [FITTING, length];
            // The first column of wo says how many queries there are.
            for c in 1..3 {
                inputs("wo", &|q| q.wo[c].resize(length, 0.5), lengths);
            }
            for c in 0..3 {
                match method {
                    Method::Eval | Method::Pdf => inputs("wi", &|q| q.wi[c].resize(length, 0.5), lengths),
                    _ if c < 2 => inputs("u", &|q| q.u[c].resize(length, 0.5), lengths),
                    _ => {}
                }
            }
            for p in 0..free {
                inputs("params", &|q| q.params[p].resize(length, 0.5), lengths);
            }
            inputs("params", &|q| drop(q.params.pop()), [free, free - 1]);
            inputs("params", &|q| q.params.clear(), [free, 0]);
            inputs("params", &|q| q.params.push(vec![0.5]), [free, free + 1]);
            for c in method.columns() {
                let mut outputs = Answers::filled(FITTING, UNTOUCHED);
                let (name, column) = output(&mut outputs, method, c - method.columns().start);
                column.resize(length, UNTOUCHED);
                check(method, &fitting, &mut outputs, [name, "outputs"], lengths);
            }
        }
    }
}

/// Output `number` of `method`, and the argument that it belongs to.
fn output(answers: &mut Answers, method: Method, number: usize) -> (&'static str, &mut Vec<f32>) {
    match (method, number) {
        (Method::Learned, 0..3) => ("wi", &mut answers.wi[number]),
        (Method::Learned, _) => ("weight", &mut answers.weight[number - 3]),
        (Method::Jacobian, 0..3) => ("wi", &mut answers.wi_of_jacobian[number]),
        (Method::Jacobian, _) => ("jacobian", &mut answers.jacobian),
        (Method::Eval, _) => ("f_cos", &mut answers.f_cos[number]),
        (Method::Pdf, _) => ("pdf", &mut answers.pdf),
    }
}
