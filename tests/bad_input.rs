//! Bad scenes, materials and places to write to: one sentence on standard error that names the file, the key or
//! flag, and the way out; exit status 2; nothing on standard output; nothing left behind.

#[path = "support/complaint.rs"]
mod complaint;
#[path = "support/program.rs"]
mod program;

use complaint::complains;
use program::{MATERIAL_FILE, SCENE, SCENE_FILE, Studio};
use std::path::Path;
use toml::{Table, Value};

/// A render that needs no networks.
const RENDER: [&str; 6] = ["render", SCENE, "--method", "cosine", "--spp", "1"];

#[test]
fn an_unknown_key_of_a_scene() {
    let studio = with_scene(|scene| insert(scene, "camera", "aperture", Value::Float(2.8)));
    complains(
        &studio,
        &["scene", SCENE],
        &[SCENE_FILE, "camera", "aperture", "expected one of `position`"],
    );
}

#[test]
fn an_unknown_key_of_a_material() {
    let studio = with_material("roughness", Value::Float(0.3));
    complains(
        &studio,
        &["scene", SCENE],
        &[
            "materials/vase.toml",
            "roughness",
            "expected one of `family`, `alpha`, `reflectance`, `ior`",
        ],
    );
}

#[test]
fn an_unknown_family() {
    let studio = with_material("family", Value::String("plastic".into()));
    complains(
        &studio,
        &["scene", SCENE],
        &[
            "materials/vase.toml",
            "family",
            "plastic",
            "`conductor`, `layered`, `principled`, `imported`",
        ],
    );
}

#[test]
fn a_roughness_outside_its_range() {
    for alpha in [0.0, -0.1, 1.0f64.next_up(), 1e-5, f64::NAN, f64::INFINITY] {
        for index in 0..2 {
            let mut alphas = vec![Value::Float(0.3); 2];
            alphas[index] = Value::Float(alpha);
            let studio = with_material("alpha", Value::Array(alphas));
            let key = format!("`alpha[{index}]`");
            complains(
                &studio,
                &["scene", SCENE],
                &["materials/vase.toml", &key, "must lie in 0.0001..1"],
            );
        }
    }
}

#[test]
fn a_range_upside_down() {
    let studio = with_material("alpha", Value::Array(vec![range(0.4, 0.2), Value::Float(0.1)]));
    complains(
        &studio,
        &["scene", SCENE],
        &[
            "materials/vase.toml",
            "`alpha[0]`",
            "min 0.4 > max 0.2; swap them",
        ],
    );
}

#[test]
fn a_range_of_what_must_be_fixed() {
    let studio = with_material(
        "reflectance",
        Value::Array(vec![range(0.2, 0.9), 0.7.into(), 0.3.into()]),
    );
    for command in [
        &["scene", SCENE][..],
        &["render", SCENE, "--method", "reference", "--spp", "1"],
    ] {
        complains(
            &studio,
            command,
            &["materials/vase.toml", "`reflectance[0]`", "give it one value"],
        );
    }
}

#[test]
fn a_missing_environment_file() {
    let studio = with_scene(|scene| {
        scene.insert("environment".into(), toml::toml! { file = "sunset.exr" }.into());
    });
    complains(
        &studio,
        &["scene", SCENE],
        &[SCENE_FILE, "`environment.file`", "there is no file", "sunset.exr"],
    );
}

#[test]
fn a_missing_scene() {
    for command in ["scene", "render"] {
        complains(
            &Studio::new(),
            &[command, "scenes/vse"],
            &["scenes/vse:", "give a folder with scene.toml"],
        );
        complains(
            &Studio::new(),
            &[command, "scenes"],
            &["scenes/scene.toml", "give a folder with scene.toml"],
        );
    }
}

#[test]
fn a_missing_material_file() {
    let studio = Studio::new();
    std::fs::remove_file(studio.path(MATERIAL_FILE)).expect("just copied");
    complains(
        &studio,
        &["scene", SCENE],
        &[SCENE_FILE, "material`", "there is no material file", "vase.toml"],
    );
}

#[test]
fn an_output_folder_that_cannot_be_written() {
    let studio = Studio::new();
    // Permissions would not stop a superuser; a folder inside a file stops everybody.
    std::fs::write(studio.path("out"), "a file").expect("a temporary folder can be written");
    let hint = "cannot write there; choose another folder with --out";
    complains(&studio, &["scene", SCENE], &["out/vase", hint]);
    complains(
        &studio,
        &["scene", SCENE, "--out", "out/here"],
        &["out/here", hint],
    );
    complains(&studio, &RENDER, &["out/vase", hint]);
    complains(
        &studio,
        &[&RENDER[..], &["--out", "out/here/vase.exr"]].concat(),
        &["out/here", hint],
    );
}

#[test]
fn a_picture_that_is_not_exr() {
    complains(
        &Studio::new(),
        &[&RENDER[..], &["--out", "vase.jpg"]].concat(),
        &["vase.jpg", "--out must name an .exr file"],
    );
}

#[test]
fn a_scene_that_is_not_baked() {
    complains(
        &Studio::new(),
        &["render", SCENE],
        &[
            "`vase` is not baked",
            "out/vase/vase",
            "run `bake scene scenes/vase`",
        ],
    );
}

/// A copy of the vase whose scene file `edit` has changed.
fn with_scene(edit: impl FnOnce(&mut Table)) -> Studio {
    let studio = Studio::new();
    edit_file(&studio.path(SCENE_FILE), edit);
    studio
}

/// A copy of the vase whose material has `value` for `key`.
fn with_material(key: &str, value: Value) -> Studio {
    let studio = Studio::new();
    edit_file(&studio.path(MATERIAL_FILE), |material| {
        drop(material.insert(key.into(), value))
    });
    studio
}

fn edit_file(path: &Path, edit: impl FnOnce(&mut Table)) {
    let text = std::fs::read_to_string(path).expect("just copied");
    let mut table: Table = text.parse().expect("the vase's files are TOML");
    edit(&mut table);
    std::fs::write(path, table.to_string()).expect("a temporary folder can be written");
}

fn insert(table: &mut Table, section: &str, key: &str, value: Value) {
    let section = table
        .get_mut(section)
        .and_then(Value::as_table_mut)
        .expect("the scene has the section");
    section.insert(key.into(), value);
}

fn range(min: f64, max: f64) -> Value {
    Table::from_iter([("min", min), ("max", max)].map(|(key, value)| (key.to_string(), value.into()))).into()
}
