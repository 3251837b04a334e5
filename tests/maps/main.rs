//! `bake maps` through the real program: databases that survive kills, Ctrl-C and full disks, what is refused, pictures
//! of entries, comparisons, and the reader in Python.
#![cfg(unix)]

#[path = "../support/complaint.rs"]
mod complaint;
#[path = "../support/files.rs"]
mod files;
#[path = "../support/program.rs"]
mod program;
#[path = "../support/python.rs"]
mod python;
#[path = "../support/signals.rs"]
mod signals;
#[path = "../support/slices_file.rs"]
mod slices_file;

mod bad_targets;
mod compare;
mod entries;
mod fallbacks;
mod full_disk;
mod reader;
mod refusals;
mod resume;

use files::Files;
use program::{Studio, finish};
use safetensors::SafeTensors;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use std::time::Duration;

/// Far more than any run here takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(240);
/// Exit status of bad input and of whatever else stopped the work.
const FAILED: i32 = 2;
/// Slices of a whole shard.
const SHARD_SLICES: usize = 128;
/// Where the tests put maps.
const OUT: &str = "maps";

/// Where [`studio`] keeps a rough metal, whose maps take a millisecond.
const METAL: &str = "scenes/materials/metal.toml";
/// Its text.
const METAL_TEXT: &str = "family = \"principled\"\nmetallic = 1.0\nroughness = 0.7\n";
/// A plastic with two charts; its roughness is free.
const PLASTIC: &str = "scenes/materials/plastic.toml";
/// Its text.
const PLASTIC_TEXT: &str = "family = \"principled\"\nroughness = { min = 0.2, max = 0.4 }\n";

/// A studio with [`METAL`] and [`PLASTIC`] beside the vase.
fn studio() -> Studio {
    let studio = Studio::new();
    for (file, text) in [(METAL, METAL_TEXT), (PLASTIC, PLASTIC_TEXT)] {
        std::fs::write(studio.path(file), text).expect("a temporary folder can be written");
    }
    studio
}

/// `bake maps MATERIAL --count COUNT`, with the smallest maps, into [`OUT`].
fn maps(studio: &Studio, material: &str, count: usize, more: &[&str]) -> Command {
    let count = count.to_string();
    let arguments = ["maps", material, "--count", &count, "--cells", "32", "--out", OUT];
    studio.bake(&[&arguments[..], more].concat())
}

/// Runs `command` to its end.
fn run(mut command: Command) -> Output {
    finish(command.spawn().expect("the program starts"), PATIENCE)
}

/// Runs `command`, which succeeds; what it printed.
fn succeed(command: Command) -> String {
    let name = format!("{command:?}");
    let output = run(command);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{name}: {said}");
    String::from_utf8(output.stdout).expect("the program speaks UTF-8")
}

/// The JSON that `command` prints.
fn json(command: Command) -> Value {
    serde_json::from_str(&succeed(command)).expect("one JSON value and nothing else")
}

/// Runs `command`, which stops in the middle of its work: after its progress it says why, in one line with all of `parts`.
fn fails(command: Command, parts: &[&str]) {
    let name = format!("{command:?}");
    let output = run(command);
    let said = String::from_utf8(output.stderr).expect("complaints are UTF-8");
    assert_eq!(output.status.code(), Some(FAILED), "{name}: {said}");
    assert!(output.stdout.is_empty(), "{name} printed a result");
    let complaints: Vec<&str> = said.lines().filter(|line| line.starts_with("bake: ")).collect();
    assert_eq!(complaints.len(), 1, "{said}");
    assert!(
        said.ends_with(&format!("{}\n", complaints[0])),
        "not the last: {said}"
    );
    for part in parts {
        assert!(complaints[0].contains(part), "`{part}` is not in: {said}");
    }
}

/// The shards in [`OUT`], every one of which must be whole; nothing else may be there but pictures.
fn shards(studio: &Studio) -> Files {
    let mut found = Files::new();
    let Ok(entries) = std::fs::read_dir(studio.path(OUT)) else {
        return found;
    };
    for entry in entries {
        let path = entry.expect("the folder can be read").path();
        let name = name_of(&path);
        if name.starts_with("maps-") {
            let bytes = std::fs::read(&path).expect("the shard can be read");
            SafeTensors::deserialize(&bytes).unwrap_or_else(|e| panic!("{name} is not whole: {e}"));
            found.insert(name, bytes);
        }
    }
    found
}

fn name_of(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// Names in [`OUT`] of files that were not finished.
fn unfinished(studio: &Studio) -> Vec<String> {
    let names = studio.listing().into_keys().map(|path| name_of(&path));
    names.filter(|name| name.ends_with(".tmp")).collect()
}
