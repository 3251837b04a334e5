//! The same answers wherever a baked material runs: native kernels, onnxruntime in Rust, onnxruntime in Python.
//!
//! The materials that ship are compared on a million queries each, random networks on fewer. That the exported graphs are
//! right and not merely consistent is shown against the oracle, in `tests/onnxruntime`.

#[path = "support/agreement.rs"]
mod agreement;
#[path = "support/answers.rs"]
mod answers;
#[path = "support/networks.rs"]
mod networks;
#[path = "support/specifications.rs"]
mod specifications;
mod support;

use agreement::{assert_agree, movement, tolerance};
use answers::{OUTPUTS, Queries, oracle_answer};
use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::onnxruntime::{ONNXRUNTIME_PINNED, OrtBackend};
use bake_runtime::{BakedMaterial, Role};
use networks::random_material;
use specifications::{Places, random_networks};
use std::path::{Path, PathBuf};
use std::process::Command;
use support::python::{python, workspace};

/// Queries of the comparison on a material that ships.
const QUERIES: usize = 1_000_000;
/// Queries of a comparison on random networks.
const RANDOM_QUERIES: usize = 5_000;
/// Queries of the comparison with f64.
const ERROR_QUERIES: usize = 10_000;
/// Shares of the queries whose largest error is compared: the few answers that jump are as large for both engines, but not
/// of the same queries.
const ERROR_SHARES: [f64; 4] = [0.5, 0.9, 0.99, 0.999];
/// How many times onnxruntime's error ours may be.
const ERROR_RATIO_MAX: f64 = 2.0;
/// One rounding: where onnxruntime is exact, ours need not be.
const ERROR_FLOOR: f64 = 1.2e-7;
/// Fixed vectors for Python: small enough for a readable file, large enough for every stratum.
const VECTORS: usize = 256;
/// Queries that they are chosen from: frequencies up to 2¹¹π, as the paper's preset has them, carry a rounding of `wo` past what
/// Python tolerates in three of four answers.
const CANDIDATES: usize = 8 * VECTORS;

#[test]
fn native_and_onnxruntime_agree_on_a_million_queries_of_every_material_that_ships() {
    python();
    for folder in shipped() {
        agree(&folder, QUERIES);
    }
}

#[test]
fn native_is_as_near_to_f64_as_onnxruntime_on_every_material_that_ships() {
    python();
    for folder in shipped() {
        let material = load(&folder);
        let queries = Queries::new(&material, ERROR_QUERIES, 5);
        let truth = queries.ask_oracle(&material);
        let ort = OrtBackend::new(&folder).unwrap_or_else(|e| panic!("{e}"));
        let [own, other] = [queries.ask(&native(&material)), queries.ask(&ort)]
            .map(|answers| OUTPUTS.map(|(_, columns)| error_quantiles(&answers, &truth, columns)));
        for (((name, _), own), other) in OUTPUTS.iter().zip(own).zip(other) {
            for ((share, own), other) in ERROR_SHARES.iter().zip(own).zip(other) {
                assert!(
                    own <= ERROR_RATIO_MAX * other + ERROR_FLOOR,
                    "{}, {name}: {share} of native's errors lie below {own:.2e}, of onnxruntime's below {other:.2e}",
                    folder.display()
                );
            }
        }
    }
}

#[test]
fn python_onnxruntime_gives_the_same_vectors_of_every_material_that_ships() {
    for folder in shipped() {
        let material = load(&folder);
        let queries = steady_queries(&material, 3);
        let answers = queries.ask(&native(&material));
        verify_in_python(&folder, &queries, &answers);
    }
}

#[test]
fn native_and_onnxruntime_agree_on_random_networks() {
    python();
    for seed in 0..3 {
        agree(
            exported(&random_material(&[32; 4], &[16; 2], seed)).path(),
            RANDOM_QUERIES,
        );
    }
    for places in Places::ALL {
        for free in [false, true] {
            for seed in 0..3 {
                agree(
                    exported(&random_networks(places, free, seed)).path(),
                    RANDOM_QUERIES,
                );
            }
        }
    }
}

#[test]
fn python_onnxruntime_gives_the_oracles_vectors() {
    for places in Places::ALL {
        for free in [false, true] {
            let material = random_networks(places, free, 1);
            let queries = steady_queries(&material, 9);
            let answers = queries.ask_oracle(&material);
            verify_in_python(exported(&material).path(), &queries, &answers);
        }
    }
}

#[test]
#[should_panic(expected = "MISMATCH")]
fn python_notices_a_wrong_vector() {
    let material = random_material(&[32; 4], &[16; 2], 9);
    let queries = steady_queries(&material, 9);
    let mut answers = queries.ask_oracle(&material);
    let green_weight = &mut answers[4][7];
    *green_weight += 1e-3 * green_weight.max(1.0);
    verify_in_python(exported(&material).path(), &queries, &answers);
}

#[test]
fn the_pinned_onnxruntime_is_the_one_that_tests_install() {
    let path = workspace().join("export/python/requirements.txt");
    let requirements = std::fs::read_to_string(&path).expect("the requirements are part of the tree");
    let line = format!("onnxruntime=={ONNXRUNTIME_PINNED}");
    assert!(
        requirements.lines().any(|l| l == line),
        "{} has no line `{line}`",
        path.display()
    );
}

/// The folders of all materials that ship with their networks.
fn shipped() -> Vec<PathBuf> {
    let materials = workspace().join("scenes/materials");
    let entries = std::fs::read_dir(materials).expect("materials are part of the tree");
    let mut folders: Vec<PathBuf> = entries
        .map(|entry| entry.expect("the folder can be read").path())
        .filter(|path| path.join("sample.safetensors").is_file())
        .collect();
    folders.sort();
    assert!(!folders.is_empty(), "some materials ship with their networks");
    folders
}

fn load(folder: &Path) -> BakedMaterial {
    BakedMaterial::load(folder).unwrap_or_else(|e| panic!("{e}"))
}

fn native(material: &BakedMaterial) -> NativeBackend {
    NativeBackend::new(material, Tier::best()).expect("the best tier is available")
}

/// A temporary folder with the safetensors and ONNX files of `material`.
fn exported(material: &BakedMaterial) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    material
        .save(folder.path())
        .expect("a temporary folder can be written");
    bake_export::export(material, folder.path()).expect("a temporary folder can be written");
    folder
}

/// Asserts that native kernels and onnxruntime agree on the material in `folder`.
fn agree(folder: &Path, count: usize) {
    let material = load(folder);
    let ort = OrtBackend::new(folder).unwrap_or_else(|e| panic!("{e}"));
    let queries = Queries::new(&material, count, 1);
    let (found, expected) = (queries.ask(&ort), queries.ask(&native(&material)));
    let what = format!(
        "onnxruntime against {} in {}",
        Tier::best().name(),
        folder.display()
    );
    assert_agree(&what, &material, &queries, &found, &expected);
}

/// The largest |a − b| / max(1, |b|) of each of [`ERROR_SHARES`] of the queries in these columns.
fn error_quantiles(answers: &[Vec<f32>], truth: &[Vec<f32>], [first, end]: [usize; 2]) -> [f64; 4] {
    let error = |i: usize| {
        let of_column = |c: usize| {
            let (a, b) = (f64::from(answers[c][i]), f64::from(truth[c][i]));
            (a - b).abs() / b.abs().max(1.0)
        };
        (first..end).map(of_column).fold(0.0, f64::max)
    };
    let mut errors: Vec<f64> = (0..answers[0].len()).map(error).collect();
    errors.sort_by(f64::total_cmp);
    ERROR_SHARES.map(|share| errors[((errors.len() - 1) as f64 * share) as usize])
}

/// [`VECTORS`] queries whose answers rounding does not move by more than half of what Python tolerates.
fn steady_queries(material: &BakedMaterial, seed: u64) -> Queries {
    let mut queries = Queries::new(material, CANDIDATES, seed);
    let steady: Vec<usize> = (0..queries.len())
        .filter(|&i| {
            let query = queries.at(i);
            let answer = oracle_answer(material, &query);
            let moved = movement(material, &query, &answer);
            OUTPUTS.iter().all(|(name, [a, b])| {
                (*a..*b).all(|c| moved[c] <= 0.5 * tolerance(name) * answer[c].abs().max(1.0))
            })
        })
        .take(VECTORS)
        .collect();
    assert_eq!(steady.len(), VECTORS, "too many answers hang on rounding");
    let columns = queries.params.iter_mut().chain(&mut queries.wo);
    for column in columns.chain(&mut queries.u).chain(&mut queries.wi) {
        *column = steady.iter().map(|&i| column[i]).collect();
    }
    queries
}

/// Runs `bake_bsdf.verify` on `folder` with `answers` as the truth.
fn verify_in_python(folder: &Path, queries: &Queries, answers: &[Vec<f32>]) {
    let scratch = tempfile::tempdir().expect("a temporary folder can be made");
    let vectors = scratch.path().join("vectors.json");
    std::fs::write(&vectors, to_json(queries, answers).to_string())
        .expect("a temporary folder can be written");
    let output = Command::new(python())
        .envs([
            ("PYTHONPATH", workspace().join("export/python")),
            ("PYTHONDONTWRITEBYTECODE", "1".into()),
        ])
        .args(["-m", "bake_bsdf.verify"])
        .args([folder, &vectors])
        .output()
        .expect("the interpreter starts");
    let printed = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success(),
        "verify.py: {}\n{printed}{errors}",
        output.status
    );
}

/// The file that `bake_bsdf.verify` reads.
fn to_json(queries: &Queries, answers: &[Vec<f32>]) -> serde_json::Value {
    let rows = |columns: &[Vec<f32>]| -> Vec<Vec<f32>> {
        (0..queries.len())
            .map(|i| columns.iter().map(|column| column[i]).collect())
            .collect()
    };
    let mut file = serde_json::json!({
        "tolerance": OUTPUTS.map(|(name, _)| (name.to_string(), tolerance(name))).into_iter()
            .collect::<std::collections::BTreeMap<_, _>>(),
    });
    for role in Role::ALL {
        let mut table = serde_json::Map::new();
        let mut put = |name: &str, columns: &[Vec<f32>]| {
            table.insert(name.into(), rows(columns).into());
        };
        if !queries.params.is_empty() {
            put("params", &queries.params);
        }
        put("wo", &queries.wo);
        match role {
            Role::Sample => put("u", &queries.u),
            Role::Eval | Role::Pdf => put("wi", &queries.wi),
        }
        for port in role.graph_outputs() {
            let of = OUTPUTS.iter().find(|(name, _)| *name == port.name);
            let (_, [a, b]) = of.expect("every output has columns");
            put(port.name, &answers[*a..*b]);
        }
        file[role.name()] = table.into();
    }
    file
}
