//! The structure of the workspace: which crate may see which, what a renderer links, and where `unsafe` may stand.
//!
//! Edges come from `cargo metadata`, trees from `cargo tree`; both only read what building these tests fetched.

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

const ROOT: &str = "bake";
const RUNTIME: &str = "bake-runtime";
/// The runtime's interface for C.
const CAPI: &str = "bake-capi";
const TRAIN: &str = "bake-train";
const EXPORT: &str = "bake-export";
const SCENES: &str = "bake-scenes";
/// The reference models in single precision, for tests of the runtime alone.
const TWIN: &str = "bake-single-precision";

/// Files that may hold `unsafe`: lane operations of one instruction set each, and what C passes as pointers.
const UNSAFE_FOLDERS: [&str; 2] = ["runtime/src/native/arch", "runtime/capi/src"];

#[test]
fn crates_see_only_what_the_design_lets_them_see() {
    let ours = [ROOT, RUNTIME, CAPI, TWIN, TRAIN, EXPORT, SCENES].map(String::from);
    let dependencies = direct_dependencies();
    let found: Vec<&String> = dependencies.keys().collect();
    let expected: BTreeSet<&String> = ours.iter().collect();
    assert_eq!(
        found,
        Vec::from_iter(expected),
        "a crate came or went: say here whom it may see"
    );
    for (name, allowed) in [
        (TWIN, &[][..]),
        // Its own tests name it again, to turn a feature on.
        (RUNTIME, &[RUNTIME, TWIN]),
        (CAPI, &[RUNTIME]),
        (TRAIN, &[RUNTIME]),
        (EXPORT, &[RUNTIME]),
        (SCENES, &[RUNTIME]),
        (ROOT, &[RUNTIME, TRAIN, EXPORT, SCENES]),
    ] {
        let seen: Vec<&String> = dependencies[name].iter().filter(|d| ours.contains(d)).collect();
        let allowed = BTreeSet::from_iter(allowed.iter().map(|a| a.to_string()));
        assert_eq!(
            seen,
            Vec::from_iter(&allowed),
            "crates of this workspace that {name} depends on"
        );
    }
}

/// Both precisions come from one source, and nobody links the second one.
#[test]
fn the_twin_in_single_precision_has_no_models_of_its_own() {
    let folder = workspace().join("runtime/single_precision");
    let mut found = sources(&folder);
    found.sort();
    assert_eq!(found, ["lib.rs", "real.rs"].map(|file| folder.join(file)));
    for name in [ROOT, RUNTIME, CAPI, TRAIN, EXPORT, SCENES] {
        assert!(!tree(name).contains(TWIN), "{name} links {TWIN}");
    }
}

#[test]
fn only_training_knows_candle() {
    for (name, dependencies) in direct_dependencies() {
        let knows = dependencies.iter().any(|d| d.starts_with("candle"));
        assert_eq!(knows, name == TRAIN, "whether {name} depends on candle");
    }
    for name in [RUNTIME, CAPI, EXPORT, SCENES] {
        let tree = tree(name);
        assert!(
            !tree.iter().any(|d| d.starts_with("candle")),
            "{name} links candle: {tree:?}"
        );
    }
    assert!(
        tree(TRAIN).contains("candle-core"),
        "the test looks at whole trees"
    );
}

#[test]
fn a_renderer_links_no_candle_no_onnxruntime_and_no_logging() {
    for name in [RUNTIME, CAPI] {
        let tree = tree(name);
        let unwanted = |dependency: &&String| {
            ["candle", "ort-sys", "tracing", "env_logger"]
                .iter()
                .any(|start| dependency.starts_with(start))
                || ["ort", "log", "slog"].contains(&dependency.as_str())
        };
        let found: Vec<&String> = tree.iter().filter(unwanted).collect();
        assert!(found.is_empty(), "{name} with default features links {found:?}");
        assert!(tree.contains("safetensors"), "the test looks at the whole tree");
    }
}

#[test]
fn threads_of_the_runtime_are_an_option() {
    assert!(
        tree(RUNTIME).contains("rayon"),
        "batches run on all threads by default"
    );
    for (name, options) in [(RUNTIME, &["--no-default-features"][..]), (CAPI, &[])] {
        let alone = tree_with(name, options);
        let found: Vec<&String> = alone.iter().filter(|name| name.starts_with("rayon")).collect();
        assert!(found.is_empty(), "{name} without threads links {found:?}");
        assert!(alone.contains("safetensors"), "the test looks at the whole tree");
    }
    // Everything else in the runtime runs on the thread that calls it.
    let spread = |file: &PathBuf| read(file).contains("rayon");
    let files: Vec<PathBuf> = sources(&workspace().join("runtime/src"))
        .into_iter()
        .filter(spread)
        .collect();
    assert_eq!(files, [workspace().join("runtime/src/batch.rs")]);
}

#[test]
fn unsafe_stands_only_where_instructions_and_pointers_are() {
    let folders = UNSAFE_FOLDERS.map(|folder| workspace().join(folder));
    let mut inside = [0; UNSAFE_FOLDERS.len()];
    for root in [
        "src",
        "runtime/src",
        "runtime/capi/src",
        "train/src",
        "export/src",
        "scenes/src",
    ] {
        for file in sources(&workspace().join(root)) {
            let text = read(&file);
            let line = text
                .lines()
                .position(|line| has_unsafe(line.split("//").next().unwrap_or_default()));
            match (folders.iter().position(|folder| file.starts_with(folder)), line) {
                (Some(folder), found) => inside[folder] += usize::from(found.is_some()),
                (None, None) => {}
                (None, Some(line)) => panic!(
                    "{}:{}: unsafe outside {UNSAFE_FOLDERS:?}",
                    file.display(),
                    line + 1
                ),
            }
        }
    }
    assert!(
        inside.iter().all(|files| *files > 0),
        "the test recognises unsafe where it is allowed: {inside:?}"
    );
}

#[test]
fn every_other_crate_forbids_unsafe() {
    for root in [
        "src/main.rs",
        "train/src/lib.rs",
        "export/src/lib.rs",
        "scenes/src/lib.rs",
    ] {
        assert!(
            read(&workspace().join(root)).contains("#![forbid(unsafe_code)]"),
            "{root} does not forbid unsafe code"
        );
    }
    // Forbidding could not be lifted for the files of instruction sets. The interface for C is made of pointers.
    assert!(read(&workspace().join("runtime/src/lib.rs")).contains("#![deny(unsafe_code)]"));
}

fn workspace() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Whether `code`, a line without comments, has the keyword; `unsafe_code` is the name of a lint.
fn has_unsafe(code: &str) -> bool {
    code.split(|c: char| !c.is_alphanumeric() && c != '_')
        .any(|word| word == "unsafe")
}

/// Every Rust file in `folder` and below.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let paths = entries.map(|entry| entry.expect("the folder can be read").path());
    paths.fold(Vec::new(), |mut files, path| {
        if path.is_dir() {
            files.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
        files
    })
}

/// What every crate of the workspace names in its Cargo.toml, for building, running or testing.
fn direct_dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let text = cargo(&["metadata", "--format-version", "1", "--no-deps"]);
    let metadata: Value = serde_json::from_str(&text).expect("cargo metadata prints JSON");
    let name = |value: &Value| value["name"].as_str().expect("packages have names").to_owned();
    let list = |value: &Value| value.as_array().expect("a list").clone();
    let packages = list(&metadata["packages"]);
    packages
        .iter()
        .map(|p| (name(p), list(&p["dependencies"]).iter().map(name).collect()))
        .collect()
}

/// Names of all packages that `package` links with its default features.
fn tree(package: &str) -> BTreeSet<String> {
    tree_with(package, &[])
}

/// The same with the features that `options` choose.
fn tree_with(package: &str, options: &[&str]) -> BTreeSet<String> {
    let tree = [
        "tree",
        "--package",
        package,
        "--edges",
        "normal",
        "--prefix",
        "none",
        "--format",
        "{p}",
    ];
    let text = cargo(&[&tree[..], options].concat());
    text.lines()
        .filter_map(|line| line.split_whitespace().next())
        .map(String::from)
        .collect()
}

fn cargo(arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO"));
    command
        .args(arguments)
        .args(["--offline", "--locked"])
        .current_dir(workspace());
    let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success(),
        "{command:?}: {}\n{errors}",
        output.status
    );
    String::from_utf8(output.stdout).expect("cargo prints UTF-8")
}
