//! The rows of `bake maps --compare`: what they hold, in which order, and what is drawn beside them.

use crate::program::Studio;
use crate::signals::{interrupt, wait_for};
use crate::{METAL, json, studio, succeed};
use bake_scenes::grey_picture::read_grey;
use bake_scenes::picture::write_codes;
use bake_train::transport::Solver;
use serde_json::Value;
use std::collections::BTreeSet;
use std::process::Command;

/// Polar angles of `wo` that are compared, degrees.
const THETAS_DEG: [f64; 5] = [10.0, 45.0, 75.0, 85.0, 89.0];

/// Keys of a row.
const KEYS: [&str; 11] = [
    "slice",
    "solver",
    "n",
    "cost_ratio",
    "fold_fraction",
    "max_stretch",
    "binning_l1",
    "binning_floor",
    "outside",
    "seconds",
    "fallback",
];
/// Cells of a map.
const CELLS: usize = 32 * 32;
/// No assignment is cheaper than the exact one, round-off aside; only point maps are bound by that.
const COST_TOL: f64 = 1e-9;
/// A gradient on a slope bins at 128² to a few thousandths and at 32² to 0.02; twice that is not chance.
const SLOPE_L1_MAX: f64 = 0.04;
/// Pixels of the picture.
const SIZE: [usize; 2] = [48, 32];

/// `bake maps SUBJECT --compare --cells CELLS` and what else is asked.
fn compare(studio: &Studio, subject: &str, cells: &str, more: &[&str]) -> Command {
    studio.bake(&[&["maps", subject, "--compare", "--cells", cells], more].concat())
}

/// Asserts that `rows` are those of `slices` by `solvers`.
fn assert_rows(rows: &Value, slices: &[String], solvers: &[Solver]) {
    let rows = rows.as_array().expect("a list");
    let found: Vec<[&str; 2]> = rows
        .iter()
        .map(|row| ["slice", "solver"].map(|key| row[key].as_str().expect("a string")))
        .collect();
    let expected: Vec<[&str; 2]> = slices
        .iter()
        .flat_map(|slice| solvers.iter().map(move |solver| [&slice[..], solver.name()]))
        .collect();
    assert_eq!(found, expected);
    for row in rows {
        let keys: BTreeSet<&str> = row
            .as_object()
            .expect("an object")
            .keys()
            .map(String::as_str)
            .collect();
        assert_eq!(keys, BTreeSet::from(KEYS), "{row}");
        let number = |key: &str| {
            row[key]
                .as_f64()
                .filter(|v| v.is_finite())
                .unwrap_or_else(|| panic!("{key} in {row}"))
        };
        assert_eq!(row["n"], CELLS);
        assert_eq!(row["fallback"], Value::Null, "{row}");
        assert!((0.0..=1.0).contains(&number("fold_fraction")) && (0.0..=1.0).contains(&number("outside")));
        assert!((0.0..2.0).contains(&number("binning_l1")) && number("binning_floor") > 0.0);
        assert!(number("max_stretch") >= 1.0 && number("seconds") > 0.0 && number("cost_ratio") > 0.0);
        match row["solver"].as_str() {
            Some("exact") => assert!((number("cost_ratio") - 1.0).abs() < COST_TOL, "{row}"),
            Some("sinkhorn_sliced") => assert!(number("cost_ratio") >= 1.0 - COST_TOL, "{row}"),
            Some("frame") => assert_eq!((number("fold_fraction"), number("outside")), (0.0, 0.0), "{row}"),
            _ => {}
        }
    }
}

/// A slope, brighter towards the right.
fn write_slope(studio: &Studio) {
    let codes: Vec<u8> = (0..SIZE[0] * SIZE[1])
        .flat_map(|k| [(100 + 3 * (k % SIZE[0])) as u8; 3])
        .collect();
    write_codes(&studio.path("slope.png"), SIZE, &codes).expect("it can be written");
}

#[test]
fn rows_of_a_picture() {
    let studio = Studio::new();
    write_slope(&studio);
    let rows = json(compare(
        &studio,
        "slope.png",
        "32",
        &["--out", "compared", "--json"],
    ));
    assert_rows(&rows, &["slope".into()], &Solver::ALL);
    let frame = rows.as_array().and_then(|rows| rows.last()).expect("rows");
    assert!(frame["binning_l1"].as_f64() < Some(SLOPE_L1_MAX), "{frame}");
    let sheet = read_grey(&studio.path("compared/comparison.png")).expect("a picture");
    assert!(sheet.values.iter().any(|v| *v > 0.0));
}

#[test]
fn rows_of_a_material() {
    let studio = studio();
    let rows = json(compare(
        &studio,
        METAL,
        "32",
        &["--set", "roughness=0.5", "--json"],
    ));
    let slices = THETAS_DEG.map(|theta| format!("metal θ {theta}°"));
    assert_rows(&rows, &slices, &Solver::ALL);
    assert!(studio.path("out/maps/metal/comparison.png").exists());
}

/// Nothing is half-written, and nothing is said of a way to go on: there is none.
#[test]
fn ctrl_c_ends_a_comparison() {
    let studio = Studio::new();
    write_slope(&studio);
    let mut child = compare(&studio, "slope.png", "128,256", &["--out", "compared"])
        .spawn()
        .expect("the program starts");
    wait_for(&mut child, || studio.path("compared").exists());
    let said = interrupt(child, &studio);
    assert!(said.ends_with("bake: interrupted\n"), "{said}");
    assert!(!studio.path("compared/comparison.png").exists());
}

/// The table for people says the same, and solvers are those asked for, in the order of the flag.
#[test]
fn a_table_of_some_solvers() {
    let studio = Studio::new();
    write_slope(&studio);
    let table = succeed(compare(
        &studio,
        "slope.png",
        "32",
        &["--solver", "frame,marginal"],
    ));
    let rows: Vec<&str> = table.lines().filter(|line| line.starts_with("slope")).collect();
    assert!(
        rows.len() == 2 && rows[0].contains("frame") && rows[1].contains("marginal"),
        "{table}"
    );
    assert!(
        table.contains("binning") && table.contains("comparison.png"),
        "{table}"
    );
}
