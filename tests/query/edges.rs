//! Every family at the edges of its domain and of the hemisphere: numbers everywhere, zero where there is no light.

use crate::program::Studio;
use crate::{answers_in, imported, number, rgb};
use serde_json::Value;

/// Polar angles in degrees: straight on, next to it, next to the horizon from both sides, on it, and below.
const THETAS: [f64; 8] = [0.0, 1e-9, 45.0, 89.9999, 90.0, 90.0001, 120.0, 180.0];

/// First θ that counts as not above the horizon.
const HORIZON: f64 = 90.0;

/// A family with the parameters of its rows, as JSON.
fn subjects(studio: &Studio) -> Vec<(&'static str, String)> {
    let params = |text: &str| format!(r#""params": {{{text}}}"#);
    let mut subjects = vec![("imported", imported::params(studio))];
    for alpha in ["[0.0001, 0.0001]", "[1, 0.0001]", "[1, 1]"] {
        for fresnel in [
            r#""reflectance": [0, 1, 0.5]"#,
            r#""ior": {"eta": [0.001, 100, 1], "k": [0, 100, 0]}"#,
        ] {
            subjects.push(("conductor", params(&format!(r#""alpha": {alpha}, {fresnel}"#))));
        }
    }
    for (alpha, eta) in [
        ("0.0001", "0.5"),
        ("0.0001", "4"),
        ("1", "1"),
        ("1", "0.5"),
        ("1", "4"),
    ] {
        for slab in [
            r#""sigma_t": 0, "g": 0.99"#,
            r#""sigma_t": 100, "g": 0.99"#,
            r#""sigma_t": 2, "g": -0.99"#,
        ] {
            subjects.push((
                "layered",
                params(&format!(
                    r#""alpha": {alpha}, "eta": {eta}, "albedo": [0, 1, 1], "base": [1, 0, 1], {slab}"#
                )),
            ));
        }
    }
    for rest in ["0", "1"] {
        for base in [
            r#""base_color": [0, 0, 0], "roughness": 0"#,
            r#""base_color": [0, 0, 1], "roughness": 1"#,
        ] {
            for metallic in ["0", "1"] {
                let others = [
                    "specular",
                    "specular_tint",
                    "anisotropic",
                    "sheen",
                    "sheen_tint",
                    "clearcoat",
                    "clearcoat_gloss",
                    "flatness",
                ];
                let others: Vec<String> = others.iter().map(|name| format!(r#""{name}": {rest}"#)).collect();
                subjects.push((
                    "principled",
                    params(&format!(
                        r#"{base}, "metallic": {metallic}, {}"#,
                        others.join(", ")
                    )),
                ));
            }
        }
    }
    subjects
}

#[test]
fn no_answer_is_anything_but_a_number() {
    let studio = Studio::new();
    let subjects = subjects(&studio);
    for family in ["conductor", "layered", "principled", "imported"] {
        let mut rows = Vec::new();
        for (_, params) in subjects.iter().filter(|(name, _)| *name == family) {
            for wo in THETAS {
                for wi in THETAS {
                    rows.push(format!(
                        r#"{{{params}, "wo": [{wo:?}, 0], "wi": [{wi:?}, 180], "samples": 8}}"#
                    ));
                }
                for u in ["[0, 0]", "[0.5, 0.5]", "[0.999999999999, 0.999999999999]"] {
                    rows.push(format!(r#"{{{params}, "wo": [{wo:?}, 30], "u": {u}}}"#));
                }
                rows.push(format!(
                    r#"{{{params}, "wo": [{wo:?}, 30], "albedo": true, "samples": 32}}"#
                ));
            }
        }
        assert!(!rows.is_empty());
        for answer in answers_in(&studio, &[family], &rows) {
            check(&answer);
        }
    }
}

/// Asserts that all numbers of an answer are there (JSON has no NaN and no infinity), not negative, and zero where
/// either direction is not above the horizon.
fn check(answer: &Value) {
    let theta = |key: &str| answer[key][0].as_f64().unwrap_or_default();
    let is_dark = theta("wo") >= HORIZON || answer.get("f_cos").is_some() && theta("wi") >= HORIZON;
    let mut values = Vec::new();
    for key in ["f_cos", "weight", "albedo"] {
        if answer.get(key).is_some() {
            values.extend(rgb(answer, key));
        }
    }
    assert_eq!(values.len(), 3, "{answer}");
    for key in ["se", "wi"] {
        // Where nothing was drawn there is no direction.
        if answer
            .get(key)
            .is_some_and(|value| value.as_array().is_some_and(|list| list.len() == 3))
        {
            rgb(answer, key);
        }
    }
    if answer.get("pdf").is_some() {
        values.push(number(answer, "pdf"));
    }
    assert!(values.iter().all(|v| *v >= 0.0), "{answer}");
    assert!(!is_dark || values.iter().all(|v| *v == 0.0), "{answer}");
}
