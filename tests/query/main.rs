//! `bake query` through the real program: against the reference tables, in any order, in conversation, and with every
//! kind of bad row, for every family and for networks.

#[path = "../support/complaint.rs"]
mod complaint;
#[path = "../support/program.rs"]
mod program;
#[path = "../support/slices_file.rs"]
mod slices_file;

mod bad_rows;
mod edges;
mod imported;
mod materials;
mod networks;
mod rows;
mod stream;
mod tables;

use program::{Studio, finish};
use serde_json::Value;
use std::io::{BufReader, Write};
use std::process::{Output, Stdio};
use std::sync::mpsc;
use std::time::Duration;

/// Far more than an answer takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// The parameters of the shipped vase.
const GOLD: &str = r#""params": {"alpha": [0.3, 0.1], "reflectance": [1, 0.782, 0.344]}"#;

/// A varnish over a painted wall, no parameter at its default.
const VARNISH: &str = concat!(
    r#""params": {"alpha": 0.2, "eta": 1.4, "sigma_t": 0.8, "albedo": [0.9, 0.6, 0.3], "#,
    r#""base": [0.8, 0.5, 0.2], "g": 0.5}"#
);

/// A principled surface with every lobe.
const PAINT: &str = concat!(
    r#""params": {"base_color": [0.8, 0.4, 0.1], "metallic": 0.2, "roughness": 0.4, "specular": 0.7, "#,
    r#""specular_tint": 0.4, "anisotropic": 0.6, "sheen": 0.8, "sheen_tint": 0.5, "clearcoat": 0.9, "#,
    r#""clearcoat_gloss": 0.3, "flatness": 0.4}"#
);

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
    answers_in(&Studio::new(), arguments, rows)
}

/// The same, asked in a folder of the caller's.
fn answers_in(studio: &Studio, arguments: &[&str], rows: &[String]) -> Vec<Value> {
    let output = query(studio, arguments, &(rows.join("\n") + "\n"));
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
