//! Tables of slices from Python to Rust: what `bake_bsdf.write_slices` writes is what `ImportedTable` reads, what it
//! refuses leaves nothing behind, and neither it nor the Mitsuba example needs more than numpy to be imported.

mod support;

use bake_runtime::imported::ImportedTable;
use bake_runtime::{Bsdf, Rng};
use glam::DVec3;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use support::python::{python, workspace};

/// Numbers pass through single precision twice, in a sum of sixteen terms.
const ROUND_OFF: f64 = 1e-6;

/// Writes `table.safetensors`: f is multilinear in parameters, θ and the disk, so that every exchange shows.
const WRITE: &str = r#"
import itertools
import numpy as np
import bake_bsdf

axes = [0.2, 0.8], [1.0, 1.5, 3.0], [0.0, 40.0, 80.0], [-90.0, 0.0, 90.0, 180.0]
rows = np.array(list(itertools.product(*axes)))
np.random.default_rng(1).shuffle(rows)
wi, mask = bake_bsdf.disk_grid(12, 17)
assert wi.shape == (12, 17, 3) and mask.shape == (12, 17) and np.allclose(np.linalg.norm(wi, axis=-1), 1)
p, q, theta, phi = (column[:, None, None] for column in rows.T)
x, y, z = np.moveaxis(wi, -1, 0)
f = np.stack([(1 + p) * (4 - q) * (2 + x), (1 + theta / 90) * (2 + y) + 0 * p, 3 + x * y + 0 * p], axis=-1)
f_cos = np.where(mask[..., None], f * z[..., None], np.nan)
bake_bsdf.write_slices("table.safetensors", rows[:, :2], rows[:, 2:], f_cos, ["glow", "ior"], "grau, θ bis 80°")
bake_bsdf.write_slices("plain.safetensors", None, [[0, 0]], f_cos[:1])
"#;

/// Every bad input is refused with its own words, and nothing is written.
const REFUSE: &str = r#"
import os
import numpy as np
from bake_bsdf import write_slices

def good():
    rows = [(p, t, a) for p in (1.0, 2.0) for t in (0.0, 30.0) for a in (0.0, 120.0, 240.0)]
    rows = np.array(rows)
    return {"params": rows[:, :1].copy(), "wo": rows[:, 1:].copy(), "f_cos": np.full((12, 4, 5, 3), 0.1)}

def refused(*words, **changes):
    arguments = good()
    for name, change in changes.items():
        if callable(change):
            change(arguments[name])
        else:
            arguments[name] = change
    try:
        write_slices("refused.safetensors", **arguments)
    except ValueError as error:
        assert all(word in str(error) for word in words), (words, str(error))
        assert "\n" not in str(error)
    else:
        raise AssertionError(words)

def put(index, value):
    return lambda array: array.__setitem__(index, value)

for bad in (-1.0, np.nan, np.inf, 1e21, 1e300):
    refused("f_cos[3, 2, 4, 1] is", "must lie in [0, 1e+20]", f_cos=put((3, 2, 4, 1), bad))
for bad in (-0.5, 90.0, 180.0):
    refused("wo[5, 0] is", "theta must lie in [0, 90)", wo=put((5, 0), bad))
refused("wo[5, 1] is nan", "finite", wo=put((5, 1), np.nan))
refused("params[5, 0] is inf", "finite", params=put((5, 0), np.inf))
refused("rows 10 and 11 are both for p0 = 2.0, theta = 30.0, phi = 120.0", wo=put((11, 1), 480.0))
refused("no row has p0 = 1.0, theta = 0.0, phi = 250.0", "2 × 2 × 4", wo=put((11, 1), 250.0))
refused("gap from 240.0 to 370.0", wo=lambda a: a.__setitem__((slice(None), 1), np.tile([10, 120, 240], 4)))
refused("f_cos is [12, 4, 5]", "[N, H, W, 3]", f_cos=np.ones((12, 4, 5)))
refused("f_cos is [12, 4, 5, 1]", f_cos=np.ones((12, 4, 5, 1)))
refused("f_cos is [12, 0, 5, 3]", f_cos=np.ones((12, 0, 5, 3)))
refused("params is [12]", "[N, P]", params=np.ones(12))
refused("12 rows, but wo is [11, 2]", wo=np.zeros((11, 2)))
refused("2 param_names for params with 1 columns", param_names=["a", "b"])
refused("distinct", param_names=[""])
refused("distinct", param_names=["a\nb"])
assert os.listdir() == [], os.listdir()
write_slices("table.safetensors", **good())
assert os.listdir() == ["table.safetensors"]
"#;

/// What a renderer's own Python has need not include onnxruntime, and this one has no Mitsuba.
const IMPORT: &str = r#"
import sys
import bake_bsdf, bake_bsdf.slices
assert "onnxruntime" not in sys.modules
assert bake_bsdf.BakedMaterial.__name__ == "BakedMaterial"
import tabulate_mitsuba
assert tabulate_mitsuba.main(["--bsdf", "diffuse", "--out", "none.safetensors"]) == 2
"#;

/// Runs `code` in `folder`.
fn run(code: &str, folder: &Path) {
    let package = workspace().join("export/python");
    let paths = std::env::join_paths([package.clone(), package.join("examples")]).expect("plain paths");
    let output = Command::new(python())
        .args(["-c", code])
        .current_dir(folder)
        .env("PYTHONPATH", paths)
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output()
        .expect("the interpreter starts");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
}

#[test]
fn a_table_written_in_python_is_read_in_rust() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    run(WRITE, folder.path());
    let load = |name: &str| {
        Arc::new(ImportedTable::load(&folder.path().join(name)).unwrap_or_else(|e| panic!("{e}")))
    };
    let table = load("table.safetensors");
    assert_eq!(table.param_names(), ["glow", "ior"]);
    assert_eq!(table.description(), Some("grau, θ bis 80°"));
    assert_eq!(table.ranges(), [[0.2, 0.8], [1.0, 3.0]]);
    assert_eq!(table.theta(), [0.0, 40.0, 80.0]);
    assert_eq!(table.phi(), [0.0, 90.0, 180.0, 270.0]);
    assert_eq!((table.len(), table.resolution()), (72, [12, 17]));
    let mut rng = Rng::new(&[1]);
    for _ in 0..1000 {
        // Parameters that single precision holds exactly.
        let [p, q] = [0.2 + 0.6 * rng.uniform(), 1.0 + 2.0 * rng.uniform()].map(|v| f64::from(v as f32));
        let (theta, phi) = (80.0 * rng.uniform(), 360.0 * rng.uniform());
        // Within the cells whose neighbours are all inside the disk.
        let (r, a) = (0.7 * rng.uniform().sqrt(), 7.0 * rng.uniform());
        let wi = DVec3::new(r * a.cos(), r * a.sin(), (1.0 - r * r).sqrt());
        let (sin, cos) = f64::to_radians(theta).sin_cos();
        let (y, x) = f64::to_radians(phi).sin_cos();
        let bsdf = table.bind(&[p, q]).expect("in range");
        let found = bsdf.eval(DVec3::new(sin * x, sin * y, cos), wi, &mut rng);
        let f = DVec3::new(
            (1.0 + p) * (4.0 - q) * (2.0 + wi.x),
            (1.0 + theta / 90.0) * (2.0 + wi.y),
            3.0 + wi.x * wi.y,
        );
        let error = (found - f * wi.z).abs().max_element();
        assert!(
            error < ROUND_OFF * f.max_element(),
            "{found}, expected {}",
            f * wi.z
        );
    }
    let plain = load("plain.safetensors");
    assert_eq!(
        (plain.len(), plain.param_names().len(), plain.description()),
        (1, 0, None)
    );
}

#[test]
fn bad_input_to_the_writer_is_refused_and_leaves_nothing() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    run(REFUSE, folder.path());
}

#[test]
fn the_writer_and_the_example_need_only_numpy() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    run(IMPORT, folder.path());
}
