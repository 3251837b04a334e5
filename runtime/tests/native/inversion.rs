//! Exact densities by inversion: against the oracle, against the Jacobian, and what they are worth as weights.

use crate::inverted::{backend, invert};
use bake_runtime::bsdf::shifted_r2;
use bake_runtime::chart::Chart;
use bake_runtime::conformance::answers::{Answers, ask};
use bake_runtime::conformance::materials::Kind;
use bake_runtime::conformance::queries::{Exact, Queries, refs, slices};
use bake_runtime::conformance::rounding::{FLOOR, boost_condition, condition, expected, terms};
use bake_runtime::native::Tier;
use bake_runtime::{Backend, BakedMaterial, oracle};

/// Relative error that the last residual leaves: 2e-5 in a logit, times what a logit moves the density by.
const RESIDUAL_TOL: f64 = 2e-4;
/// One chart's density at a direction that was rounded to f32, times the Jacobian where it was drawn.
const RECIPROCAL_TOL: f64 = 1e-3;
/// Directions above which neither lobe is so narrow that rounding its directions matters, as a height.
const HEIGHT_MIN: f32 = 0.05;
/// The density of a frame against that of the oracle's.
const FRAME_TOL: f64 = 1e-5;
/// A mean over 2¹⁶ R2 points.
const MEAN_TOL: f64 = 5e-3;

fn answer(material: &BakedMaterial, query: &Exact) -> Vec<f64> {
    let Exact { params, wo, wi, u } = query;
    let network = &material.sample;
    let sample = oracle::sample(network, params, *wo, *u);
    let inverted = oracle::exact_pdf(network, params, *wo, *wi).expect("there are charts");
    assert_eq!(inverted.unconverged, 0, "the oracle fails at {query:?}");
    let mixture = oracle::mixture_jacobian(&sample, network, params, *wo);
    vec![inverted.pdf, mixture]
}

fn floors(material: &BakedMaterial, query: &Exact, row: &[f64]) -> Vec<f64> {
    let network = &material.sample;
    let sample = oracle::sample(network, &query.params, query.wo, query.u);
    let density = RESIDUAL_TOL + FLOOR * condition(network, query, query.wi);
    let mut mixture = FLOOR * boost_condition(network, query, &sample) * terms(network, query, &sample);
    if network
        .spec
        .charts()
        .is_some_and(|charts| charts.anchors.len() > 1)
    {
        let parts = RESIDUAL_TOL + condition(network, query, sample.wi) * mixture / sample.jacobian.abs();
        mixture = parts * row[1].abs();
    }
    vec![density * row[0], mixture]
}

#[test]
fn every_tier_finds_the_densities_of_the_oracle() {
    for (seed, kind) in (0..).zip([Kind::Fixed, Kind::Free, Kind::Mixed, Kind::Narrow]) {
        let material = kind.build(400 + seed);
        let queries = Queries::random(500 + seed, 1000).with_params(&material, seed);
        let expected = expected(&material, &queries, seed, answer, floors);
        for tier in Tier::available() {
            let answers = invert(&backend(&material, tier), &queries);
            let charts = material.sample.spec.charts().map_or(0, |c| c.anchors.len());
            let [of_pdf, of_mixture] = answers.inversions;
            assert_eq!(of_pdf.queries, (charts * queries.len()) as u64);
            assert_eq!(of_mixture.queries, if charts > 1 { of_pdf.queries } else { 0 });
            assert_eq!(
                of_pdf.unconverged + of_mixture.unconverged,
                0,
                "{kind:?}, {tier:?}"
            );
            for (found, expected) in [&answers.exact_pdf, &answers.mixture].into_iter().zip(&expected) {
                for (i, (&found, expected)) in found.iter().zip(expected).enumerate() {
                    let error = (f64::from(found) - expected.value).abs();
                    assert!(
                        error <= expected.tolerance,
                        "{kind:?}, {tier:?}, query {i}: {found} instead of {}, off by {:.2} tolerances",
                        expected.value,
                        error / expected.tolerance
                    );
                }
            }
        }
    }
}

#[test]
fn the_density_of_samples_is_the_reciprocal_of_their_jacobian() {
    for kind in [Kind::Fixed, Kind::Free] {
        let material = kind.build(7);
        let queries = Queries::random(8, 2000).with_params(&material, 9);
        for tier in Tier::available() {
            let backend = backend(&material, tier);
            let drawn = ask(&backend, &queries);
            let mut there = queries.clone();
            there.wi = drawn.wi_of_jacobian.clone();
            let found = invert(&backend, &there).exact_pdf;
            for i in (0..queries.len()).filter(|&i| queries.wo[2][i].min(there.wi[2][i]) > HEIGHT_MIN) {
                let one = found[i] * drawn.jacobian[i];
                let error = (f64::from(one) - 1.0).abs();
                assert!(error < RECIPROCAL_TOL, "{kind:?}, {tier:?}, query {i}: {one}");
            }
        }
    }
}

#[test]
fn where_newton_fails_the_frame_stands_in_and_is_counted() {
    let material = Kind::Folding.build(3);
    let queries = Queries::random(5, 4000);
    for tier in Tier::available() {
        let answers = invert(&backend(&material, tier), &queries);
        let stands_in = |i: &usize| {
            let query = queries.at(*i);
            let (wo, turn) = oracle::fold(material.sample.spec.symmetry, query.wo);
            let w = oracle::folded(turn, query.wi);
            let density = oracle::charts_of(&material.sample, &[], wo)[0].1.density(w);
            let tol = FRAME_TOL * condition(&material.sample, &query, query.wi);
            (f64::from(answers.exact_pdf[*i]) / density - 1.0).abs() < tol
        };
        let count = (0..queries.len()).filter(stands_in).count() as u64;
        assert!(count > 0, "nothing failed");
        assert_eq!(answers.inversions[0].unconverged, count, "{tier:?}");
    }
}

/// ∫ f_cos dω of the first channel, and the means of f_cos · jacobian with learned and with exact densities, at one `wo` and
/// one roughness.
fn means(material: &BakedMaterial, wo: [f32; 3]) -> [f64; 3] {
    let side = 256;
    let count = side * side;
    let mut queries = Queries::random(0, count);
    let mut areas = Vec::new();
    for k in 0..count {
        let s = [(k % side) as f64 + 0.5, (k / side) as f64 + 0.5].map(|v| v / side as f64);
        let (wi, area) = Chart::IDENTITY.square_to_direction(s);
        areas.push(area / count as f64);
        let u = shifted_r2(k as u64, [0.0; 2]);
        (0..3).for_each(|c| (queries.wo[c][k], queries.wi[c][k]) = (wo[c], wi[c] as f32));
        (0..2).for_each(|c| queries.u[c][k] = (u[c] as f32).min(1.0 - f32::EPSILON));
    }
    queries.params = vec![vec![0.2]];
    let params = queries.columns();
    let points = queries.points(&params);
    let backend = backend(material, Tier::best());
    let mixture = invert(&backend, &queries).mixture;
    let Answers {
        f_cos, wi, jacobian, ..
    } = &mut ask(&backend, &queries);
    let integral = f_cos[0]
        .iter()
        .zip(areas)
        .map(|(f, area)| f64::from(*f) * area)
        .sum();
    backend
        .eval(points, refs(wi), slices(f_cos))
        .expect("equal lengths");
    let [learned, exact] = [&*jacobian, &mixture].map(|jacobian| {
        let weights = f_cos[0].iter().zip(jacobian).map(|(f, j)| f64::from(*f * *j));
        weights.sum::<f64>() / count as f64
    });
    [integral, learned, exact]
}

#[test]
fn both_mixtures_are_unbiased() {
    let [integral, learned, exact] = means(&Kind::Mixed.build(3), [0.6, 0.0, 0.8]);
    for (mean, what) in [(learned, "learned"), (exact, "exact")] {
        let error = (mean / integral - 1.0).abs();
        assert!(error < MEAN_TOL, "{what}: {mean} instead of {integral}");
    }
}
