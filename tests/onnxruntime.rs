//! The onnxruntime backend at its edges: odd batches, invalid queries, bad model files, bad libraries.
//!
//! onnxruntime is loaded once per process, so every bad library is tried in a process of its own: this test
//! program again, told to run only [`child_that_loads_a_model`].

#[path = "support/networks.rs"]
mod networks;
mod support;

use bake_runtime::onnxruntime::{ONNXRUNTIME_PINNED, OrtBackend, library_path};
use bake_runtime::{Backend, Error};
use networks::random_material;
use std::path::{Path, PathBuf};
use std::process::Command;
use support::python::python;

/// Set for the child: the file it writes its error to.
const REPORT_VARIABLE: &str = "BAKE_TEST_REPORT";

/// Sizes of a batch: around one and around every power of two that a chunk may have.
const SIZES: [usize; 8] = [0, 1, 2, 255, 257, 1024, 1025, 4097];

/// Sums of a dozen f32 terms of size 1, in another order.
const ROUNDING_TOL: f32 = 1e-6;

#[test]
fn batches_of_any_size_give_the_same_answers() {
    python();
    let folder = exported();
    let mut ort = OrtBackend::new(folder.path()).expect("exported models load");
    let largest = SIZES.into_iter().max().expect("there are sizes");
    let column = |step: f32| -> Vec<f32> { (0..largest).map(|i| (i as f32 * step).fract()).collect() };
    let (u, v, z) = (column(0.618_034), column(0.754_877_7), vec![1.0; largest]);
    let zero = vec![0.0; largest];
    let mut draw = |n: usize| {
        let mut wi = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
        let mut jacobian = vec![0.0; n];
        let out = wi.each_mut().map(Vec::as_mut_slice);
        ort.sample_jacobian(
            [&zero[..n], &zero[..n], &z[..n]],
            [&u[..n], &v[..n]],
            out,
            &mut jacobian,
        )
        .unwrap_or_else(|e| panic!("{n} queries: {e}"));
        (wi, jacobian)
    };
    let (all, _) = draw(largest);
    for n in SIZES {
        let (wi, jacobian) = draw(n);
        assert_eq!(jacobian.len(), n);
        for c in 0..3 {
            // Sizes take different kernels of onnxruntime, which round differently.
            let apart = wi[c]
                .iter()
                .zip(&all[c])
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f32::max);
            assert!(
                apart <= ROUNDING_TOL,
                "{n} queries: component {c} of wi differs by {apart:e}"
            );
        }
    }
}

#[test]
fn slices_of_different_length_are_an_error() {
    python();
    let folder = exported();
    let mut ort = OrtBackend::new(folder.path()).expect("exported models load");
    let (two, three) = ([0.5; 2], [0.5; 3]);
    let mut pdf = [0.0; 3];
    let error = ort
        .pdf([&three, &three, &three], [&three, &two, &three], &mut pdf)
        .expect_err("lengths differ");
    assert!(
        matches!(
            error,
            Error::BatchLength {
                name: "wi",
                expected: 3,
                found: 2
            }
        ),
        "{error}"
    );
}

#[test]
fn invalid_queries_give_zeros_and_the_normal() {
    python();
    let folder = exported();
    let mut ort = OrtBackend::new(folder.path()).expect("exported models load");
    let nan = f32::NAN;
    let directions = [
        [0.0, 0.0, -1.0],
        [1.0, 0.0, 0.0],
        [nan, 0.0, 1.0],
        [0.0, f32::INFINITY, 1.0],
        [0.0, 0.0, nan],
        [0.6, 0.0, 0.8],
    ];
    let n = directions.len();
    let soa: [Vec<f32>; 3] = std::array::from_fn(|c| directions.iter().map(|d| d[c]).collect());
    let w = soa.each_ref().map(Vec::as_slice);
    let u = vec![0.25; n];
    let mut out = [(); 7].map(|()| vec![nan; n]);
    let [x, y, z, r, g, b, j] = out.each_mut().map(Vec::as_mut_slice);
    ort.sample_learned([w[0], w[1], w[2]], [&u, &u], [x, y, z], [r, g, b])
        .expect("invalid queries are answered");
    ort.pdf([w[0], w[1], w[2]], [w[0], w[1], w[2]], j)
        .expect("invalid queries are answered");
    for i in 0..n - 1 {
        let row = out.each_ref().map(|column| column[i]);
        assert_eq!(
            row,
            [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
            "query {i}, {:?}",
            directions[i]
        );
    }
    assert!(
        out[3][n - 1] > 0.0 && out[6][n - 1] > 0.0,
        "the valid query among them is answered"
    );
}

#[test]
fn u_outside_its_range_gives_finite_answers() {
    python();
    let folder = exported();
    let mut ort = OrtBackend::new(folder.path()).expect("exported models load");
    let u = [0.0, 1.0, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    let v = [0.5; 6];
    let (zero, one) = ([0.0; 6], [1.0; 6]);
    let mut out = [[f32::NAN; 6]; 4];
    let [x, y, z, jacobian] = out.each_mut().map(|a| &mut a[..]);
    ort.sample_jacobian([&zero, &zero, &one], [&u, &v], [x, y, z], jacobian)
        .expect("every u is answered");
    assert!(out.iter().flatten().all(|value| value.is_finite()), "{out:?}");
}

#[test]
fn damaged_and_foreign_models_are_named() {
    python();
    let folder = exported();
    let path = folder.path().join("eval.onnx");
    let whole = std::fs::read(&path).expect("just written");
    let sample = std::fs::read(folder.path().join("sample.onnx")).expect("just written");
    let halves = [0, 1, whole.len() / 2, whole.len() - 1].map(|length| whole[..length].to_vec());
    let foreign = [b"not a model".to_vec(), without_metadata(&whole), sample];
    for bytes in halves.into_iter().chain(foreign) {
        std::fs::write(&path, &bytes).expect("a temporary folder can be written");
        match OrtBackend::new(folder.path()) {
            Err(Error::Network { path: named, reason }) => {
                assert_eq!(named, path);
                assert!(!reason.is_empty() && !reason.contains('\n'), "{reason}");
            }
            Err(other) => panic!("{} bytes: {other}", bytes.len()),
            Ok(_) => panic!("{} bytes of another model were accepted", bytes.len()),
        }
    }
    std::fs::remove_file(&path).expect("just written");
    assert!(matches!(OrtBackend::new(folder.path()), Err(Error::Io { path: named, .. }) if named == path));
}

#[test]
fn bad_libraries_are_errors_that_say_what_to_install() {
    python();
    let folder = exported();
    let missing = folder.path().join("libonnxruntime.so");
    let text = folder.path().join("text.so");
    std::fs::write(&text, "not a library").expect("a temporary folder can be written");
    let good = library_path().expect("the environment of the tests has the library");
    let unrelated = good.with_file_name("libonnxruntime_providers_shared.so");
    assert!(
        unrelated.is_file(),
        "{} comes with the wheel",
        unrelated.display()
    );
    let old = old_library(folder.path());
    for library in [missing.as_path(), folder.path(), &text, &unrelated, &old] {
        let message = error_with_library(library, folder.path());
        let library = library.display().to_string();
        assert!(message.contains(&library), "{library} is not named: {message}");
        assert!(
            message.contains(&format!("onnxruntime=={ONNXRUNTIME_PINNED}")),
            "{library}: no way out: {message}"
        );
    }
    assert_eq!(error_with_library(&good, folder.path()), "");
    std::fs::copy(&good, folder.path().join("copy.so")).expect("a temporary folder can be written");
    assert_eq!(
        error_with_library(Path::new("copy.so"), folder.path()),
        "",
        "a path relative to the current folder"
    );
}

/// Not a test of its own: loads the models of the current folder and reports the error, or nothing.
#[test]
fn child_that_loads_a_model() {
    let Some(report) = std::env::var_os(REPORT_VARIABLE) else {
        return;
    };
    // Two threads at once, as a renderer would.
    let load = || {
        OrtBackend::new(Path::new("."))
            .err()
            .map(|e| e.to_string())
            .unwrap_or_default()
    };
    let (first, second) = std::thread::scope(|s| {
        let other = s.spawn(load);
        (load(), other.join().expect("the other thread does not panic"))
    });
    assert_eq!(first, second);
    std::fs::write(report, first).expect("the parent's folder can be written");
}

/// The error of a process that loads the models in `folder` with the library at `library`; empty if there is none.
fn error_with_library(library: &Path, folder: &Path) -> String {
    let report = folder.join("report.txt");
    let output = Command::new(std::env::current_exe().expect("this program has a path"))
        .args(["--exact", "child_that_loads_a_model"])
        .env("ORT_DYLIB_PATH", library)
        .env(REPORT_VARIABLE, &report)
        .current_dir(folder)
        .output()
        .expect("this program starts again");
    let printed = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success(),
        "{}: {}\n{printed}",
        library.display(),
        output.status
    );
    std::fs::read_to_string(&report).expect("the child writes its report")
}

/// A library that says it is onnxruntime 1.10.
fn old_library(folder: &Path) -> PathBuf {
    let (source, library) = (folder.join("old.rs"), folder.join("libold.so"));
    let code = r#"
        #[repr(C)]
        pub struct Base { api: extern "C" fn(u32) -> *const u8, version: extern "C" fn() -> *const u8 }
        extern "C" fn api(_: u32) -> *const u8 { std::ptr::null() }
        extern "C" fn version() -> *const u8 { c"1.10.0".as_ptr().cast() }
        static BASE: Base = Base { api, version };
        #[unsafe(no_mangle)]
        pub extern "C" fn OrtGetApiBase() -> *const Base { &BASE }
    "#;
    std::fs::write(&source, code).expect("a temporary folder can be written");
    let mut rustc = Command::new(std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()));
    let rustc = rustc
        .args(["--edition", "2024", "--crate-type", "cdylib", "-o"])
        .arg(&library)
        .arg(&source);
    let output = rustc.output().expect("rustc is there, since it built this test");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    library
}

/// `model` without its last field, which is the metadata.
fn without_metadata(model: &[u8]) -> Vec<u8> {
    let key = bake_runtime::spec::SPEC_KEY.as_bytes();
    let at = model
        .windows(key.len())
        .position(|w| w == key)
        .expect("the metadata holds the key");
    // In front of the key stand its own tag and length, and the entry's tag (14, length-delimited) and length.
    let tag = (14 << 3) | 2;
    let start = model[..at]
        .iter()
        .rposition(|&byte| byte == tag)
        .expect("the entry begins with its tag");
    model[..start].to_vec()
}

/// A temporary folder with the ONNX files of a small network.
fn exported() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    bake_export::export(&random_material(&[8], &[4], 0), folder.path())
        .expect("a temporary folder can be written");
    folder
}
