//! Every kind of row that cannot be answered, for every family: one line says which row, which part of it, and what it
//! may be.

use crate::program::Studio;
use crate::{GOLD, PAINT, VARNISH, query};
use serde_json::{Value, json};

/// The directions of the rows.
const AT: &str = r#""wo": [45, 0], "wi": [30, 180]"#;

/// Asserts that `row` is refused, after a good row of a conductor was answered: see [`refuses_in`].
pub fn refuses(arguments: &[&str], row: &str, parts: &[&str]) {
    let good = format!(r#"{{{GOLD}, {AT}, "samples": 2}}"#);
    refuses_in(&Studio::new(), arguments, &good, row, parts);
}

/// Asserts that `row` is refused with one line that names it and has all of `parts`, after the row `good` before it was
/// answered and though another follows.
pub fn refuses_in(studio: &Studio, arguments: &[&str], good: &str, row: &str, parts: &[&str]) {
    let output = query(studio, arguments, &format!("{good}\n\n{row}\n{good}\n"));
    let errors = String::from_utf8(output.stderr).expect("complaints are UTF-8");
    let printed = String::from_utf8(output.stdout).expect("answers are UTF-8");
    assert_eq!(output.status.code(), Some(2), "{row}: {errors}");
    assert_eq!(
        printed.lines().count(),
        1,
        "only the first row is answered: {printed}"
    );
    assert_eq!(errors.lines().count(), 1, "not one line: {errors}");
    for part in parts.iter().chain(&["bake: standard input, line 3: "]) {
        assert!(errors.contains(part), "`{part}` is not in: {errors}");
    }
}

/// A row with these parameters at [`AT`].
fn with(params: &str) -> String {
    format!(r#"{{"params": {{{params}}}, {AT}}}"#)
}

#[test]
fn rows_of_conductors() {
    let f0 = r#""reflectance": [1, 1, 1]"#;
    let cases: [(String, &[&str]); 25] = [
        ("nonsense".into(), &["not a JSON object"]),
        (format!("{{{AT}"), &["not a JSON object"]),
        (
            format!("{{{GOLD}, {AT}}} {{}}"),
            &["not a JSON object", "trailing"],
        ),
        ("[1, 2]".into(), &["not a JSON object"]),
        (
            format!("{{{AT}}}"),
            &["`alpha`", "missing field", "2 numbers in 0.0001..1"],
        ),
        (
            with(r#""alpha": [0.1, 0.1]"#),
            &["`reflectance`", "missing field", "3 numbers in 0..1", "`ior`"],
        ),
        (
            with(&format!(r#""aplha": [0.1, 0.1], {f0}"#)),
            &["`aplha`", "unknown field", "`alpha`"],
        ),
        (
            with(&format!(r#""alpha": [0.1], {f0}"#)),
            &["`alpha`", "[0.1]", "length 2"],
        ),
        (
            with(&format!(r#""alpha": 0.1, {f0}"#)),
            &["`alpha`", "is 0.1", "length 2"],
        ),
        (
            with(&format!(r#""alpha": [0.1, 1.5], {f0}"#)),
            &["`alpha[1]`", "is 1.5", "must lie in 0.0001..1"],
        ),
        (
            with(&format!(r#""alpha": [0.1, null], {f0}"#)),
            &["`alpha[1]`", "is null", "a number"],
        ),
        (
            with(&format!(r#""alpha": [0.1, {{"min": 0.1, "max": 0.2}}], {f0}"#)),
            &["`alpha[1]`", "0.1..0.2", "give it one value"],
        ),
        (
            with(&format!(r#""alpha": [0.1, 0.1], {f0}, "ior": "gold""#)),
            &["`ior`", "give one of the two"],
        ),
        (
            format!(r#"{{{GOLD}, "wo": [45], "wi": [30, 180]}}"#),
            &["`wo`", "is [45]", "degrees"],
        ),
        (
            format!(r#"{{{GOLD}, "wo": [181, 0], "wi": [30, 180]}}"#),
            &["`wo`", "0..180"],
        ),
        (format!(r#"{{{GOLD}, "wo": [45, 0]}}"#), &["`wi`", "missing"]),
        (format!(r#"{{{GOLD}, "wi": [45, 0]}}"#), &["`wo`", "missing"]),
        (
            format!(r#"{{{GOLD}, {AT}, "u": [0.5, 0.5]}}"#),
            &["`u`", "beside `wi`"],
        ),
        (
            with(&format!(r#""alpha": [NaN, 0.1], {f0}"#)),
            &["not a JSON object"],
        ),
        (
            with(&format!(r#""alpha": [1e999, 0.1], {f0}"#)),
            &["not a JSON object", "out of range"],
        ),
        (
            with(r#""alpha": [0.1, 0.1], "ior": "brass""#),
            &["`ior`", "is \"brass\"", "gold (Au)"],
        ),
        (
            with(r#""alpha": [0.1, 0.1], "ior": {"eta": [1, 1, 0], "k": [1, 1, 1]}"#),
            &["`ior.eta[2]`", "is 0", "must lie in 0.001..100"],
        ),
        (
            with(r#""alpha": [0.1, 0.1], "ior": {"eta": [1, 1, 1], "k": [-1, 1, 1]}"#),
            &["`ior.k[0]`", "is -1", "must lie in 0..100"],
        ),
        (
            with(r#""alpha": [0.1, 0.1], "ior": {"eta": [1, 1, 1]}"#),
            &["`ior"],
        ),
        (
            format!(r#"{{{GOLD}, {AT}, "samples": -1}}"#),
            &["`samples`", "is -1", "1..1e12"],
        ),
    ];
    for (row, parts) in cases {
        refuses(&["conductor"], &row, parts);
    }
    refuses(
        &["vase"],
        &with(r#""alpha": [0.3, 0.2]"#),
        &["`alpha[1]`", "is 0.2", "`vase` fixes it at 0.1"],
    );
}

/// The row of `params`, which are good, with `value` in place of their `name`; without it where there is no value.
fn spoiled(params: &str, name: &str, value: Option<Value>) -> String {
    let mut row: Value =
        serde_json::from_str(&format!("{{{params}, {AT}, \"samples\": 2}}")).expect("it is JSON");
    let params = row["params"].as_object_mut().expect("an object");
    params.remove(name);
    if let Some(value) = value {
        params.insert(name.into(), value);
    }
    row.to_string()
}

/// Asserts that every change of good `params` of `family` is refused with its parts, in one conversation each.
fn refuses_changes(family: &str, params: &str, changes: &[(&str, Option<Value>, &[&str])]) {
    let good = format!("{{{params}, {AT}, \"samples\": 2}}");
    for (name, value, parts) in changes {
        let label = [format!("`{name}")];
        let parts: Vec<&str> = label
            .iter()
            .map(String::as_str)
            .chain(parts.iter().copied())
            .collect();
        let row = spoiled(params, name, value.clone());
        refuses_in(&Studio::new(), &[family], &good, &row, &parts);
    }
}

#[test]
fn rows_of_layered_materials() {
    let one = |value: f64| Some(json!(value));
    let missing = "missing field";
    refuses_changes(
        "layered",
        VARNISH,
        &[
            ("alpha", None, &[missing, "a number in 0.0001..1"]),
            ("alpha", one(0.0), &["is 0,", "must lie in 0.0001..1"]),
            ("alpha", one(1.01), &["is 1.01", "must lie in 0.0001..1"]),
            (
                "alpha",
                Some(json!([0.1, 0.1])),
                &["is [0.1, 0.1]", "expected a number"],
            ),
            ("eta", one(0.4), &["is 0.4", "must lie in 0.5..4"]),
            ("eta", one(4.1), &["is 4.1", "must lie in 0.5..4"]),
            ("sigma_t", None, &[missing, "a number in 0..100"]),
            ("sigma_t", one(-0.1), &["is -0.1", "must lie in 0..100"]),
            ("sigma_t", one(101.0), &["is 101", "must lie in 0..100"]),
            ("albedo", None, &[missing, "3 numbers in 0..1"]),
            ("albedo", one(0.5), &["is 0.5", "length 3"]),
            (
                "albedo",
                Some(json!([0.5, 1.1, 0.5])),
                &["[1]`", "is 1.1", "must lie in 0..1"],
            ),
            ("base", None, &[missing, "3 numbers in 0..1"]),
            (
                "base",
                Some(json!([0.5, 0.5, -0.5])),
                &["[2]`", "is -0.5", "must lie in 0..1"],
            ),
            (
                "base",
                Some(json!([0.5, 0.5, "x"])),
                &["[2]`", "is \"x\"", "expected a number"],
            ),
            ("g", one(1.0), &["is 1,", "must lie in -0.99..0.99"]),
            ("g", Some(Value::Null), &["is null", "expected a number"]),
            ("sigma_a", one(1.0), &["unknown field", "`sigma_t`", "`base`"]),
        ],
    );
}

#[test]
fn rows_of_principled_surfaces() {
    let scalars = [
        "metallic",
        "roughness",
        "specular",
        "specular_tint",
        "anisotropic",
        "sheen",
        "sheen_tint",
        "clearcoat",
        "clearcoat_gloss",
        "flatness",
    ];
    for name in scalars {
        refuses_changes(
            "principled",
            PAINT,
            &[
                (name, Some(json!(-0.1)), &["is -0.1", "must lie in 0..1"]),
                (name, Some(json!(1.5)), &["is 1.5", "must lie in 0..1"]),
            ],
        );
    }
    refuses_changes(
        "principled",
        PAINT,
        &[
            (
                "base_color",
                Some(json!([0.5, 0.5, 1.5])),
                &["[2]`", "is 1.5", "must lie in 0..1"],
            ),
            (
                "base_color",
                Some(json!([0.5, 0.5])),
                &["is [0.5, 0.5]", "length 3"],
            ),
            ("base_color", Some(json!("red")), &["is \"red\"", "length 3"]),
            (
                "roughness",
                Some(json!([0.5])),
                &["is [0.5]", "expected a number"],
            ),
            (
                "spec_tint",
                Some(json!(0.5)),
                &["unknown field", "`specular_tint`"],
            ),
            ("eta", Some(json!(1.5)), &["unknown field", "`specular`"]),
        ],
    );
}
