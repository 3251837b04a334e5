//! Evaluations and albedos against tables of independent implementations. The tables' `note` says how they were made.

use crate::support::table::{TABLE_SLACK, number, numbers, table};
use crate::support::{Means, assert_agree, direction};
use bake_runtime::layered::Layered;
use bake_runtime::{Bsdf, Rng};
use serde_json::Value;

fn table_layered(row: &Value) -> Layered {
    let [alpha, eta, sigma_t] = ["alpha", "eta", "sigma_T"].map(|key| number(row, key));
    Layered::new(
        alpha,
        eta,
        sigma_t,
        numbers(row, "albedo"),
        numbers(row, "rho"),
        0.0,
    )
    .expect("valid parameters")
}

#[test]
fn eval_matches_the_reference_table() {
    const EVALS: usize = 200_000;
    for (k, row) in table("layered_eval.json").iter().enumerate() {
        let layered = table_layered(row);
        let [wo, wi] = ["wo_deg", "wi_deg"].map(|key| {
            let [theta, phi] = numbers(row, key);
            direction(theta, phi)
        });
        let mut rng = Rng::new(&[31, k as u64]);
        let eval = Means::of(EVALS, || layered.eval(wo, wi, &mut rng).to_array());
        let (value, se): ([f64; 3], [f64; 3]) = (numbers(row, "fcos"), numbers(row, "se"));
        for c in 0..3 {
            let what = format!("channel {c} of {row}");
            let slack = TABLE_SLACK * value[c];
            assert_agree((eval.mean(c), eval.se(c)), (value[c], se[c]), slack, &what);
        }
        let top = number(row, "top_only");
        assert_agree(
            (layered.reflection(wo, wi), 0.0),
            (top, 0.0),
            TABLE_SLACK * top,
            &row.to_string(),
        );
    }
}

#[test]
fn walks_match_the_reference_table() {
    const WALKS: u64 = 1 << 19;
    for row in table("layered_albedo.json") {
        let layered = table_layered(&row);
        let albedo = layered.albedo(direction(number(&row, "theta_o"), 25.0), WALKS, 32);
        let (value, se): ([f64; 3], [f64; 3]) = (numbers(&row, "dir_albedo"), numbers(&row, "se"));
        for c in 0..3 {
            let what = format!("channel {c} of {row}");
            let slack = TABLE_SLACK * value[c];
            assert_agree((albedo.mean[c], albedo.se[c]), (value[c], se[c]), slack, &what);
        }
    }
}
