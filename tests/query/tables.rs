//! Every row of the reference tables, asked of the program. The tables' `note` says how they were made.

use crate::{answers, number, rgb};
use serde_json::{Value, json};
use std::path::Path;

/// Agreement asked of a Monte Carlo comparison, in combined standard errors.
const SIGMAS: f64 = 3.0;
/// Relative slack beside the standard errors: a row of the tables holds as few as 100 000 walks, so rare bright ones
/// may be missing from its mean and from its standard error alike.
const WALK_SLACK: f64 = 5e-3;
/// Relative slack against Mitsuba's principled plugin, which computes in f32.
const MITSUBA_SLACK: f64 = 1e-2;
/// Where all light of a channel is a Fresnel term next to zero, f32 gives 0: 1e-9 is (1 − cos)⁵ at 7°.
const MITSUBA_FLOOR: f64 = 1e-9;
/// Schlick reflectance of the tables of conductors.
const GOLD: [f64; 3] = [1.0, 0.782, 0.344];
/// Evaluations averaged for a row of a stochastic model.
const EVALS: u64 = 200_000;
/// Walks averaged for an albedo: their standard errors are at most those of the tables.
const WALKS: u64 = 1 << 18;

/// Rows of the table `name`.
fn table(name: &str) -> Vec<Value> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/reference")
        .join(name);
    let text = std::fs::read_to_string(path).expect("the table is part of the tree");
    let table: Value = serde_json::from_str(&text).expect("it is JSON");
    table["rows"].as_array().expect("it has rows").clone()
}

/// A channel of a table with its standard error.
type Channel = (f64, f64);

/// The channels of the lists `value` and `se` of a row.
fn channels(row: &Value, value: &str, se: &str) -> [Channel; 3] {
    let (value, se) = (rgb(row, value), rgb(row, se));
    std::array::from_fn(|c| (value[c], se[c]))
}

/// Asks `family` every question, and compares `key` of each answer with what is expected, within [`SIGMAS`] and
/// `slack` · value + `floor`.
fn agree(family: &str, key: &str, questions: &[Value], expected: &[[Channel; 3]], slack: f64, floor: f64) {
    assert!(!questions.is_empty() && questions.len() == expected.len());
    let rows: Vec<String> = questions.iter().map(Value::to_string).collect();
    for ((answer, asked), expected) in answers(&[family], &rows).iter().zip(questions).zip(expected) {
        for (key, value) in asked.as_object().expect("rows are objects") {
            if key != "albedo" {
                assert_eq!(&answer[key], value, "the row comes back");
            }
        }
        let (mean, se) = (rgb(answer, key), rgb(answer, "se"));
        for (c, (value, value_se)) in expected.iter().enumerate() {
            let allowed = SIGMAS * se[c].hypot(*value_se) + slack * value + floor;
            assert!(
                (mean[c] - value).abs() <= allowed,
                "channel {c}: {answer}, expected {value} ± {value_se}"
            );
        }
        assert!(key == "albedo" || number(answer, "pdf") > 0.0, "{answer}");
    }
}

#[test]
fn conductors() {
    let table = table("conductor_eval.json");
    let question = |row: &Value| {
        json!({
            "params": {"alpha": [row["alpha_x"], row["alpha_y"]], "reflectance": GOLD},
            "wo": [row["wo_theta"], row["wo_phi"]],
            "wi": [row["wi_theta"], row["wi_phi"]],
            "samples": EVALS,
        })
    };
    let columns = [("F1", "F1_se"), ("g_F0_782", "g_se"), ("b_F0_344", "b_se")];
    let expected = |row: &Value| columns.map(|(value, se)| (number(row, value), number(row, se)));
    let questions: Vec<Value> = table.iter().map(question).collect();
    let expected: Vec<_> = table.iter().map(expected).collect();
    agree("conductor", "f_cos", &questions, &expected, WALK_SLACK, 0.0);
}

/// The parameters of a row of the tables of layered materials; eta and g are as the defaults where they may be.
fn layered_params(row: &Value) -> Value {
    json!({
        "alpha": row["alpha"], "eta": row["eta"], "sigma_t": row["sigma_T"],
        "albedo": row["albedo"], "base": row["rho"],
    })
}

#[test]
fn layered_materials() {
    let table = table("layered_eval.json");
    let question = |row: &Value| {
        json!({
            "params": layered_params(row), "wo": row["wo_deg"], "wi": row["wi_deg"], "samples": EVALS,
        })
    };
    let questions: Vec<Value> = table.iter().map(question).collect();
    let expected: Vec<_> = table.iter().map(|row| channels(row, "fcos", "se")).collect();
    agree("layered", "f_cos", &questions, &expected, WALK_SLACK, 0.0);
}

#[test]
fn albedos_of_layered_materials() {
    let table = table("layered_albedo.json");
    let question = |row: &Value| {
        json!({
            "params": layered_params(row), "wo": [row["theta_o"], 25], "albedo": true, "samples": WALKS,
        })
    };
    let questions: Vec<Value> = table.iter().map(question).collect();
    let expected: Vec<_> = table
        .iter()
        .map(|row| channels(row, "dir_albedo", "se"))
        .collect();
    agree("layered", "albedo", &questions, &expected, WALK_SLACK, 0.0);
}

#[test]
fn albedos_of_conductors() {
    let table = table("conductor_albedo.json");
    let question = |row: &Value| {
        json!({
            "params": {"alpha": [row["alpha_x"], row["alpha_y"]], "reflectance": GOLD},
            "wo": [row["wo_theta"], row["wo_phi"]], "albedo": true, "samples": WALKS,
        })
    };
    let expected = |row: &Value| [1.0, number(row, "g_F0_782"), number(row, "b_F0_344")];
    let errors = |row: &Value| [0.0, number(row, "g_se"), number(row, "b_se")];
    let questions: Vec<Value> = table.iter().map(question).collect();
    let expected: Vec<_> = table
        .iter()
        .map(|row| std::array::from_fn(|c| (expected(row)[c], errors(row)[c])))
        .collect();
    agree("conductor", "albedo", &questions, &expected, WALK_SLACK, 0.0);
}

/// Mitsuba's values of principled surfaces; the parameters that a row does not name are at their defaults, which
/// for the first table is said in its note of all but the base colour.
#[test]
fn principled_surfaces() {
    for (name, base_color) in [
        ("principled_eval.json", Some(json!([0.8, 0.4, 0.1]))),
        ("principled_lobes.json", None),
    ] {
        let table = table(name);
        let question = |row: &Value| {
            let mut params = row.as_object().expect("rows are objects").clone();
            // What is no parameter.
            for key in ["bsdf", "wo_deg", "wi_deg", "eval_fcos", "pdf"] {
                params.remove(key);
            }
            if let Some(color) = &base_color {
                params.insert("base_color".into(), color.clone());
            }
            json!({"params": params, "wo": row["wo_deg"], "wi": row["wi_deg"]})
        };
        let questions: Vec<Value> = table.iter().map(question).collect();
        let expected: Vec<_> = table
            .iter()
            .map(|row| rgb(row, "eval_fcos").map(|value| (value, 0.0)))
            .collect();
        agree(
            "principled",
            "f_cos",
            &questions,
            &expected,
            MITSUBA_SLACK,
            MITSUBA_FLOOR,
        );
    }
}
