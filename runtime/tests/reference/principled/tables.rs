//! Evaluations against tables of Mitsuba's plugin. The tables' `note` says how they were made.

use super::{bound, direction, eval};
use bake_runtime::principled::PrincipledParameters;
use glam::DVec3;
use serde_json::Value;
use std::path::Path;

/// Agreement asked of every channel. Mitsuba computes in f32, which costs 0.1 % in the worst row; anything that
/// the two models did not share would show at once in some of them.
const RELATIVE_TOL: f64 = 0.01;
/// Where all light of a channel is a Fresnel term next to zero, f32 gives 0: 1e-9 is (1 − cos)⁵ at 7°.
const ABSOLUTE_TOL: f64 = 1e-9;

/// The parameters of a row; what it does not name is as in `omitted`.
fn parameters(row: &Value, omitted: PrincipledParameters) -> PrincipledParameters {
    let number = |name: &str, omitted: f64| row.get(name).map_or(omitted, |v| v.as_f64().expect("a number"));
    PrincipledParameters {
        base_color: row.get("base_color").map_or(omitted.base_color, rgb),
        metallic: number("metallic", omitted.metallic),
        roughness: number("roughness", omitted.roughness),
        specular: number("specular", omitted.specular),
        specular_tint: number("specular_tint", omitted.specular_tint),
        anisotropic: number("anisotropic", omitted.anisotropic),
        sheen: number("sheen", omitted.sheen),
        sheen_tint: number("sheen_tint", omitted.sheen_tint),
        clearcoat: number("clearcoat", omitted.clearcoat),
        clearcoat_gloss: number("clearcoat_gloss", omitted.clearcoat_gloss),
        flatness: number("flatness", omitted.flatness),
    }
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    std::array::from_fn(|i| {
        value[i]
            .as_f64()
            .unwrap_or_else(|| panic!("{N} numbers: {value}"))
    })
}

fn rgb(value: &Value) -> DVec3 {
    DVec3::from_array(numbers(value))
}

/// Compares every row of a table with `eval`; returns the number of rows.
fn compare(name: &str, omitted: PrincipledParameters) -> usize {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../tests/reference")
        .join(name);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let table: Value = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let rows = table["rows"].as_array().expect("an array `rows`");
    for row in rows {
        let [wo, wi] = ["wo_deg", "wi_deg"].map(|key| {
            let [theta, phi] = numbers(&row[key]);
            direction(theta, phi)
        });
        let found = eval(&bound(parameters(row, omitted)), wo, wi);
        let expected = rgb(&row["eval_fcos"]);
        let tolerance = RELATIVE_TOL * expected + ABSOLUTE_TOL;
        assert!(
            (found - expected).abs().cmple(tolerance).all(),
            "{found}, expected {expected}: {row}"
        );
    }
    rows.len()
}

#[test]
fn eval_matches_the_table_of_roughness_and_metal() {
    let omitted = PrincipledParameters {
        base_color: DVec3::new(0.8, 0.4, 0.1),
        ..PrincipledParameters::default()
    };
    assert!(compare("principled_eval.json", omitted) > 0);
}

#[test]
fn eval_matches_the_table_of_all_lobes() {
    const ROWS_MIN: usize = 200;
    assert!(compare("principled_lobes.json", PrincipledParameters::default()) >= ROWS_MIN);
}
