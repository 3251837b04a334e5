//! `bake material` through the real program, and materials of every family that cannot be baked yet.

#[path = "support/complaint.rs"]
mod complaint;
#[path = "support/program.rs"]
mod program;
#[path = "support/slices_file.rs"]
mod slices_file;

use complaint::complains;
use program::{MATERIAL_FILE, SCENE, Studio, finish};
use serde_json::{Value, json};
use slices_file::SlicesFile;
use std::f64::consts::FRAC_1_PI;
use std::time::Duration;

/// Small pictures of few walks are a matter of a second; the rest is for a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// Standard errors allowed between two albedos: 30 comparisons exceed 4.5 by chance once in 5000 runs.
const SIGMAS: f64 = 4.5;

/// Round-off of a table, which holds f32.
const SINGLE_PRECISION: f64 = 1e-6;

/// Options of pictures that are made at once.
const SMALL: [&str; 4] = ["--size", "16", "--samples", "64"];

fn show(studio: &Studio, arguments: &[&str]) -> (String, String) {
    let mut command = studio.bake(&[&["material"], arguments, &SMALL].concat());
    let output = finish(command.spawn().expect("the program starts"), PATIENCE);
    let errors = String::from_utf8(output.stderr).expect("messages are UTF-8");
    assert!(output.status.success(), "{arguments:?}: {errors}");
    (
        String::from_utf8(output.stdout).expect("reports are UTF-8"),
        errors,
    )
}

fn report(studio: &Studio, arguments: &[&str]) -> Value {
    let (printed, _) = show(studio, &[arguments, &["--json"]].concat());
    serde_json::from_str(&printed).unwrap_or_else(|e| panic!("{printed}: {e}"))
}

#[test]
fn a_material_is_described_and_drawn() {
    let studio = Studio::new();
    let (printed, errors) = show(&studio, &["vase", "--theta", "0,62.5", "--phi", "-30"]);
    for part in [
        "vase (conductor)",
        "[0.3,0.1]",
        "[1.0,0.782,0.344]",
        "62.5°",
        "89°",
        "1.00000",
        "slices.png",
    ] {
        assert!(printed.contains(part), "`{part}` is not in: {printed}");
    }
    assert!(!errors.contains("warning"), "{errors}");
    let files = [
        "slice-theta-0-phi--30.exr",
        "slice-theta-62.5-phi--30.exr",
        "slices.png",
    ];
    let folder = studio.path("out/materials/vase");
    let mut found: Vec<String> = std::fs::read_dir(&folder)
        .expect("the folder is there")
        .map(|entry| {
            entry
                .expect("it can be read")
                .file_name()
                .to_string_lossy()
                .into_owned()
        })
        .collect();
    found.sort();
    assert_eq!(found, files);
}

#[test]
fn families_take_values_from_the_command_line() {
    let studio = Studio::new();
    let from = |set: &[&str]| {
        let sets: Vec<&str> = set.iter().flat_map(|s| ["--set", s]).collect();
        report(&studio, &[&["conductor", "--theta", "45"], &sets[..]].concat())
    };
    let gold = from(&["alpha=[0.3, 0.1]", "reflectance=[1,0.782,0.344]"]);
    let vase = report(&studio, &["vase", "--theta", "45"]);
    for key in ["albedo", "samples"] {
        assert_eq!(gold[key], vase[key], "{key}");
    }
    let preset = from(&["alpha=[0.3,0.1]", "ior=Gold"]);
    assert_eq!(preset["material"]["ior"]["eta"][2], 1.442045);
    // A white surface keeps all light at every angle.
    let white = from(&["alpha=[0.3,0.1]", "reflectance=[1,1,1]"]);
    for row in white["albedo"].as_array().expect("a list") {
        for c in 0..3 {
            let [albedo, se] = ["albedo", "se"].map(|key| row[key][c].as_f64().expect("a number"));
            assert!((albedo - 1.0).abs() <= SIGMAS * se + f64::EPSILON, "{row}");
        }
    }
}

/// Every family is drawn, its albedo known: a white slab without an interface, a black surface, and a table of a
/// Lambertian one.
#[test]
fn every_family_is_drawn() {
    /// Reflectance of the table.
    const GREY: f64 = 0.4;
    let studio = Studio::new();
    let lambert = |_: [f64; 2], _: [f64; 3]| [GREY * FRAC_1_PI; 3];
    let file = SlicesFile::isotropic("gloss", &[0.0, 1.0], &[0.0, 80.0], 16, lambert);
    file.write(&studio.path("felt.safetensors"));
    let cases: [(&str, &[&str], f64); 3] = [
        (
            "layered",
            &[
                "alpha=0.1",
                "eta=1",
                "sigma_t=1",
                "albedo=[1,1,1]",
                "base=[1,1,1]",
            ],
            1.0,
        ),
        ("principled", &["base_color=[0,0,0]", "specular=0"], 0.0),
        ("imported", &["file=felt.safetensors", "gloss=0.25"], GREY),
    ];
    for (family, set, expected) in cases {
        let sets: Vec<&str> = set.iter().flat_map(|s| ["--set", s]).collect();
        let shown = report(&studio, &[&[family, "--theta", "45"], &sets[..]].concat());
        assert_eq!(shown["material"]["family"], family);
        let rows = shown["albedo"].as_array().expect("a list");
        assert!(!rows.is_empty());
        for row in rows {
            for c in 0..3 {
                let [albedo, se] = ["albedo", "se"].map(|key| row[key][c].as_f64().expect("a number"));
                let allowed = SIGMAS * se + SINGLE_PRECISION;
                assert!((albedo - expected).abs() <= allowed, "{family}: {row}");
            }
        }
        let folder = studio.path("out/materials").join(family);
        for picture in ["slice-theta-45-phi-0.exr", "slices.png"] {
            assert!(folder.join(picture).is_file(), "{family} has no {picture}");
        }
    }
}

#[test]
fn what_is_free_is_shown_at_the_middle_of_its_range() {
    let studio = Studio::new();
    let text = "family = \"conductor\"\nalpha = [{ min = 0.2, max = 0.4 }, 0.1]\nior = \"Cu\"\n";
    std::fs::write(studio.path("scenes/materials/brushed.toml"), text).expect("it can be written");
    let shown = report(&studio, &["brushed", "--theta", "45", "--out", "pictures"]);
    let middle = shown["material"]["alpha"][0].as_f64().expect("a number");
    assert!((middle - 0.3).abs() <= f64::EPSILON, "{shown}");
    assert_eq!(shown["free"], json!([["alpha[0]", 0.2, 0.4]]));
    assert!(studio.path("pictures/slices.png").is_file());
    let set = report(&studio, &["brushed", "--theta", "45", "--set", "alpha=[1,1]"]);
    assert_eq!(set["material"]["alpha"], json!([1.0, 1.0]));
    assert_eq!(set["free"], json!([]));
}

#[test]
fn bad_requests_are_named() {
    let studio = Studio::new();
    let cases: [(&[&str], &[&str]); 14] = [
        (&["brass"], &["brass", "there is no such material", "`conductor`"]),
        (&["brass.toml"], &["brass.toml"]),
        (
            &["conductor"],
            &["`alpha`", "missing field", "2 numbers in 0.0001..1"],
        ),
        (
            &["vase", "--set", "alpha=[2,0.1]"],
            &["`alpha[0]`", "is 2", "must lie in 0.0001..1"],
        ),
        (
            &["vase", "--set", "metallic=1"],
            &["`metallic`", "unknown field", "`alpha`"],
        ),
        (&["vase", "--set", "ior=brass"], &["`ior`", "brass", "gold (Au)"]),
        (
            &["layered"],
            &["`alpha`", "missing field", "a number in 0.0001..1"],
        ),
        (
            &["layered", "--set", "sigma_t=-1", "--set", "alpha=0.1"],
            &["`sigma_t`", "is -1", "must lie in 0..100"],
        ),
        (
            &["principled", "--set", "roughness=2"],
            &["`roughness`", "is 2", "must lie in 0..1"],
        ),
        (
            &["principled", "--set", "base_color=red"],
            &["`base_color`", "red", "length 3"],
        ),
        (&["imported"], &["`file`", "missing field", "the name of a file"]),
        (
            &["imported", "--set", "file=felt.safetensors"],
            &["felt.safetensors", "No such file"],
        ),
        (
            &["imported", "--set", "file=scenes/vase/scene.toml"],
            &[
                "scenes/vase/scene.toml",
                "not a whole safetensors file",
                "bake_bsdf.write_slices",
            ],
        ),
        (
            &["vase", "--set", "alpha=0.1"],
            &["`alpha`", "is 0.1", "length 2"],
        ),
    ];
    for (arguments, parts) in cases {
        complains(&studio, &[&["material"], arguments].concat(), parts);
    }
    std::fs::write(studio.path("out"), "a file").expect("it can be written");
    complains(
        &studio,
        &["material", "vase"],
        &["out/materials/vase", "cannot write there"],
    );
}

/// Tables have no symmetry that networks could rely on, and that is said before any work.
#[test]
fn imported_materials_are_not_baked() {
    let studio = Studio::new();
    let text = "family = \"imported\"\nfile = \"felt.safetensors\"\n";
    std::fs::write(studio.path(MATERIAL_FILE), text).expect("it can be written");
    complains(
        &studio,
        &["train", MATERIAL_FILE],
        &["`family`", "\"imported\"", "no symmetry"],
    );
    complains(&studio, &["scene", SCENE], &["felt.safetensors"]);
}

#[test]
fn unknown_presets_and_materials_are_refused() {
    let studio = Studio::new();
    complains(
        &studio,
        &["train", "brass"],
        &["brass", "there is no such material"],
    );
    std::fs::write(studio.path("out"), "a file").expect("it can be written");
    complains(
        &studio,
        &["train", MATERIAL_FILE],
        &["out/materials/vase", "cannot write there"],
    );
}
