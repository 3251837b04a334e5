//! `bake query` through the real program: against the reference tables, in any order, in conversation, and with every
//! kind of bad row.

#[path = "support/complaint.rs"]
mod complaint;
#[path = "support/program.rs"]
mod program;

use complaint::complains;
use program::{SCENE, Studio, finish};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Output, Stdio};
use std::sync::mpsc;
use std::time::Duration;

/// Agreement asked of a Monte Carlo comparison, in combined standard errors.
const SIGMAS: f64 = 3.0;
/// Relative slack beside the standard errors: a row of the table holds as few as 100 000 walks, so rare bright ones may
/// be missing from its mean and from its standard error alike.
const TABLE_SLACK: f64 = 5e-3;
/// Round-off of a unit vector, in f64 and of the f32 that networks answer in.
const UNIT_TOL: f64 = 1e-12;
const UNIT_TOL_F32: f64 = 1e-6;
/// Largest relative error of the shipped evaluation and pdf networks at one direction inside the lobe: their mean
/// error is below 1 %.
const NETWORK_TOL: f64 = 0.05;
/// Largest bias of the shipped sampling network's mean weight below 75°; its card says 0.029 for the worst channel.
const LEARNED_BIAS_MAX: f64 = 0.03;
/// Far more than an answer takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// The parameters of the shipped vase.
const GOLD: &str = r#""params": {"alpha": [0.3, 0.1], "reflectance": [1, 0.782, 0.344]}"#;

/// Runs `bake query` with `arguments` on `input`.
fn query(studio: &Studio, arguments: &[&str], input: &str) -> Output {
    let mut command = studio.bake(&[&["query"], arguments].concat());
    let mut child = command.stdin(Stdio::piped()).spawn().expect("the program starts");
    let mut stdin = child.stdin.take().expect("it is piped");
    let input = input.to_string();
    // Answers fill their pipe while questions are still written; a bad row ends the program early.
    let writer = std::thread::spawn(move || drop(stdin.write_all(input.as_bytes())));
    let output = finish_reading(child);
    writer.join().expect("it does not panic");
    output
}

/// What `child` printed, read while it runs.
fn finish_reading(mut child: std::process::Child) -> Output {
    let stdout = child.stdout.take().expect("it is piped");
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        let mut text = Vec::new();
        let read = std::io::Read::read_to_end(&mut BufReader::new(stdout), &mut text);
        drop(sender.send(read.map(|_| text)));
    });
    let mut output = finish(child, PATIENCE);
    output.stdout = receiver
        .recv_timeout(PATIENCE)
        .expect("the pipe is closed")
        .expect("it can be read");
    output
}

/// The answers to `rows`, all of which are good.
fn answers(arguments: &[&str], rows: &[String]) -> Vec<Value> {
    let output = query(&Studio::new(), arguments, &(rows.join("\n") + "\n"));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && errors.is_empty(), "{errors}");
    let text = String::from_utf8(output.stdout).expect("JSON is UTF-8");
    let answers: Vec<Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{line}: {e}")))
        .collect();
    assert_eq!(answers.len(), rows.len());
    answers
}

fn rgb(answer: &Value, key: &str) -> [f64; 3] {
    std::array::from_fn(|c| {
        answer[key][c]
            .as_f64()
            .unwrap_or_else(|| panic!("no `{key}` in {answer}"))
    })
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or_else(|| panic!("no `{key}` in {row}"))
}

/// The networks that ship.
fn model() -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/materials/vase");
    folder.to_str().expect("the tree has a name in UTF-8").into()
}

#[test]
fn conductors_agree_with_the_reference_table() {
    const SAMPLES: u64 = 200_000;
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference/conductor_eval.json");
    let text = std::fs::read_to_string(path).expect("the table is part of the tree");
    let table: Value = serde_json::from_str(&text).expect("it is JSON");
    let table = table["rows"].as_array().expect("it has rows");
    let rows: Vec<String> = table
        .iter()
        .map(|row| {
            json!({
                "params": {"alpha": [row["alpha_x"], row["alpha_y"]], "reflectance": [1, 0.782, 0.344]},
                "wo": [row["wo_theta"], row["wo_phi"]],
                "wi": [row["wi_theta"], row["wi_phi"]],
                "samples": SAMPLES,
            })
            .to_string()
        })
        .collect();
    let answers = answers(&["conductor"], &rows);
    for ((expected, answer), row) in table.iter().zip(&answers).zip(&rows) {
        let asked: Value = serde_json::from_str(row).expect("just made");
        for key in ["params", "wo", "wi", "samples"] {
            assert_eq!(answer[key], asked[key], "the row comes back");
        }
        let (mean, se) = (rgb(answer, "f_cos"), rgb(answer, "se"));
        let columns = [("F1", "F1_se"), ("g_F0_782", "g_se"), ("b_F0_344", "b_se")];
        for (c, (value, value_se)) in columns.into_iter().enumerate() {
            let (value, value_se) = (number(expected, value), number(expected, value_se));
            let allowed = SIGMAS * se[c].hypot(value_se) + TABLE_SLACK * value;
            assert!(
                (mean[c] - value).abs() <= allowed,
                "channel {c}: {answer}, expected {value}"
            );
        }
        assert!(number(answer, "pdf") > 0.0);
    }
}

#[test]
fn answers_depend_on_their_row_and_the_seed_alone() {
    let angles = |i: usize| (7 * i % 89, 31 * i % 360);
    let rows: Vec<String> = (0..600)
        .map(|i| {
            let ((a, b), (c, d)) = (angles(i + 3), angles(2 * i + 11));
            match i % 3 {
                0 => format!(r#"{{{GOLD}, "wo": [{a}, {b}], "wi": [{c}, {d}], "samples": 20}}"#),
                1 => format!(r#"{{{GOLD}, "wo": [{a}, {b}], "u": [0.{i}, 0.25]}}"#),
                _ => format!(r#"{{{GOLD}, "wo": [{a}, {b}], "albedo": true, "samples": 50}}"#),
            }
        })
        .collect();
    let forth = answers(&["conductor"], &rows);
    let reversed: Vec<String> = rows.iter().rev().cloned().collect();
    let mut back = answers(&["conductor", "--threads", "1"], &reversed);
    back.reverse();
    assert_eq!(forth, back);
    let other = answers(&["conductor", "--seed", "2"], &rows);
    for kind in 0..3 {
        // A sample after one bounce owes nothing to chance.
        let mut rows = (kind..rows.len()).step_by(3);
        assert!(
            rows.any(|i| forth[i] != other[i]),
            "answers of kind {kind} are random"
        );
    }
    // A material that fixes everything, with and without its parameters said again.
    let bare: Vec<String> = rows
        .iter()
        .map(|row| row.replace(&format!("{GOLD}, "), ""))
        .collect();
    let [said, unsaid] = [&rows, &bare].map(|rows| answers(&["vase"], rows));
    for ((said, unsaid), forth) in said.iter().zip(&unsaid).zip(&forth) {
        assert_eq!(said, forth);
        for key in ["f_cos", "wi", "weight", "albedo", "se", "pdf"] {
            assert_eq!(said[key], unsaid[key], "{said}");
        }
    }
}

#[test]
fn samples_average_to_the_albedo() {
    const SIDE: usize = 64;
    let mut rows = vec![format!(r#"{{{GOLD}, "wo": [60, 20], "albedo": true}}"#)];
    for i in 0..SIDE * SIDE {
        let u = [i % SIDE, i / SIDE].map(|k| (k as f64 + 0.5) / SIDE as f64);
        rows.push(format!(r#"{{{GOLD}, "wo": [60, 20], "u": {u:?}}}"#));
    }
    let answers = answers(&["conductor"], &rows);
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
            "channel {c}: {mean}, {albedo:?}"
        );
    }
    for answer in answers[1..].iter().filter(|a| !a["wi"].is_null()) {
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
    assert!((x * x + y * y + z * z - 1.0).abs() < UNIT_TOL_F32, "{}", baked[2]);
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

#[test]
fn metals_have_names() {
    let row = |metal: &str| {
        format!(r#"{{"params": {{"alpha": [0.2, 0.2], "ior": {metal}}}, "wo": [30, 0], "albedo": true}}"#)
    };
    let numbers = r#"{"eta": [0.143036, 0.375307, 1.442045], "k": [3.982997, 2.385556, 1.603359]}"#;
    let rows = [r#""gold""#, r#""au""#, numbers, r#""Silver""#].map(row);
    let found = answers(&["conductor"], &rows)
        .iter()
        .map(|a| rgb(a, "albedo"))
        .collect::<Vec<_>>();
    assert!(found[0] == found[1] && found[0] == found[2], "{found:?}");
    assert!(
        found[0][0] > found[0][1] && found[0][1] > found[0][2],
        "gold is yellow: {found:?}"
    );
    assert!(found[3][2] > found[0][2], "silver is brighter: {found:?}");
}

#[test]
fn a_conversation_gets_every_answer_at_once() {
    let studio = Studio::new();
    let mut command = studio.bake(&["query", "vase"]);
    let mut child = command.stdin(Stdio::piped()).spawn().expect("the program starts");
    let mut stdin = child.stdin.take().expect("it is piped");
    let stdout = BufReader::new(child.stdout.take().expect("it is piped"));
    let (sender, receiver) = mpsc::channel();
    let reader = std::thread::spawn(move || {
        for line in stdout.lines() {
            drop(sender.send(line.expect("answers are UTF-8")));
        }
    });
    for theta in [10, 50, 80] {
        // In two parts: half a line is no question yet.
        write!(stdin, r#"{{"wo": [{theta}, 0], "#).expect("it listens");
        stdin.flush().expect("it listens");
        std::thread::sleep(Duration::from_millis(20));
        writeln!(stdin, r#""albedo": true}}"#).expect("it listens");
        stdin.flush().expect("it listens");
        let answer = receiver
            .recv_timeout(PATIENCE)
            .expect("an answer before the next question");
        assert!(answer.contains(&format!(r#""wo": [{theta}, 0]"#)), "{answer}");
    }
    // The last line needs no end.
    write!(stdin, "\n{{\"wo\": [1, 0], \"albedo\": true}}").expect("it listens");
    drop(stdin);
    assert!(
        receiver
            .recv_timeout(PATIENCE)
            .expect("the last answer")
            .contains(r#""wo": [1, 0]"#)
    );
    let status = child.wait().expect("the child is ours");
    assert!(status.success(), "{status}");
    reader.join().expect("it does not panic");
}

#[test]
fn nobody_listening_is_no_failure() {
    let studio = Studio::new();
    let mut command = studio.bake(&["query", "vase"]);
    let mut child = command.stdin(Stdio::piped()).spawn().expect("the program starts");
    drop(child.stdout.take());
    let mut stdin = child.stdin.take().expect("it is piped");
    let rows = "{\"wo\": [10, 0], \"wi\": [20, 0], \"samples\": 2}\n".repeat(20_000);
    // It may stop reading at any row.
    drop(stdin.write_all(rows.as_bytes()));
    drop(stdin);
    let output = finish(child, PATIENCE);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && errors.is_empty(), "{errors}");
}

/// Asserts that `row` is refused with one line that names it and has all of `parts`, after the row before it was
/// answered and though another follows.
fn refuses(arguments: &[&str], row: &str, parts: &[&str]) {
    let good = format!(r#"{{{GOLD}, "wo": [45, 0], "wi": [30, 180], "samples": 2}}"#);
    let output = query(&Studio::new(), arguments, &format!("{good}\n\n{row}\n{good}\n"));
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

#[test]
fn bad_rows_are_named() {
    let at = r#""wo": [45, 0], "wi": [30, 180]"#;
    let with = |params: &str| format!(r#"{{"params": {{{params}}}, {at}}}"#);
    let f0 = r#""reflectance": [1, 1, 1]"#;
    let cases: [(String, &[&str]); 17] = [
        ("nonsense".into(), &["not a JSON object"]),
        (format!("{{{at}"), &["not a JSON object"]),
        (
            format!("{{{GOLD}, {at}}} {{}}"),
            &["not a JSON object", "trailing"],
        ),
        ("[1, 2]".into(), &["not a JSON object"]),
        (
            format!("{{{at}}}"),
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
        (
            format!(r#"{{{GOLD}, {at}, "samples": -1}}"#),
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
