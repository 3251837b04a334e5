//! The onnxruntime backend: against the oracle, and at its edges.

#[path = "../support/agreement.rs"]
mod agreement;
#[path = "../support/answers.rs"]
mod answers;
#[path = "../support/networks.rs"]
mod networks;
#[path = "../support/specifications.rs"]
mod specifications;
#[path = "../support/mod.rs"]
mod support;

mod edges;
mod files;
mod oracle;
mod suite;

use bake_runtime::BakedMaterial;

/// Networks of one chart for a fixed material.
fn small() -> BakedMaterial {
    networks::random_material(&[8], &[4], 0)
}

/// A temporary folder with the ONNX files of `material`.
fn exported(material: &BakedMaterial) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    bake_export::export(material, folder.path()).expect("a temporary folder can be written");
    folder
}
