//! The Jacobian of every tier against central differences of where the oracle draws.

use crate::inverted::backend;
use bake_runtime::conformance::answers::ask;
use bake_runtime::conformance::materials::Kind;
use bake_runtime::conformance::queries::{Exact, Queries};
use bake_runtime::conformance::rounding::{boost_condition, condition, terms};
use bake_runtime::native::Tier;
use bake_runtime::oracle::OracleSample;
use bake_runtime::spec::Activation;
use bake_runtime::{BakedMaterial, oracle};

/// Queries of all kinds together.
const QUERIES: usize = 100_000;
/// Random specifications beside the named kinds.
const SPECIFICATIONS: u64 = 9;
/// Step of the differences, over the distance of u from where its chart ends, which it may not leave; of rectifiers, whose
/// kinks the step should seldom cross, the smaller one.
const STEP: f64 = 1e-5;
const STEP_OF_RECTIFIERS: f64 = 1e-8;
/// Differences to one side that are further than this from those to both, over their size, have a kink between them: of a
/// rectifier, or of a shift's clamp.
const KINK: f64 = 1e-3;
/// Largest share of queries that kinks may excuse: 2 % are bends of high frequencies.
const KINKS_MAX: f64 = 0.03;
/// Largest distance of a Jacobian from the differences, over the sum of its terms and how much its charts make of roundings.
/// Found: 4.5e-4, where the differences lose it to a kink; the oracle's own Jacobian is as far off.
const JACOBIAN_TOL: f64 = 1e-3;
/// The same for 99 of 100 queries of a kind. Found: 1.3e-5.
const USUAL_TOL: f64 = 5e-5;

/// ∂wi/∂u by central differences, as the signed area of the parallelogram on the sphere, sr; nothing at a kink.
fn differences(material: &BakedMaterial, query: &Exact, sample: &OracleSample) -> Option<f64> {
    let network = &material.sample;
    let relu = network.spec.activation == Activation::Relu;
    let step = if relu { STEP_OF_RECTIFIERS } else { STEP };
    // Mirroring wi to the side of wo turns the orientation, which the Jacobian leaves out.
    let (wo, turn) = oracle::fold(network.spec.symmetry, query.wo);
    let split = oracle::charts_of(network, &query.params, wo)[..]
        .first()
        .map_or(1.0, |(share, _)| *share);
    let at = |u| oracle::folded(turn, oracle::sample(network, &query.params, query.wo, u).wi);
    let n = oracle::folded(turn, sample.wi);
    let mut slopes = [[0.0; 3]; 2];
    for (j, slope) in slopes.iter_mut().enumerate() {
        let mut room = query.u[j].min(1.0 - query.u[j]);
        if j == 0 && split < 1.0 {
            room = room.min((query.u[j] - split).abs());
        }
        let mut u = [query.u; 2];
        u[0][j] -= step * room;
        u[1][j] += step * room;
        let [low, high] = u.map(at);
        *slope = std::array::from_fn(|c| (high[c] - low[c]) / (u[1][j] - u[0][j]));
        let bend = std::array::from_fn(|c| (high[c] - n[c]) / (u[1][j] - query.u[j]) - slope[c]);
        if length(bend) > KINK * length(*slope) {
            return None;
        }
    }
    let [a, b] = slopes;
    let cross = [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ];
    Some(n[0] * cross[0] + n[1] * cross[1] + n[2] * cross[2])
}

fn length(v: [f64; 3]) -> f64 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

#[test]
fn jacobians_are_the_differences_of_directions() {
    let kinds: Vec<Kind> = Kind::NAMED
        .into_iter()
        .chain((200..200 + SPECIFICATIONS).map(Kind::Any))
        .collect();
    let count = QUERIES.div_ceil(kinds.len());
    for (seed, kind) in (0..).zip(&kinds) {
        let material = kind.build(700 + seed);
        let queries = Queries::random(800 + seed, count).with_params(&material, 900 + seed);
        let tiers = Tier::available();
        let found: Vec<Vec<f32>> = tiers
            .iter()
            .map(|tier| ask(&backend(&material, *tier), &queries).jacobian)
            .collect();
        let mut errors = vec![Vec::new(); tiers.len()];
        for i in 0..queries.len() {
            let query = queries.at(i);
            let sample = oracle::sample(&material.sample, &query.params, query.wo, query.u);
            let Some(difference) = differences(&material, &query, &sample) else {
                continue;
            };
            let part = part(&material, &query, &sample);
            let scale = part.abs() * scale(&material, &query, &sample);
            for (errors, found) in errors.iter_mut().zip(&found) {
                let error = (f64::from(found[i]) - part * difference).abs();
                // Some specifications do not see u at all: there is nothing then, and nothing to divide by.
                errors.push(if error == 0.0 { 0.0 } else { error / scale });
            }
        }
        for (tier, errors) in tiers.iter().zip(&mut errors) {
            let kinks = count - errors.len();
            assert!(
                kinks as f64 <= KINKS_MAX * count as f64,
                "{kind:?}: {kinks} of {count} queries lie at kinks"
            );
            errors.sort_by(f64::total_cmp);
            let (usual, worst) = (errors[errors.len() * 99 / 100], errors[errors.len() - 1]);
            assert!(
                usual <= USUAL_TOL && worst <= JACOBIAN_TOL,
                "{kind:?}, {tier:?}: off by {worst:e} of their terms, 99 of 100 by less than {usual:e}"
            );
        }
    }
}

/// The part of the drawn chart in the density of both, which the backend's Jacobian has beside that of the map.
fn part(material: &BakedMaterial, query: &Exact, sample: &OracleSample) -> f64 {
    let part = oracle::jacobian(sample, &material.pdf, &query.params, query.wo) / sample.jacobian;
    if part.is_finite() { part } else { 1.0 }
}

/// What the Jacobian's terms add up to, and how much its charts make of roundings.
fn scale(material: &BakedMaterial, query: &Exact, sample: &OracleSample) -> f64 {
    let of_pdf = match material.pdf.spec.outputs() {
        1 => 1.0,
        _ => condition(&material.pdf, query, sample.wi),
    };
    of_pdf * boost_condition(&material.sample, query, sample) * terms(&material.sample, query, sample)
}
