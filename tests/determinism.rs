//! The same networks from the same seed, byte for byte: at one thread and at two, interrupted or not.

#[path = "support/files.rs"]
mod files;

use bake_runtime::{Family, Material};
use bake_train::Error;
use bake_train::bake::{Effort, Stage, bake};
use bake_train::database::SHARD_SLICES;
use bake_train::presets::Preset;
use files::{Files, assert_same};
use std::ops::ControlFlow;
use std::path::Path;

/// The preset whose stages these are.
const PRESET: Preset = Preset::Warp;
/// Enough for every stage to run and for the tree of warm starts to branch; far too little for a good network.
const EFFORT: Effort = Effort {
    slices: 12,
    steps: [20, 30, 20, 20],
    batch: 512,
};
const SEED: u64 = 7;
/// Reflectance of the vase.
const GOLD: [f64; 3] = [1.0, 0.782, 0.344];
/// Another metal: with the vase's roughness it has the same directions and anchors, but other slices.
const SILVER: [f64; 3] = [0.97, 0.96, 0.91];

#[test]
fn one_and_two_threads_give_the_same_bytes_and_another_seed_gives_others() {
    // A batch of several shards, none of them of whole tiles.
    let effort = Effort {
        batch: 5000,
        ..EFFORT
    };
    let one = whole(effort, 1, SEED);
    let names: Vec<&str> = one.keys().map(String::as_str).collect();
    assert_eq!(names, ["eval", "maps-0000.safetensors", "pdf", "sample"]);
    assert_same(&one, &whole(effort, 2, SEED));
    let other = whole(effort, 2, SEED + 1);
    for (name, bytes) in &one {
        assert!(other[name] != *bytes, "{name} does not depend on the seed");
    }
}

#[test]
fn an_interrupted_bake_goes_on_to_the_same_bytes() {
    let expected = whole(EFFORT, 2, SEED);
    for (stage, done) in [
        (Stage::Charts, 3),
        (Stage::Maps, 5),
        (Stage::Sample, 17),
        (Stage::Eval, 0),
        (Stage::Pdf, 9),
    ] {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        let stop = |s: Stage, d: u64, _: u64| match s == stage && d >= done {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        let interrupted = in_pool(2, || {
            bake(&vase(GOLD), PRESET, EFFORT, SEED, folder.path(), &stop)
        });
        assert!(
            matches!(interrupted, Err(Error::Interrupted)),
            "{stage:?} was not interrupted"
        );
        assert!(
            temporary_files(folder.path()).is_empty(),
            "{stage:?} left a temporary file"
        );
        assert_same(&expected, &run(EFFORT, 1, SEED, folder.path()));
    }
}

#[test]
fn a_stored_shard_of_maps_is_as_good_as_a_fresh_one() {
    let effort = Effort {
        slices: SHARD_SLICES + 4,
        ..EFFORT
    };
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let expected = run(effort, 2, SEED, folder.path());
    // As an interruption in the second shard leaves it.
    for file in ["maps-0001", "train-sample", "train-eval", "train-pdf"] {
        std::fs::remove_file(folder.path().join(file).with_extension("safetensors"))
            .expect("the bake wrote it");
    }
    assert_same(&expected, &run(effort, 2, SEED, folder.path()));
}

#[test]
fn checkpoints_of_another_material_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    run(EFFORT, 2, SEED, folder.path());
    let silver = in_pool(2, || {
        bake(&vase(SILVER), PRESET, EFFORT, SEED, folder.path(), &go_on)
    });
    match silver {
        Err(Error::Checkpoint { path, .. }) => {
            assert_eq!(path, folder.path().join("train-charts.safetensors"))
        }
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("silver went on from gold"),
    }
}

fn go_on(_: Stage, _: u64, _: u64) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

fn vase(reflectance: [f64; 3]) -> Material {
    Material::fixed(
        "vase",
        Family::Conductor,
        &[("alpha", &[0.3, 0.1]), ("reflectance", &reflectance)],
    )
    .expect("valid parameters")
}

fn in_pool<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("threads can be started");
    pool.install(work)
}

/// A bake in a fresh folder.
fn whole(effort: Effort, threads: usize, seed: u64) -> Files {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    run(effort, threads, seed, folder.path())
}

/// Bakes to the end; the bytes of the three networks and of the map shards.
fn run(effort: Effort, threads: usize, seed: u64, work: &Path) -> Files {
    let baked = in_pool(threads, || bake(&vase(GOLD), PRESET, effort, seed, work, &go_on));
    let material = baked.unwrap_or_else(|e| panic!("{e}")).material;
    let networks = [
        ("sample", material.sample),
        ("eval", material.eval),
        ("pdf", material.pdf),
    ];
    let mut files: Files = networks
        .iter()
        .map(|(name, n)| (name.to_string(), n.to_bytes()))
        .collect();
    for entry in std::fs::read_dir(work).expect("the folder can be read") {
        let path = entry.expect("the folder can be read").path();
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        if name.starts_with("maps-") {
            files.insert(name, std::fs::read(path).expect("the shard can be read"));
        }
    }
    files
}

fn temporary_files(folder: &Path) -> Vec<std::path::PathBuf> {
    let entries = std::fs::read_dir(folder).expect("the folder can be read");
    let paths = entries.map(|entry| entry.expect("the folder can be read").path());
    paths
        .filter(|path| path.extension().is_some_and(|e| e == "tmp"))
        .collect()
}
