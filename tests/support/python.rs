//! The Python environment of the tests: `target/python`, made once from `export/python/requirements.txt`.
//!
//! It also brings the onnxruntime library that `bake_runtime::onnxruntime` looks for. A test that needs it
//! fails without it and never skips, so a green run means that it was there.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

/// File in the environment that holds the requirements it was made from; written last.
const STAMP: &str = "bake-requirements.txt";

/// The interpreter of the environment, which is made on the first call and reused while the requirements stay.
///
/// Test processes may call this at the same time: one makes the environment, the others wait for it.
///
/// # Panics
/// With what to do about it, when Python 3 or a wheel cannot be had.
pub fn python() -> PathBuf {
    let root = workspace();
    let target = root.join("target");
    let environment = target.join("python");
    let requirements = root.join("export/python/requirements.txt");
    let wanted = fs::read(&requirements).unwrap_or_else(|e| panic!("{}: {e}", requirements.display()));
    fs::create_dir_all(&target).unwrap_or_else(|e| panic!("{}: {e}", target.display()));
    let lock_path = target.join("python.lock");
    let lock = File::create(&lock_path).unwrap_or_else(|e| panic!("{}: {e}", lock_path.display()));
    // Released by the operating system when `lock` is dropped or the process dies.
    lock.lock()
        .unwrap_or_else(|e| panic!("{}: {e}", lock_path.display()));
    let interpreter = environment.join("bin/python");
    let stamp = environment.join(STAMP);
    if fs::read(&stamp).is_ok_and(|made| made == wanted) && interpreter.exists() {
        return interpreter;
    }
    succeed(
        Command::new("python3")
            .args(["-m", "venv", "--clear"])
            .arg(&environment),
        "install Python 3 with venv",
    );
    let install = [
        "-m",
        "pip",
        "install",
        "--disable-pip-version-check",
        "--no-input",
        "--quiet",
        "--requirement",
    ];
    let hint = "the tests need these wheels once; check the network and that Python is 3.11 or newer";
    succeed(Command::new(&interpreter).args(install).arg(&requirements), hint);
    fs::write(&stamp, wanted).unwrap_or_else(|e| panic!("{}: {e}", stamp.display()));
    interpreter
}

/// Root of the workspace; the environment stands in its own `target`, wherever cargo builds.
pub fn workspace() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn succeed(command: &mut Command, hint: &str) {
    let output = command
        .output()
        .unwrap_or_else(|e| panic!("{command:?} did not start ({e}): {hint}"));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success(),
        "{command:?} failed ({}): {hint}\n{errors}",
        output.status
    );
}
