//! Rows that a material answers, and subjects that nobody knows.

use crate::complaint::complains;
use crate::program::{SCENE, Studio};
use crate::{query, rgb};
use serde_json::Value;

#[test]
fn rows_of_a_material_give_what_it_leaves_free() {
    let studio = Studio::new();
    let text = "family = \"conductor\"\nalpha = [{ min = 0.2, max = 0.4 }, 0.1]\nreflectance = [1.0, 0.782, 0.344]\n";
    std::fs::write(studio.path("scenes/materials/brushed.toml"), text).expect("it can be written");
    let at = r#""wo": [45, 0], "wi": [30, 180], "samples": 50"#;
    let answer = |subject: &str, params: &str| {
        let output = query(&studio, &[subject], &format!(r#"{{"params": {params}, {at}}}"#));
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        let printed = serde_json::from_slice::<Value>(&output.stdout).ok();
        printed.map(|p| rgb(&p, "f_cos")).ok_or(errors)
    };
    let whole = answer(
        "conductor",
        r#"{"alpha": [0.3, 0.1], "reflectance": [1, 0.782, 0.344]}"#,
    );
    for subject in ["brushed", "scenes/materials/brushed.toml"] {
        assert_eq!(answer(subject, r#"{"alpha": [0.3, 0.1]}"#), whole);
    }
    for (params, parts) in [
        ("{}", ["`alpha[0]`", "is free over 0.2..0.4"]),
        (r#"{"alpha": [0.5, 0.1]}"#, ["`alpha[0]`", "must lie in 0.2..0.4"]),
    ] {
        let errors = answer("brushed", params).expect_err(params);
        assert!(parts.iter().all(|part| errors.contains(part)), "{errors}");
    }
}

#[test]
fn an_unknown_subject() {
    let studio = Studio::new();
    complains(
        &studio,
        &["query", "brass"],
        &["brass", "`conductor`", "scenes/materials", "material file"],
    );
    complains(&studio, &["query", "brass.toml"], &["brass.toml"]);
    complains(
        &studio,
        &["query", SCENE],
        &[
            "scenes/vase/sample.safetensors",
            "give a folder that `bake scene` wrote",
        ],
    );
}
