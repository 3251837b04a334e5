//! Materials with queries, what the oracle answers to these, and what rounding may change of it: made once per process,
//! when first asked for, and shared by the tests of all backends.

use super::materials::Kind;
use super::queries::{Exact, Queries};
use super::rounding::{Expected, FLOOR, boost_condition, condition, expected, terms};
use crate::{BakedMaterial, oracle};
use std::sync::OnceLock;

/// Random queries per named kind, and per random specification.
const QUERIES: [usize; 2] = [2000, 100];
/// A random specification is asked every so many of the hard queries, which are as many specifications together.
const HARD_STEP: usize = 3;
/// Random specifications.
const SPECIFICATIONS: usize = 100;
/// Random specifications of checks that are not about numbers: each takes its own path through shapes, not through rounding.
const SPECIFICATIONS_OF_SHAPES: usize = 12;

/// A material, queries of it, and what these should give.
#[derive(Debug)]
pub struct Case {
    /// Its kind.
    pub kind: Kind,
    /// The material.
    pub material: BakedMaterial,
    /// Random queries first, then hard ones.
    pub queries: Queries,
    /// For every column of [`super::answers::Answers::columns`] one element per query.
    pub expected: Vec<Vec<Expected>>,
}

static CASES: [OnceLock<Case>; Kind::NAMED.len() + SPECIFICATIONS] =
    [const { OnceLock::new() }; Kind::NAMED.len() + SPECIFICATIONS];

impl Case {
    /// Every named kind and all random specifications: for what may be off by rounding.
    pub fn all() -> impl Iterator<Item = &'static Case> {
        (0..CASES.len()).map(Case::number)
    }

    /// Every named kind and some random specifications: for what holds to the last bit.
    pub fn some() -> impl Iterator<Item = &'static Case> {
        Case::all().take(Kind::NAMED.len() + SPECIFICATIONS_OF_SHAPES)
    }

    fn number(number: usize) -> &'static Case {
        CASES[number].get_or_init(|| {
            let seed = number as u64;
            let (kind, count, step) = match Kind::NAMED.get(number) {
                Some(kind) => (*kind, QUERIES[0], 1),
                None => {
                    let any = number - Kind::NAMED.len();
                    (Kind::Any(any as u64), QUERIES[1], HARD_STEP)
                }
            };
            let material = kind.build(100 + seed);
            let hard = Queries::hard();
            let hard = hard.select((number % step..hard.len()).step_by(step));
            let queries = Queries::random(200 + seed, count).and(hard);
            let queries = queries.with_params(&material, 300 + seed);
            Case {
                kind,
                expected: expected(&material, &queries, seed, answer, floors),
                material,
                queries,
            }
        })
    }
}

/// The oracle's answers, in the order of [`super::answers::Answers::columns`].
fn answer(material: &BakedMaterial, query: &Exact) -> Vec<f64> {
    let Exact { params, wo, wi, u } = query;
    let sample = oracle::sample(&material.sample, params, *wo, *u);
    let mut row = Vec::new();
    row.extend(sample.wi);
    row.extend(sample.weight);
    row.extend(sample.wi);
    row.push(oracle::jacobian(&sample, &material.pdf, params, *wo));
    row.extend(oracle::eval(&material.eval, params, *wo, *wi));
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
        of_jacobian *= condition(&material.pdf, query, sample.wi) * (row[9] / sample.jacobian).abs();
    }
    let mut floors = Vec::new();
    floors.extend(lights);
    floors.extend(row[3..6].iter().map(|v| FLOOR * v));
    floors.extend(lights);
    floors.push(FLOOR * of_jacobian);
    floors.extend(row[10..13].iter().map(|v| FLOOR * of_eval * v));
    floors.push(FLOOR * of_pdf * row[13]);
    floors
}
