//! Bad networks, ONNX files, model cards and onnxruntime libraries: one sentence on standard error that names the
//! file and the way out; exit status 2; nothing on standard output; nothing left behind.

#[path = "support/complaint.rs"]
mod complaint;
#[path = "support/networks.rs"]
mod networks;
#[path = "support/program.rs"]
mod program;
mod support;

use bake_runtime::onnxruntime::{ONNXRUNTIME_PINNED, library_path};
use bake_runtime::spec::{FORMAT, SPEC_KEY};
use complaint::{assert_complaint, complains};
use networks::random_material;
use program::{SCENE, SCENE_FILE, Studio};

/// Where the networks of the vase stand in a [`Studio`]; `--models` takes the folder above.
const MODEL: &str = "models/vase";
/// The command that runs those networks.
const RENDER: [&str; 6] = ["render", SCENE, "--models", "models", "--spp", "1"];

#[test]
fn a_truncated_network() {
    let studio = with_networks();
    for (name, length) in [("sample", 0), ("eval", 7), ("pdf", 100), ("sample", usize::MAX)] {
        let file = format!("{MODEL}/{name}.safetensors");
        let whole = std::fs::read(studio.path(&file)).expect("just written");
        std::fs::write(studio.path(&file), &whole[..length.min(whole.len() - 1)]).expect("it can be written");
        for command in [&["check", MODEL][..], &["export", MODEL], &RENDER] {
            complains(
                &studio,
                command,
                &[&file, "not a whole safetensors file", "bake the material again"],
            );
        }
        std::fs::write(studio.path(&file), whole).expect("it can be written");
    }
}

#[test]
fn a_network_of_another_program() {
    let studio = with_networks();
    let file = format!("{MODEL}/eval.safetensors");
    // The smallest safetensors file there is: the length of an empty header, and the header.
    std::fs::write(studio.path(&file), b"\x02\0\0\0\0\0\0\0{}").expect("it can be written");
    complains(
        &studio,
        &["check", MODEL],
        &[&file, "another program wrote it", SPEC_KEY],
    );
}

#[test]
fn a_network_of_another_format_version() {
    let studio = with_networks();
    let file = format!("{MODEL}/pdf.safetensors");
    let bytes = std::fs::read(studio.path(&file)).expect("just written");
    // Another digit, so that the header keeps its length.
    let newer = replaced(
        &bytes,
        &format!("\\\"format\\\":{FORMAT}"),
        &format!("\\\"format\\\":{}", FORMAT + 1),
    );
    std::fs::write(studio.path(&file), newer).expect("it can be written");
    let version = format!(
        "its format version is {}, this program reads {FORMAT}",
        FORMAT + 1
    );
    complains(
        &studio,
        &["check", MODEL],
        &[&file, &version, "bake the material again"],
    );
}

#[test]
fn networks_in_each_others_place() {
    let studio = with_networks();
    std::fs::copy(
        studio.path("models/vase/pdf.safetensors"),
        studio.path("models/vase/eval.safetensors"),
    )
    .expect("it can be written");
    complains(
        &studio,
        &["check", MODEL],
        &["models/vase/eval.safetensors", "it is a pdf network"],
    );
}

#[test]
fn a_missing_model_folder() {
    for command in ["check", "export"] {
        complains(
            &Studio::new(),
            &[command, "models/vse"],
            &["models/vse", "give a folder that `bake scene` wrote"],
        );
    }
}

#[test]
fn a_damaged_model_card() {
    let studio = with_networks();
    for text in ["", "{", "[1]", "{\"format\": 1}"] {
        std::fs::write(studio.path("models/vase/card.json"), text).expect("it can be written");
        complains(
            &studio,
            &["check", MODEL],
            &["models/vase/card.json", "not a model card", "delete it"],
        );
    }
}

#[test]
fn no_onnxruntime() {
    let studio = with_networks();
    let pinned = format!("pip install onnxruntime=={}", ONNXRUNTIME_PINNED);
    let render = [&RENDER[..], &["--backend", "ort"]].concat();
    complains(
        &studio,
        &render,
        &["ORT_DYLIB_PATH", "no-onnxruntime.so", &pinned],
    );
    let mut command = studio.bake(&render);
    command.env("ORT_DYLIB_PATH", studio.path(SCENE_FILE));
    assert_complaint(
        &studio,
        command,
        &["scene.toml", "not a usable onnxruntime library", &pinned],
    );
}

#[test]
fn a_truncated_or_foreign_onnx_model() {
    support::python::python();
    let library = library_path().expect("the environment of the tests has the library");
    let studio = with_networks();
    let render = [&RENDER[..], &["--backend", "ort"]].concat();
    let path = studio.path("models/vase/pdf.onnx");
    let whole = std::fs::read(&path).expect("just written");
    let of_sample = std::fs::read(studio.path("models/vase/sample.onnx")).expect("just written");
    let newer = replaced(
        &whole,
        &format!("\"format\":{FORMAT}"),
        &format!("\"format\":{}", FORMAT + 1),
    );
    let foreign = replaced(&whole, SPEC_KEY, "cake.spec");
    for (bytes, reason) in [
        (whole[..whole.len() / 2].to_vec(), "onnxruntime refuses it"),
        (b"not a model".to_vec(), "onnxruntime refuses it"),
        (foreign, "another program wrote it"),
        (newer, "its format version is"),
        (of_sample, "it is a sample network"),
    ] {
        std::fs::write(&path, bytes).expect("it can be written");
        let mut command = studio.bake(&render);
        command.env("ORT_DYLIB_PATH", &library);
        assert_complaint(
            &studio,
            command,
            &["models/vase/pdf.onnx", reason, "bake the material again"],
        );
    }
    std::fs::remove_file(&path).expect("just written");
    let mut command = studio.bake(&render);
    command.env("ORT_DYLIB_PATH", &library);
    assert_complaint(&studio, command, &["models/vase/pdf.onnx", "bake export"]);
}

/// A copy of the vase with untrained networks of its material in [`MODEL`], as safetensors and ONNX.
fn with_networks() -> Studio {
    let studio = Studio::new();
    let mut material = random_material(&[8], &[4], 0);
    for network in [&mut material.sample, &mut material.eval, &mut material.pdf] {
        network.spec.material.name = "vase".into();
    }
    material
        .save(&studio.path(MODEL))
        .expect("a temporary folder can be written");
    bake_export::export(&material, &studio.path(MODEL)).expect("a temporary folder can be written");
    studio
}

/// `bytes` with `to` in the place of `from`, which is there once and as long.
fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let places: Vec<usize> = bytes
        .windows(from.len())
        .enumerate()
        .filter(|(_, w)| *w == from.as_bytes())
        .map(|p| p.0)
        .collect();
    assert_eq!(places.len(), 1, "`{from}` is there once");
    let mut changed = bytes.to_vec();
    changed[places[0]..places[0] + to.len()].copy_from_slice(to.as_bytes());
    changed
}
