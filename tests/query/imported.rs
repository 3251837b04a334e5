//! Rows of the family `imported`: a small file made from its documentation, asked by name and through a material.

use crate::bad_rows::refuses_in;
use crate::program::Studio;
use crate::slices_file::SlicesFile;
use crate::{answers_in, number, rgb};
use std::f64::consts::FRAC_1_PI;
use std::time::{Duration, Instant};

/// Numbers pass through single precision once, in sums of sixteen terms.
const ROUND_OFF: f64 = 1e-6;
/// A table that is read, blended or made ready for sampling again for every row takes minutes.
const SECONDS_MAX: Duration = Duration::from_secs(5);

/// Values of the parameter and of θ, degrees, that the table holds.
const GLOSSES: [f32; 3] = [0.0, 0.5, 1.0];
const THETAS: [f32; 4] = [0.0, 30.0, 60.0, 85.0];
/// Pixels per side of a slice.
const SIDE: usize = 24;

/// The file in the studio's folder.
const FILE: &str = "felt.safetensors";

/// f, RGB, sr⁻¹, for `wo` over x: linear in everything that is interpolated linearly.
fn f([gloss, theta]: [f64; 2], [x, y, _]: [f64; 3]) -> [f64; 3] {
    [
        (1.0 + gloss) * (2.0 - x),
        (1.0 + theta / 90.0) * (2.0 + y),
        3.0 + x - y,
    ]
    .map(|f| 0.1 * FRAC_1_PI * f)
}

fn felt() -> SlicesFile {
    SlicesFile::isotropic("gloss", &GLOSSES, &THETAS, SIDE, f)
}

/// Writes the file, and gives the parameters that a row asks it with.
pub fn params(studio: &Studio) -> String {
    felt().write(&studio.path(FILE));
    format!(r#""params": {{"file": "{FILE}", "gloss": 0.3}}"#)
}

/// Writes the file and a material beside it, and gives the name of that.
fn material(studio: &Studio) -> String {
    felt().write(&studio.path("scenes/materials/felt.safetensors"));
    let text = "family = \"imported\"\nfile = \"felt.safetensors\"\ngloss = { min = 0.2, max = 0.8 }\n";
    let file = "scenes/materials/felt.toml";
    std::fs::write(studio.path(file), text).expect("it can be written");
    file.into()
}

#[test]
fn values_are_those_of_the_table() {
    let studio = Studio::new();
    params(&studio);
    let file = material(&studio);
    let mut rows = Vec::new();
    let mut expected = Vec::new();
    for i in 0..200 {
        let at = i as f64 / 200.0;
        let (gloss, theta, phi) = (
            0.2 + 0.6 * at,
            85.0 * (7.0 * at).fract(),
            360.0 * (3.0 * at).fract(),
        );
        // Within the cells whose neighbours are all inside the disk.
        let (wi_theta, wi_phi) = (50.0 * (13.0 * at).fract(), 360.0 * (11.0 * at).fract());
        rows.push(format!(
            r#"{{"params": {{"gloss": {gloss}}}, "wo": [{theta}, {phi}], "wi": [{wi_theta}, {wi_phi}]}}"#
        ));
        let (sin, cos) = f64::to_radians(wi_theta).sin_cos();
        let (y, x) = f64::to_radians(wi_phi - phi).sin_cos();
        let wi = [sin * x, sin * y, cos];
        expected.push(f([gloss, theta], wi).map(|f| f * cos));
    }
    let by_file: Vec<String> = rows
        .iter()
        .map(|row| row.replace(r#""gloss""#, &format!(r#""file": "{FILE}", "gloss""#)))
        .collect();
    for answers in [
        answers_in(&studio, &["imported"], &by_file),
        answers_in(&studio, &["felt"], &rows),
        answers_in(&studio, &[&file], &rows),
    ] {
        for (answer, expected) in answers.iter().zip(&expected) {
            let found = rgb(answer, "f_cos");
            for c in 0..3 {
                assert!(
                    (found[c] - expected[c]).abs() < ROUND_OFF,
                    "channel {c}: {answer}, {expected:?}"
                );
            }
            assert!(
                rgb(answer, "se") == [0.0; 3] && number(answer, "pdf") > 0.0,
                "{answer}"
            );
        }
    }
}

#[test]
fn a_table_is_read_once_for_all_rows() {
    /// Ten megabytes in fifty slices.
    const LARGE: usize = 128;
    const ROWS: usize = 10_000;
    let studio = Studio::new();
    let glosses = [0.0, 0.25, 0.5, 0.75, 1.0];
    let thetas: Vec<f32> = (0..10).map(|k| 9.5 * k as f32).collect();
    SlicesFile::isotropic("gloss", &glosses, &thetas, LARGE, f).write(&studio.path(FILE));
    let rows: Vec<String> = (0..ROWS)
        .map(|i| {
            let (theta, gloss) = (i % 89, [0.1, 0.6, 0.9][i % 3]);
            let ask = match i % 2 {
                0 => r#""wi": [40, 180]"#,
                _ => r#""u": [0.3, 0.7]"#,
            };
            format!(r#"{{"params": {{"file": "{FILE}", "gloss": {gloss}}}, "wo": [{theta}, 10], {ask}}}"#)
        })
        .collect();
    let begin = Instant::now();
    answers_in(&studio, &["imported"], &rows);
    let taken = begin.elapsed();
    assert!(taken < SECONDS_MAX, "{ROWS} rows took {taken:?}");
}

#[test]
fn bad_rows_are_named() {
    let studio = Studio::new();
    let good = params(&studio);
    material(&studio);
    let at = r#""wo": [45, 0], "wi": [30, 180]"#;
    let good = format!("{{{good}, {at}}}");
    let refused = |params: &str, parts: &[&str]| {
        let row = format!(r#"{{"params": {{{params}}}, {at}}}"#);
        refuses_in(&studio, &["imported"], &good, &row, parts);
    };
    let of_file = |rest: &str| format!(r#""file": "{FILE}"{rest}"#);
    refused("", &["`file`", "missing field", "the name of a file"]);
    refused(
        r#""file": 3, "gloss": 0.5"#,
        &["`file`", "is 3", "the name of a file"],
    );
    refused(
        r#""file": "silk.safetensors", "gloss": 0.5"#,
        &["silk.safetensors", "No such file"],
    );
    refused(&of_file(""), &["`gloss`", "missing field"]);
    refused(&of_file(r#", "gloss": 1.5"#), &["`gloss`", "is 1.5", "0..1"]);
    refused(
        &of_file(r#", "gloss": [0.5]"#),
        &["`gloss`", "is [0.5]", "a number"],
    );
    refused(
        &of_file(r#", "gloss": 0.5, "wear": 1"#),
        &["`wear`", FILE, "no such parameter", "`gloss`"],
    );
    refuses_in(
        &studio,
        &["felt"],
        &good.replace(&format!(r#""file": "{FILE}", "#), ""),
        &format!(r#"{{"params": {{"gloss": 0.1}}, {at}}}"#),
        &["`gloss`", "is 0.1", "must lie in 0.2..0.8"],
    );
}

/// Files that are no tables, and tables that are wrong: the row that names one is refused.
#[test]
fn broken_files_are_named() {
    let studio = Studio::new();
    let good = params(&studio);
    let at = r#""wo": [45, 0], "wi": [30, 180]"#;
    let good = format!("{{{good}, {at}}}");
    let refused = |parts: &[&str]| {
        let row = format!(r#"{{"params": {{"file": "broken.safetensors", "gloss": 0.5}}, {at}}}"#);
        let named = [&["broken.safetensors"], parts].concat();
        refuses_in(&studio, &["imported"], &good, &row, &named);
    };
    let broken = studio.path("broken.safetensors");
    for (value, said) in [(-0.5, "-0.5"), (f32::NAN, "NaN"), (f32::INFINITY, "inf")] {
        let mut file = felt();
        // The second channel of a pixel near the middle of slice 1.
        file.f_cos[3 * (SIDE * SIDE + SIDE * 12 + 11) + 1] = value;
        file.write(&broken);
        refused(&["f_cos[1, 12, 11, 1]", said, "must lie in 0..", "per steradian"]);
    }
    let mut file = felt();
    file.rows[2][1] = 90.0;
    file.write(&broken);
    refused(&["wo[2, 0]", "is 90", "0..90"]);
    let mut file = felt();
    file.rows[2][0] = f32::NAN;
    file.write(&broken);
    refused(&["params[2, 0]", "is NaN", "finite"]);
    let mut file = felt();
    file.rows[2] = file.rows[1].clone();
    file.write(&broken);
    refused(&["rows 1 and 2", "gloss = 0", "theta = 30"]);
    let mut file = felt();
    file.rows.pop();
    file.f_cos.truncate(3 * SIDE * SIDE * file.rows.len());
    file.write(&broken);
    refused(&["no row has gloss = 1, theta = 85"]);
    let whole = {
        felt().write(&broken);
        std::fs::read(&broken).expect("it was just written")
    };
    // Other shapes of as many numbers, in headers of the same length.
    for (shape, other, said) in [
        (
            "[12, 24, 24, 3]",
            "[12, 24, 72, 1]",
            "`f_cos` is [12, 24, 72, 1], but must be [N, H, W, 3]",
        ),
        (
            "[12, 24, 24, 3]",
            "[24, 12, 24, 3]",
            "`wo` is [12, 2], but must be [24, 2]",
        ),
        ("[12, 2]", "[24, 1]", "`wo` is [24, 1], but must be [12, 2]"),
    ] {
        let at = whole
            .windows(shape.len())
            .position(|bytes| bytes == shape.as_bytes())
            .expect("the shape is in the header");
        let bytes = [&whole[..at], other.as_bytes(), &whole[at + shape.len()..]].concat();
        std::fs::write(&broken, bytes).expect("it can be written");
        refused(&[said]);
    }
    std::fs::write(&broken, &whole[..whole.len() / 2]).expect("it can be written");
    refused(&["not a whole safetensors file"]);
    std::fs::write(&broken, "").expect("it can be written");
    refused(&["not a whole safetensors file"]);
}
