//! The same answers wherever a baked material runs: native kernels, onnxruntime in Rust, onnxruntime in Python.
//!
//! Everything is measured as max |a − b| / max(1, |b|). The shipped vase is compared on a million queries; random
//! networks are compared with the f64 oracle, so that the exported graph is right and not merely consistent.

#[path = "support/networks.rs"]
mod networks;
mod support;

use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::onnxruntime::{ONNXRUNTIME_PINNED, OrtBackend};
use bake_runtime::{Backend, BakedMaterial, Rng, oracle};
use networks::random_material;
use std::path::{Path, PathBuf};
use std::process::Command;
use support::python::{python, workspace};

/// `wi` is a unit vector, a smooth function of outputs that f32 layers of width ≤ 64 leave within about 1e-6.
const WI_TOL: f64 = 1e-5;
/// Everything else passes through an exponential or a quotient by cos θ, which cost up to a digit more.
const OUTPUT_TOL: f64 = 1e-4;

/// Queries of the comparison on the shipped material.
const QUERIES: usize = 1_000_000;
/// Queries of a comparison with the oracle, which is slow.
const ORACLE_QUERIES: usize = 20_000;
/// Fixed vectors for Python: small enough for a readable file, large enough for every stratum.
const VECTORS: usize = 256;

/// Largest angle of `wo` and `wi` from the normal.
const THETA_MAX_DEG: f64 = 89.99;
/// Largest f32 below 1, the largest u that a renderer can draw.
const U_LARGEST: f32 = 1.0 - 1.0 / (1u32 << 24) as f32;

#[test]
fn native_and_onnxruntime_agree_on_a_million_queries_of_the_vase() {
    python();
    agree(&vase(), QUERIES);
}

#[test]
fn python_onnxruntime_gives_the_same_vectors_of_the_vase() {
    let material = load(&vase());
    let mut native = NativeBackend::new(&material, Tier::best()).expect("the best tier is available");
    verify_in_python(
        &vase(),
        &Answers::of(&mut native, &Queries::new(&material, VECTORS, 3)),
    );
}

#[test]
fn exported_graphs_are_what_the_oracle_defines() {
    python();
    for (i, (hidden, frame_hidden)) in [(vec![32; 4], vec![16; 2]), (vec![7], vec![]), (vec![], vec![5])]
        .into_iter()
        .enumerate()
    {
        let material = random_material(&hidden, &frame_hidden, i as u64);
        let folder = exported(&material);
        let mut ort = OrtBackend::new(folder.path()).expect("exported models load");
        let queries = Queries::new(&material, ORACLE_QUERIES, i as u64);
        let expected = Answers::of_oracle(&material, &queries);
        let worst = Answers::of(&mut ort, &queries).differences(&expected);
        assert_within(
            &worst,
            &format!("onnxruntime against the oracle, hidden {hidden:?}"),
        );
    }
}

#[test]
fn native_and_onnxruntime_agree_on_random_networks() {
    python();
    for seed in 0..3 {
        let folder = exported(&random_material(&[32; 4], &[16; 2], seed));
        agree(folder.path(), ORACLE_QUERIES);
    }
}

#[test]
fn python_onnxruntime_gives_the_oracles_vectors() {
    let material = random_material(&[32; 4], &[16; 2], 9);
    let folder = exported(&material);
    verify_in_python(
        folder.path(),
        &Answers::of_oracle(&material, &Queries::new(&material, VECTORS, 9)),
    );
}

#[test]
#[should_panic(expected = "MISMATCH")]
fn python_notices_a_wrong_vector() {
    let material = random_material(&[32; 4], &[16; 2], 9);
    let folder = exported(&material);
    let mut answers = Answers::of_oracle(&material, &Queries::new(&material, VECTORS, 9));
    answers.weight[1][7] += 1e-3 * answers.weight[1][7].max(1.0);
    verify_in_python(folder.path(), &answers);
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

fn vase() -> PathBuf {
    workspace().join("scenes/materials/vase")
}

fn load(folder: &Path) -> BakedMaterial {
    BakedMaterial::load(folder).unwrap_or_else(|e| panic!("{e}"))
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
    let mut native = NativeBackend::new(&material, Tier::best()).expect("the best tier is available");
    let mut ort = OrtBackend::new(folder).unwrap_or_else(|e| panic!("{e}"));
    let queries = Queries::new(&material, count, 1);
    let expected = Answers::of(&mut native, &queries);
    let worst = Answers::of(&mut ort, &queries).differences(&expected);
    assert_within(
        &worst,
        &format!(
            "onnxruntime against {} in {}",
            Tier::best().name(),
            folder.display()
        ),
    );
}

fn assert_within(worst: &[(&str, f64)], what: &str) {
    for &(name, difference) in worst {
        // Written so that NaN fails.
        assert!(
            difference <= tolerance(name),
            "{what}: {name} differs by {difference:.2e}; all: {worst:?}"
        );
    }
}

fn tolerance(output: &str) -> f64 {
    if output == "wi" { WI_TOL } else { OUTPUT_TOL }
}

/// Runs `bake_bsdf.verify` on `folder` with `answers` as the truth.
fn verify_in_python(folder: &Path, answers: &Answers) {
    let scratch = tempfile::tempdir().expect("a temporary folder can be made");
    let vectors = scratch.path().join("vectors.json");
    std::fs::write(&vectors, answers.to_json().to_string()).expect("a temporary folder can be written");
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

/// A structure of arrays with K components.
type Soa<const K: usize> = [Vec<f32>; K];

fn soa<const K: usize>(count: usize) -> Soa<K> {
    std::array::from_fn(|_| vec![0.0; count])
}

fn slices<const K: usize>(soa: &Soa<K>) -> [&[f32]; K] {
    soa.each_ref().map(Vec::as_slice)
}

fn slices_mut<const K: usize>(soa: &mut Soa<K>) -> [&mut [f32]; K] {
    soa.each_mut().map(Vec::as_mut_slice)
}

fn row<const K: usize>(soa: &Soa<K>, i: usize) -> [f64; K] {
    std::array::from_fn(|c| f64::from(soa[c][i]))
}

fn set<const K: usize>(soa: &mut Soa<K>, i: usize, row: &[f64]) {
    soa.iter_mut()
        .zip(row)
        .for_each(|(column, &value)| column[i] = value as f32);
}

/// Random queries that include the edges of every domain.
#[derive(Clone)]
struct Queries {
    wo: Soa<3>,
    u: Soa<2>,
    wi: Soa<3>,
}

impl Queries {
    /// `count` queries: θ uniform up to [`THETA_MAX_DEG`], one u in eight at either end of its range, and every
    /// other `wi` drawn by the material itself, so that evaluations meet the lobe.
    fn new(material: &BakedMaterial, count: usize, seed: u64) -> Queries {
        let mut rng = Rng::new(&[0x7061_7269_7479, seed]);
        let (mut wo, mut u, mut wi) = (soa(count), soa(count), soa(count));
        for i in 0..count {
            let outward = direction(&mut rng);
            let uniforms = [uniform(&mut rng), uniform(&mut rng)];
            let mut inward = direction(&mut rng);
            if i % 2 == 0 {
                let drawn = oracle::sample(&material.sample, outward.map(f64::from), uniforms.map(f64::from));
                inward = drawn.wi.map(|c| c as f32);
            }
            set(&mut wo, i, &outward.map(f64::from));
            set(&mut u, i, &uniforms.map(f64::from));
            set(&mut wi, i, &inward.map(f64::from));
        }
        Queries { wo, u, wi }
    }
}

fn direction(rng: &mut Rng) -> [f32; 3] {
    let theta = match rng.bits() % 64 {
        0 => 0.0,
        1 => THETA_MAX_DEG.to_radians(),
        _ => rng.uniform() * THETA_MAX_DEG.to_radians(),
    };
    let (sin_phi, cos_phi) = (rng.uniform() * std::f64::consts::TAU).sin_cos();
    [theta.sin() * cos_phi, theta.sin() * sin_phi, theta.cos()].map(|c| c as f32)
}

/// An f32 uniform, a multiple of 2⁻²⁴.
fn uniform(rng: &mut Rng) -> f32 {
    match rng.bits() % 16 {
        0 => 0.0,
        1 => U_LARGEST,
        _ => (rng.bits() >> 40) as f32 / (1u32 << 24) as f32,
    }
}

/// What a backend answers to [`Queries`].
struct Answers {
    queries: Queries,
    wi: Soa<3>,
    weight: Soa<3>,
    jacobian: Soa<1>,
    f_cos: Soa<3>,
    pdf: Soa<1>,
}

impl Answers {
    fn empty(queries: &Queries) -> Answers {
        let n = queries.wo[0].len();
        let queries = queries.clone();
        Answers {
            queries,
            wi: soa(n),
            weight: soa(n),
            jacobian: soa(n),
            f_cos: soa(n),
            pdf: soa(n),
        }
    }

    /// Every method of `backend`; both ways to sample must draw the same `wi`.
    fn of(backend: &mut dyn Backend, queries: &Queries) -> Answers {
        let mut a = Answers::empty(queries);
        let mut learned_wi = soa(queries.wo[0].len());
        let (wo, u, wi) = (slices(&queries.wo), slices(&queries.u), slices(&queries.wi));
        let run = |result: bake_runtime::Result<()>| result.unwrap_or_else(|e| panic!("{e}"));
        run(backend.sample_learned(wo, u, slices_mut(&mut learned_wi), slices_mut(&mut a.weight)));
        run(backend.sample_jacobian(wo, u, slices_mut(&mut a.wi), &mut a.jacobian[0]));
        run(backend.eval(wo, wi, slices_mut(&mut a.f_cos)));
        run(backend.pdf(wo, wi, &mut a.pdf[0]));
        let apart = difference(&learned_wi, &a.wi);
        assert!(
            apart <= WI_TOL,
            "sample_learned and sample_jacobian draw wi that differ by {apart:.2e}"
        );
        a
    }

    fn of_oracle(material: &BakedMaterial, queries: &Queries) -> Answers {
        let mut a = Answers::empty(queries);
        for i in 0..queries.wo[0].len() {
            let (wo, u, wi) = (row(&queries.wo, i), row(&queries.u, i), row(&queries.wi, i));
            let drawn = oracle::sample(&material.sample, wo, u);
            set(&mut a.wi, i, &drawn.wi);
            set(&mut a.weight, i, &drawn.weight);
            set(&mut a.f_cos, i, &oracle::density(&material.eval, wo, wi));
            set(&mut a.jacobian, i, &[drawn.jacobian]);
            set(&mut a.pdf, i, &oracle::density(&material.pdf, wo, wi));
        }
        a
    }

    /// The difference of every output from `expected`, by name.
    fn differences(&self, expected: &Answers) -> [(&'static str, f64); 5] {
        [
            ("wi", difference(&self.wi, &expected.wi)),
            ("weight", difference(&self.weight, &expected.weight)),
            ("jacobian", difference(&self.jacobian, &expected.jacobian)),
            ("f_cos", difference(&self.f_cos, &expected.f_cos)),
            ("pdf", difference(&self.pdf, &expected.pdf)),
        ]
    }

    /// The file that `bake_bsdf.verify` reads.
    fn to_json(&self) -> serde_json::Value {
        fn rows<const K: usize>(soa: &Soa<K>) -> Vec<Vec<f64>> {
            (0..soa[0].len()).map(|i| row(soa, i).to_vec()).collect()
        }
        let q = &self.queries;
        let tolerances =
            ["wi", "weight", "jacobian", "f_cos", "pdf"].map(|name| (name.to_string(), tolerance(name)));
        serde_json::json!({
            "tolerance": std::collections::BTreeMap::from(tolerances),
            "sample": { "wo": rows(&q.wo), "u": rows(&q.u), "wi": rows(&self.wi), "weight": rows(&self.weight),
                        "jacobian": rows(&self.jacobian) },
            "eval": { "wo": rows(&q.wo), "wi": rows(&q.wi), "f_cos": rows(&self.f_cos) },
            "pdf": { "wo": rows(&q.wo), "wi": rows(&q.wi), "pdf": rows(&self.pdf) },
        })
    }
}

/// max |a − b| / max(1, |b|); NaN where either holds one.
fn difference<const K: usize>(a: &Soa<K>, b: &Soa<K>) -> f64 {
    let pairs = a
        .iter()
        .flatten()
        .zip(b.iter().flatten())
        .map(|(&a, &b)| (f64::from(a), f64::from(b)));
    let relative = pairs.map(|(a, b)| (a - b).abs() / b.abs().max(1.0));
    relative.fold(0.0, |worst, d| if d.is_nan() || d > worst { d } else { worst })
}
