//! Every tier against the f64 oracle, tiers against each other, and the oracle's Jacobian against differences.

use crate::random::{Answers, Materials, Queries, backend, run};
use bake_runtime::native::Tier;
use bake_runtime::oracle::{self, OracleSample};
use bake_runtime::{BakedMaterial, Network};
use glam::DVec3;

/// A component of `wi`, absolutely. Its sums hold terms up to the lobe's slope times the height, ten times
/// larger than their sum at grazing angles, so some tens of f32 roundings (6e-8) are the least.
const WI_TOL: f64 = 4e-6;
/// `weight`, relatively: the exponent's error, some f32 roundings of sums of 32 terms around 1 per layer, which
/// larger exponents scale.
const WEIGHT_TOL: f64 = 2e-6;
/// `jacobian`, relative to the same with all its terms added instead of subtracted: the gradient's error, like
/// the exponent's, and three times that of a vector's length.
const JACOBIAN_TOL: f64 = 1e-5;
/// `f_cos` and `pdf`, relatively per unit of [`condition`]: logarithms of the frame's scales around 4 are
/// rounded in steps of 2.4e-7 on their way through the network and enter up to five times.
const DENSITY_TOL: f64 = 1e-5;
/// The height of `wi` relatively, because `f_cos` is proportional to it next to the horizon.
const HEIGHT_TOL: f64 = 4e-6;
/// Central differences with a relative step of 1e-4: the square of it times third derivatives over first,
/// which reach some hundreds where networks fold.
const DIFFERENCE_TOL: f64 = 3e-6;
/// Step of the differences, relative to the distance of u from its edge.
const DIFFERENCE_STEP: f64 = 1e-4;
/// The largest u that a backend uses: the last f32 below 1.
const U_MAX: f64 = 1.0 - 1.0 / (1u64 << 24) as f64;

/// What a component should be, and how far off it may be.
struct Expected {
    value: f64,
    tolerance: f64,
}

/// Derivatives of `of` a sample of the oracle along u, by central differences in f64.
fn differences<const K: usize>(
    material: &BakedMaterial,
    wo: [f64; 3],
    u: [f64; 2],
    of: impl Fn(OracleSample) -> [f64; K],
) -> [[f64; K]; 2] {
    std::array::from_fn(|j| {
        let step = DIFFERENCE_STEP * u[j].min(1.0 - u[j]);
        let at = |by: f64| {
            let mut moved = u;
            moved[j] += by;
            of(oracle::sample(&material.sample, wo, moved))
        };
        let (low, high) = (at(-step), at(step));
        std::array::from_fn(|k| (high[k] - low[k]) / (2.0 * step))
    })
}

/// How much a relative error of the frame's slope grows in the frame's density at `wi`: 1 plus the slope's part
/// of the local vector over its length.
fn condition(network: &Network, wo: [f64; 3], wi: [f64; 3]) -> f64 {
    let (wo, signs) = oracle::fold(network.spec.symmetry, wo);
    let frame = oracle::frame_of(network, wo);
    let ([_, _, local_z], _) = frame.to_local([signs[0] * wi[0], signs[1] * wi[1], wi[2]]);
    let slope = (frame.b[0] / frame.x).hypot(frame.b[1] / frame.y) * (1.0 + frame.shear.abs());
    1.0 + slope * local_z
}

/// The oracle's answers, in the order of [`Answers::columns`].
fn expected(material: &BakedMaterial, queries: &Queries) -> Vec<Vec<Expected>> {
    let mut columns: Vec<Vec<Expected>> = Vec::new();
    for i in 0..queries.len() {
        let (wo, wi, u) = queries.at(i);
        let u = u.map(|v| v.clamp(bake_runtime::spec::U_MIN, U_MAX));
        let sample = oracle::sample(&material.sample, wo, u);
        let [[xx, yx], [xy, yy]] = differences(material, wo, u, |s| s.square);
        // The diagonal is the derivative at a fixed shift plus the shift's.
        let [x, y] = std::array::from_fn(|c| {
            let direct = sample.square[c] * (1.0 - sample.square[c]) / (u[c] * (1.0 - u[c]));
            direct + ([xx, yy][c] - direct).abs()
        });
        let terms = sample.jacobian / sample.det * (x * y + (xy * yx).abs());
        let height = (HEIGHT_TOL * sample.wi[2]).min(WI_TOL);
        let wi_row = sample
            .wi
            .iter()
            .zip([WI_TOL, WI_TOL, height])
            .map(|(&value, tolerance)| Expected { value, tolerance });
        let relative = |values: Vec<f64>, tolerance: f64| {
            values.into_iter().map(move |value| Expected {
                value,
                tolerance: tolerance * value.abs(),
            })
        };
        let [eval_tol, pdf_tol] =
            [&material.eval, &material.pdf].map(|network| DENSITY_TOL * condition(network, wo, wi));
        let row: Vec<Expected> = wi_row
            .clone()
            .chain(relative(sample.weight.to_vec(), WEIGHT_TOL))
            .chain(wi_row)
            .chain(relative(oracle::density(&material.eval, wo, wi), eval_tol))
            .chain([Expected {
                value: sample.jacobian,
                tolerance: JACOBIAN_TOL * terms.abs(),
            }])
            .chain(relative(oracle::density(&material.pdf, wo, wi), pdf_tol))
            .collect();
        columns.resize_with(row.len(), Vec::new);
        columns
            .iter_mut()
            .zip(row)
            .for_each(|(column, value)| column.push(value));
    }
    columns
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

#[test]
fn every_tier_agrees_with_the_oracle_and_with_the_others() {
    let kinds = [
        (Materials::Moderate, 20_000),
        (Materials::Narrow, 5_000),
        (Materials::Folding, 5_000),
        (Materials::Odd(0), 2_000),
        (Materials::Odd(1), 2_000),
        (Materials::Odd(2), 2_000),
    ];
    for (seed, (kind, count)) in kinds.into_iter().enumerate() {
        let material = kind.build(100 + seed as u64);
        for queries in [Queries::random(200 + seed as u64, count), Queries::hard()] {
            let expected = expected(&material, &queries);
            let mut before: Option<Answers> = None;
            for tier in Tier::available() {
                let answers = run(&mut backend(&material, tier), &queries);
                let what = format!("{kind:?}, {}", tier.name());
                check(&answers, &expected, None, 1.0, &what);
                if let Some(before) = &before {
                    check(
                        &answers,
                        &expected,
                        Some(before),
                        2.0,
                        &format!("{what} against the tier below"),
                    );
                }
                before = Some(answers);
            }
        }
    }
}

#[test]
fn the_oracles_jacobian_is_the_derivative_of_its_direction() {
    for kind in [Materials::Moderate, Materials::Narrow, Materials::Folding] {
        let material = kind.build(300);
        let queries = Queries::random(301, 5_000);
        let mut folded = 0;
        for i in 0..queries.len() {
            let (wo, _, u) = queries.at(i);
            // Jacobians are those of the folded map.
            let wo = [wo[0].abs(), wo[1].abs(), wo[2]];
            let sample = oracle::sample(&material.sample, wo, u);
            let [[xx, yx], [xy, yy]] = differences(&material, wo, u, |s| s.square);
            let error = (xx * yy - xy * yx - sample.det).abs() / ((xx * yy).abs() + (xy * yx).abs());
            assert!(
                error <= DIFFERENCE_TOL,
                "{kind:?}, query {i}: det {} off by {error}",
                sample.det
            );
            let [du, dv] = differences(&material, wo, u, |s| s.wi).map(DVec3::from_array);
            let solid_angle = du.cross(dv).dot(DVec3::from_array(sample.wi));
            let error = (solid_angle - sample.jacobian).abs() / (du.length() * dv.length());
            assert!(
                error <= DIFFERENCE_TOL,
                "{kind:?}, query {i}: {} sr off by {error}",
                sample.jacobian
            );
            folded += usize::from(sample.det < 0.0);
        }
        assert_eq!(
            folded > 0,
            matches!(kind, Materials::Folding),
            "{kind:?} folds {folded} times"
        );
    }
}
