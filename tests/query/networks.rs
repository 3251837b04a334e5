//! Rows that baked networks answer.

use crate::bad_rows::refuses;
use crate::{GOLD, answers, number, rgb};
use std::path::Path;

/// Round-off of a unit vector in the f32 that networks answer in.
const UNIT_TOL: f64 = 1e-6;
/// Largest relative error of the shipped evaluation and pdf networks at one direction inside the lobe: their mean
/// error is below 1 %.
const NETWORK_TOL: f64 = 0.05;
/// Largest bias of the shipped sampling network's mean weight below 75°; its card says 0.029 for the worst channel.
const LEARNED_BIAS_MAX: f64 = 0.03;

/// The networks that ship.
fn model() -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/materials/vase");
    folder.to_str().expect("the tree has a name in UTF-8").into()
}

#[test]
fn a_model_answers_with_its_networks() {
    let wo = r#""wo": [45, 0]"#;
    let rows = [
        format!(r#"{{{wo}, "wi": [40, 180]}}"#),
        format!(r#"{{{GOLD}, {wo}, "wi": [40, 180]}}"#),
        format!(r#"{{{wo}, "u": [0.3, 0.7]}}"#),
        format!(r#"{{{wo}, "albedo": true}}"#),
        r#"{"wo": [100, 0], "u": [0.3, 0.7]}"#.to_string(),
        r#"{"wo": [45, 0], "wi": [90, 0]}"#.to_string(),
    ];
    let baked = answers(&[&model()], &rows);
    let reference = answers(&["vase"], &rows);
    assert_eq!(baked[0]["f_cos"], baked[1]["f_cos"]);
    assert_eq!(rgb(&baked[0], "se"), [0.0; 3]);
    for c in 0..3 {
        let (found, expected) = (rgb(&baked[0], "f_cos")[c], rgb(&reference[0], "f_cos")[c]);
        assert!(
            (found / expected - 1.0).abs() < NETWORK_TOL,
            "channel {c}: {found}, {expected}"
        );
        let (found, expected) = (rgb(&baked[3], "albedo")[c], rgb(&reference[3], "albedo")[c]);
        assert!(
            (found / expected - 1.0).abs() < LEARNED_BIAS_MAX,
            "channel {c}: {found}, {expected}"
        );
    }
    let [x, y, z] = rgb(&baked[2], "wi");
    assert!((x * x + y * y + z * z - 1.0).abs() < UNIT_TOL, "{}", baked[2]);
    // Where the map does not fold, its density is that of the pdf network.
    let density = 1.0 / number(&baked[2], "jacobian");
    assert!(
        (number(&baked[2], "pdf") / density - 1.0).abs() < NETWORK_TOL,
        "{}",
        baked[2]
    );
    for answers in [&baked, &reference] {
        assert!(answers[4]["wi"].is_null(), "{}", answers[4]);
        assert_eq!(
            (rgb(&answers[4], "weight"), number(&answers[4], "pdf")),
            ([0.0; 3], 0.0)
        );
        assert_eq!(
            (rgb(&answers[5], "f_cos"), number(&answers[5], "pdf")),
            ([0.0; 3], 0.0)
        );
    }
    refuses(
        &[&model()],
        r#"{"params": {"alpha": [0.3, 0.2]}, "wo": [45, 0], "wi": [40, 180]}"#,
        &["alpha[1]", "0.1"],
    );
}
