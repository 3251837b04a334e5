//! Finds and loads the onnxruntime library, once per process.
//!
//! Nothing is linked: the library is that of the Python wheel, or whichever `ORT_DYLIB_PATH` names. Only
//! `ort::init_from` reports a bad library as an error; the other ways into `ort` panic, so none is used before.

use crate::error::{Error, Result};
use ort::environment::Environment;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// The onnxruntime that the tests install and that the models are checked with.
pub const ONNXRUNTIME_PINNED: &str = "1.31.1";

/// Variable that names the library file.
const PATH_VARIABLE: &str = "ORT_DYLIB_PATH";

/// Where a Python environment that the tests make stands, relative to the workspace.
const PYTHON_ENVIRONMENT: &str = "target/python";

/// The environment, once made; onnxruntime allows one per process.
static ENVIRONMENT: Mutex<Option<Environment>> = Mutex::new(None);

/// Path of the onnxruntime library: what `ORT_DYLIB_PATH` names, else the one in `target/python` of the current
/// folder, of the program's folder, or of a folder above either.
///
/// # Errors
/// [`Error::Onnxruntime`] saying what was sought, where, and how to get it.
pub fn library_path() -> Result<PathBuf> {
    if let Some(path) = std::env::var_os(PATH_VARIABLE)
        .filter(|value| !value.is_empty())
        .map(PathBuf::from)
    {
        // Only a plain file is ever opened: a pipe would block and a folder cannot be loaded.
        // A bare name is made absolute, because the loader would seek it among the system's libraries.
        return match std::path::absolute(&path).ok().filter(|path| path.is_file()) {
            Some(path) => Ok(path),
            None => Err(Error::Onnxruntime(format!(
                "{PATH_VARIABLE} is `{}`, which is not a file; set it to libonnxruntime.so.{ONNXRUNTIME_PINNED} of \
                 `pip install onnxruntime=={ONNXRUNTIME_PINNED}`, or unset it",
                path.display()
            ))),
        };
    }
    let program = std::env::current_exe()
        .ok()
        .and_then(|exe| exe.parent().map(Path::to_path_buf));
    let starts: Vec<PathBuf> = std::env::current_dir().into_iter().chain(program).collect();
    let found = starts
        .iter()
        .flat_map(|start| start.ancestors())
        .find_map(|folder| in_environment(&folder.join(PYTHON_ENVIRONMENT)));
    found.ok_or_else(|| {
        let starts: Vec<String> = starts.iter().map(|start| format!("`{}`", start.display())).collect();
        Error::Onnxruntime(format!(
            "the onnxruntime library was not found: {PATH_VARIABLE} is not set, and there is no \
             {PYTHON_ENVIRONMENT} with onnxruntime at or above {}; run `pip install \
             onnxruntime=={ONNXRUNTIME_PINNED}` and set {PATH_VARIABLE} to its capi/libonnxruntime.so.{ONNXRUNTIME_PINNED}",
            starts.join(" or ")
        ))
    })
}

/// The process's onnxruntime environment, made on the first call; safe from any thread.
///
/// A failure is not remembered, so a later call succeeds once the library is there.
pub fn environment() -> Result<Environment> {
    let mut made = ENVIRONMENT.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(environment) = made.as_ref() {
        return Ok(environment.clone());
    }
    let path = library_path()?;
    let unusable = |reason: String| {
        Error::Onnxruntime(format!(
            "`{}` is not a usable onnxruntime library ({reason}); run `pip install \
             onnxruntime=={ONNXRUNTIME_PINNED}` and set {PATH_VARIABLE} to its libonnxruntime.so.{ONNXRUNTIME_PINNED}",
            path.display()
        ))
    };
    let builder = ort::init_from(&path).map_err(|e| unusable(e.to_string()))?;
    let environment = builder
        .with_name("bake")
        .with_telemetry(false)
        .build()
        .map_err(|e| unusable(e.to_string()))?;
    Ok(made.insert(environment).clone())
}

/// The library inside the Python environment at `root`: the highest name, should there be several.
fn in_environment(root: &Path) -> Option<PathBuf> {
    let unix = entries(&root.join("lib"))
        .into_iter()
        .map(|python| python.join("site-packages"));
    let windows = root.join("Lib").join("site-packages");
    let packages = unix.chain([windows]);
    let files = packages.flat_map(|site| entries(&site.join("onnxruntime").join("capi")));
    files.filter(|path| is_library(path) && path.is_file()).max()
}

fn is_library(path: &Path) -> bool {
    let name = path
        .file_name()
        .and_then(|name| name.to_str())
        .unwrap_or_default();
    name.starts_with("libonnxruntime.so")
        || name == "onnxruntime.dll"
        || (name.starts_with("libonnxruntime.") && name.ends_with(".dylib"))
}

/// What `folder` holds; nothing when it cannot be read.
fn entries(folder: &Path) -> Vec<PathBuf> {
    std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_library_of_an_environment_and_nothing_else() {
        let root = tempfile::tempdir().expect("a temporary folder can be made");
        assert_eq!(in_environment(root.path()), None);
        let capi = root.path().join("lib/python3.11/site-packages/onnxruntime/capi");
        std::fs::create_dir_all(&capi).expect("a folder can be made");
        for name in [
            "libonnxruntime_providers_shared.so",
            "libonnxruntime.so.1.31.1",
            "_pybind_state.py",
        ] {
            std::fs::write(capi.join(name), []).expect("a file can be written");
        }
        assert_eq!(
            in_environment(root.path()),
            Some(capi.join("libonnxruntime.so.1.31.1"))
        );
    }
}
