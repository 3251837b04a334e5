//! Evaluations and walks against tables of an independent implementation. The tables' `note` says how they were
//! made.

use crate::support::table::{TABLE_SLACK, number, table};
use crate::support::{Means, assert_agree, direction};
use bake_runtime::conductor::Conductor;
use bake_runtime::{Bsdf, Rng};
use serde_json::Value;

/// Reflectances of the tables' three columns.
const TABLE_REFLECTANCE: [f64; 3] = [1.0, 0.782, 0.344];
/// The tables print seven digits; the analytic columns have no other error.
const ANALYTIC_TOL: f64 = 1e-4;

fn table_conductor(row: &Value) -> Conductor {
    Conductor::new(
        [number(row, "alpha_x"), number(row, "alpha_y")],
        TABLE_REFLECTANCE,
    )
    .expect("valid parameters")
}

#[test]
fn eval_matches_the_reference_table() {
    const EVALS: usize = 200_000;
    for (k, row) in table("conductor_eval.json").iter().enumerate() {
        let conductor = table_conductor(row);
        let wo = direction(number(row, "wo_theta"), number(row, "wo_phi"));
        let wi = direction(number(row, "wi_theta"), number(row, "wi_phi"));
        let mut rng = Rng::new(&[1, k as u64]);
        let eval = Means::of(EVALS, || conductor.eval(wo, wi, &mut rng).to_array());
        let single = conductor.single(wo, wi).to_array();
        let columns = [
            ("F1", "F1_se", "F1"),
            ("g_F0_782", "g_se", "g"),
            ("b_F0_344", "b_se", "b"),
        ];
        for (i, (value, se, suffix)) in columns.into_iter().enumerate() {
            let expected = (number(row, value), number(row, se));
            assert_agree(
                (eval.mean(i), eval.se(i)),
                expected,
                TABLE_SLACK * expected.0,
                &format!("{value}, {row}"),
            );
            let analytic = number(row, &format!("single_analytic_{suffix}"));
            assert!(
                (single[i] / analytic - 1.0).abs() < ANALYTIC_TOL,
                "single {suffix}: {} in {row}",
                single[i]
            );
        }
    }
}

#[test]
fn walks_match_the_reference_table() {
    const WALKS: usize = 200_000;
    for (k, row) in table("conductor_albedo.json").iter().enumerate() {
        let conductor = table_conductor(row);
        let wo = direction(number(row, "wo_theta"), number(row, "wo_phi"));
        let mut rng = Rng::new(&[2, k as u64]);
        let means = Means::of(WALKS, || {
            let mut order = 1.0;
            let u = rng.pair();
            let walk = conductor
                .walk(wo, u, &mut rng, |_| order += 1.0)
                .expect("red is white: no roulette");
            assert_eq!(walk.weight.x, 1.0);
            let once = if order == 1.0 { 1.0 } else { 0.0 };
            let [_, g, b] = walk.weight.to_array();
            [
                g,
                b,
                order,
                once,
                once * g,
                once * b,
                walk.wi.x,
                walk.wi.y,
                walk.wi.z,
            ]
        });
        let dir = |i: usize| row["mean_dir"][i].as_f64().expect("three numbers");
        let keys = [
            "g_F0_782",
            "b_F0_344",
            "mean_order",
            "single_F1",
            "single_g",
            "single_b",
        ];
        let expected = keys
            .map(|key| number(row, key))
            .into_iter()
            .chain((0..3).map(dir));
        for (i, expected) in expected.enumerate() {
            // Both sides draw from one distribution, so its variance gives the table's standard error, too.
            let table_se = (means.variance(i) / number(row, "n")).sqrt();
            let slack = TABLE_SLACK * expected.abs();
            assert_agree(
                (means.mean(i), means.se(i)),
                (expected, table_se),
                slack,
                &format!("{i} of {row}"),
            );
        }
    }
}
