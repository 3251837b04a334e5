//! Answers belong to their rows: they depend on nothing else, and agree with each other.

use crate::imported;
use crate::program::Studio;
use crate::{GOLD, PAINT, VARNISH, answers, answers_in, number, rgb};
use serde_json::Value;

/// Agreement asked of a Monte Carlo comparison, in combined standard errors: 12 comparisons exceed 4 by chance once in
/// 1300 runs.
const SIGMAS: f64 = 4.0;
/// Round-off of a unit vector, and of a mean of weights that are all 1.
const UNIT_TOL: f64 = 1e-12;

/// 600 rows with `params`, of every kind in turn.
fn mixed_rows(params: &str) -> Vec<String> {
    let angles = |i: usize| (7 * i % 89, 31 * i % 360);
    (0..600)
        .map(|i| {
            let ((a, b), (c, d)) = (angles(i + 3), angles(2 * i + 11));
            match i % 3 {
                0 => format!(r#"{{{params}, "wo": [{a}, {b}], "wi": [{c}, {d}], "samples": 20}}"#),
                1 => format!(r#"{{{params}, "wo": [{a}, {b}], "u": [0.{i}, 0.25]}}"#),
                _ => format!(r#"{{{params}, "wo": [{a}, {b}], "albedo": true, "samples": 50}}"#),
            }
        })
        .collect()
}

#[test]
fn answers_depend_on_their_row_and_the_seed_alone() {
    for (family, params) in [("conductor", GOLD), ("layered", VARNISH), ("principled", PAINT)] {
        let rows = mixed_rows(params);
        let forth = answers(&[family], &rows);
        let reversed: Vec<String> = rows.iter().rev().cloned().collect();
        let mut back = answers(&[family, "--threads", "1"], &reversed);
        back.reverse();
        assert_eq!(forth, back);
        let other = answers(&[family, "--seed", "2"], &rows);
        for kind in 0..3 {
            // A sample after one bounce owes nothing to chance, and only albedos do where the model is deterministic.
            let mut rows = (kind..rows.len()).step_by(3);
            assert_eq!(
                rows.any(|i| forth[i] != other[i]),
                family != "principled" || kind == 2,
                "answers of kind {kind} of {family}"
            );
        }
    }
}

/// A material that fixes everything, with and without its parameters said again.
#[test]
fn materials_answer_as_their_families() {
    let rows = mixed_rows(GOLD);
    let bare: Vec<String> = rows
        .iter()
        .map(|row| row.replace(&format!("{GOLD}, "), ""))
        .collect();
    let [said, unsaid] = [&rows, &bare].map(|rows| answers(&["vase"], rows));
    let family = answers(&["conductor"], &rows);
    for ((said, unsaid), family) in said.iter().zip(&unsaid).zip(&family) {
        assert_eq!(said, family);
        for key in ["f_cos", "wi", "weight", "albedo", "se", "pdf"] {
            assert_eq!(said[key], unsaid[key], "{said}");
        }
    }
}

#[test]
fn samples_average_to_the_albedo() {
    let studio = Studio::new();
    let imported = imported::params(&studio);
    for (family, params) in [
        ("conductor", GOLD),
        ("layered", VARNISH),
        ("principled", PAINT),
        ("imported", imported.as_str()),
    ] {
        average_to_the_albedo(&studio, family, params);
    }
}

fn average_to_the_albedo(studio: &Studio, family: &str, params: &str) {
    const SIDE: usize = 64;
    let mut rows = vec![format!(r#"{{{params}, "wo": [60, 20], "albedo": true}}"#)];
    for i in 0..SIDE * SIDE {
        let u = [i % SIDE, i / SIDE].map(|k| (k as f64 + 0.5) / SIDE as f64);
        rows.push(format!(r#"{{{params}, "wo": [60, 20], "u": {u:?}}}"#));
    }
    let answers = answers_in(studio, &[family], &rows);
    let (albedo, albedo_se) = (rgb(&answers[0], "albedo"), rgb(&answers[0], "se"));
    let n = (SIDE * SIDE) as f64;
    for c in 0..3 {
        let weights = answers[1..].iter().map(|a| rgb(a, "weight")[c]);
        let (sum, square) = weights.fold((0.0, 0.0), |(s, q), w| (s + w, q + w * w));
        let mean = sum / n;
        let se = ((square / n - mean * mean).max(0.0) / n).sqrt();
        let allowed = SIGMAS * se.hypot(albedo_se[c]) + UNIT_TOL;
        assert!(
            (mean - albedo[c]).abs() <= allowed,
            "channel {c} of {family}: {mean}, {albedo:?}"
        );
    }
    let drawn: Vec<&Value> = answers[1..].iter().filter(|a| !a["wi"].is_null()).collect();
    assert!(!drawn.is_empty(), "{family} draws nothing");
    for answer in drawn {
        let [x, y, z] = rgb(answer, "wi");
        assert!(
            (x * x + y * y + z * z - 1.0).abs() < UNIT_TOL && z > 0.0,
            "{answer}"
        );
        assert!(
            number(answer, "pdf") > 0.0 && answer.get("jacobian").is_none(),
            "{answer}"
        );
    }
}

#[test]
fn metals_have_names() {
    let row = |metal: &str, ask: &str| {
        format!(r#"{{"params": {{"alpha": [0.2, 0.1], "ior": {metal}}}, "wo": [30, 0], {ask}}}"#)
    };
    let numbers = r#"{"eta": [0.143036, 0.375307, 1.442045], "k": [3.982997, 2.385556, 1.603359]}"#;
    let names = [r#""gold""#, r#""Au""#, r#""GOLD""#, numbers, r#""silver""#];
    for (ask, keys) in [
        (r#""albedo": true"#, ["albedo", "se"]),
        (r#""wi": [35, 170], "samples": 100"#, ["f_cos", "se"]),
        (r#""u": [0.3, 0.7]"#, ["weight", "wi"]),
    ] {
        let found = answers(&["conductor"], &names.map(|metal| row(metal, ask)));
        for key in keys {
            for other in &found[1..4] {
                assert_eq!(found[0][key], other[key], "{other}");
            }
        }
        let [gold, silver] = [&found[0], &found[4]].map(|answer| rgb(answer, keys[0]));
        assert!(gold[0] > gold[1] && gold[1] > gold[2], "gold is yellow: {gold:?}");
        assert!(silver[2] > gold[2], "silver is brighter: {silver:?}");
    }
}
