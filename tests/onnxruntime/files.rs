//! Damaged and foreign model files, bad libraries.
//!
//! onnxruntime is loaded once per process, so every bad library is tried in a process of its own: this test
//! program again, told to run only [`child_that_loads_a_model`].

use crate::specifications::{Places, random_networks};
use crate::support::python::python;
use crate::{exported, small};
use bake_runtime::Error;
use bake_runtime::onnxruntime::{ONNXRUNTIME_PINNED, OrtBackend, library_path};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Set for the child: the file it writes its error to.
const REPORT_VARIABLE: &str = "BAKE_TEST_REPORT";

#[test]
fn damaged_and_foreign_models_are_named() {
    python();
    let folder = exported(&small());
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
fn models_that_do_not_belong_together_are_named() {
    python();
    let folder = exported(&random_networks(Places::OneChart, false, 0));
    let other = |places, free, name: &str| {
        let other = exported(&random_networks(places, free, 0));
        std::fs::copy(other.path().join(name), folder.path().join(name)).expect("both folders can be used");
        match OrtBackend::new(folder.path()) {
            Err(Error::Network { path, reason }) => {
                assert_eq!(path, folder.path().join(name));
                reason
            }
            Err(other) => panic!("{name}: {other}"),
            Ok(_) => panic!("{name} of another material was accepted"),
        }
    };
    assert!(other(Places::TwoCharts, false, "pdf.onnx").contains("charts"));
    assert!(other(Places::OneChart, true, "eval.onnx").contains("another material"));
}

#[test]
fn bad_libraries_are_errors_that_say_what_to_install() {
    python();
    let folder = exported(&small());
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
        .args(["--exact", "files::child_that_loads_a_model"])
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
