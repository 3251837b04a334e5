//! `bake_bsdf.read_maps` reads what `bake maps` writes, as its documentation says.

use crate::python::{python, workspace};
use crate::{METAL, OUT, PLASTIC, SHARD_SLICES, maps, studio, succeed};
use std::path::Path;
use std::process::Command;

/// Slices of the databases: two shards.
const COUNT: usize = SHARD_SLICES + 2;

/// Charts that the family has room for.
const ROOM: usize = 2;

/// Layout, values and metadata of a database of `COUNT` entries with `PARAMETERS` free ones and `CHARTS` charts of `ROOM`.
const READ: &str = r#"
import numpy as np
from bake_bsdf import read_maps
from safetensors.numpy import load_file

n, p, c, r = COUNT, PARAMETERS, CHARTS, ROOM
tensors, metadata = read_maps("maps")
layout = {
    "parameters": ((n, p), np.float64),
    "wo": ((n, 3), np.float64),
    "smoothing_error": ((n,), np.float64),
    "charts": ((n,), np.uint8),
    "share": ((n, r), np.float64),
    "frame": ((n, r, 5), np.float64),
    "boost": ((n, r, 2), np.float64),
    "residuals": ((n, r, 5), np.float64),
    "fallback": ((n, r), np.uint8),
    "log_density": ((n, r, 3, 32, 32), np.float32),
    "map": ((n, r, 32, 32, 2), np.float32),
    "potential": ((n, r, 32, 32), np.float32),
}
assert {name: (array.shape, array.dtype) for name, array in tensors.items()} == layout
first, second = load_file("maps/maps-0000.safetensors"), load_file("maps/maps-0001.safetensors")
for name, array in tensors.items():
    assert np.array_equal(array, np.concatenate([first[name], second[name]]), equal_nan=array.dtype.kind == "f"), name
assert len(metadata) == 2 and metadata[0] == metadata[1]
assert metadata[0]["solver"] == "frame" and metadata[0]["cells"] == 32 and len(metadata[0]["parameters"]) == p
assert np.allclose(np.linalg.norm(tensors["wo"], axis=1), 1) and (tensors["charts"] == c).all()
for name in ("share", "frame", "boost", "residuals", "log_density", "map", "potential"):
    assert np.isfinite(tensors[name][:, :c]).all() and np.isnan(tensors[name][:, c:]).all(), name
assert np.allclose(tensors["share"][:, :c].sum(axis=1), 1)
m = tensors["map"][:, :c]
assert ((m >= 0) & (m <= 1)).all()
# Rows are u1 and columns u0, both upwards: a map that keeps its orientation grows along both.
assert (np.diff(m[..., 0], axis=3) > 0).mean() > 0.99 and (np.diff(m[..., 1], axis=2) > 0).mean() > 0.99
assert not tensors["fallback"].any() and (abs(tensors["residuals"][:, :c, 0]) <= 0.05).all()
"#;

/// What is missing or damaged is said.
const REFUSE: &str = r#"
import os
from pathlib import Path
from bake_bsdf import read_maps

def refused(kind, *words):
    try:
        read_maps("maps")
    except kind as error:
        assert all(word in str(error) for word in words), (words, str(error))
    else:
        raise AssertionError(words)

shard, hidden = Path("maps/maps-0000.safetensors"), Path("hidden")
shard.rename(hidden)
refused(FileNotFoundError, "maps-0000.safetensors is missing")
whole = hidden.read_bytes()
shard.write_bytes(whole[: len(whole) // 2])
refused(ValueError, "maps-0000.safetensors", "damaged")
shard.write_bytes(whole)
Path("maps/maps-0001.safetensors").rename("maps/maps-0002.safetensors")
refused(FileNotFoundError, "maps-0001.safetensors is missing")
os.rename("other/maps-0000.safetensors", "maps/maps-0001.safetensors")
refused(ValueError, "maps-0001.safetensors", "but the first shard")
"#;

/// Runs `code` in `folder`.
fn run(code: &str, folder: &Path) {
    let output = Command::new(python())
        .args(["-c", code])
        .current_dir(folder)
        .env("PYTHONPATH", workspace().join("export/python"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output()
        .expect("the interpreter starts");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

#[test]
fn tensors_are_those_of_the_shards() {
    for (material, parameters, charts) in [(METAL, 0, 1), (PLASTIC, 1, 2)] {
        let studio = studio();
        succeed(maps(&studio, material, COUNT, &[]));
        let sizes = [
            ("COUNT", COUNT),
            ("PARAMETERS", parameters),
            ("CHARTS", charts),
            ("ROOM", ROOM),
        ];
        let code = sizes.iter().fold(READ.to_string(), |code, (name, size)| {
            code.replace(name, &size.to_string())
        });
        run(&code, &studio.path("."));
    }
}

#[test]
fn missing_and_damaged_shards_are_named() {
    let studio = studio();
    succeed(maps(&studio, METAL, COUNT, &[]));
    let other = ["maps", PLASTIC, "--count", "1", "--cells", "32", "--out", "other"];
    succeed(studio.bake(&other));
    assert!(studio.path(OUT).join("maps-0001.safetensors").exists());
    run(REFUSE, &studio.path("."));
}
