//! Running the real program in a temporary folder that holds a copy of the vase scene.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// The scene, relative to the folder.
pub const SCENE: &str = "scenes/vase";
/// Its file.
pub const SCENE_FILE: &str = "scenes/vase/scene.toml";
/// The file of its material.
pub const MATERIAL_FILE: &str = "scenes/materials/vase.toml";

/// How often a running program is looked at.
const POLL: Duration = Duration::from_millis(20);

/// A temporary folder, the program's current one, with copies of [`SCENE_FILE`] and [`MATERIAL_FILE`].
pub struct Studio {
    folder: TempDir,
}

impl Studio {
    /// An unchanged copy.
    pub fn new() -> Studio {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        for file in [SCENE_FILE, MATERIAL_FILE] {
            let copy = folder.path().join(file);
            std::fs::create_dir_all(copy.parent().expect("files lie in folders")).expect("it can be written");
            std::fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join(file), copy)
                .expect("the vase is part of the tree");
        }
        Studio { folder }
    }

    /// The path of `name` in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The program, to be started in the folder; it finds no onnxruntime unless told where one is.
    pub fn bake(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_bake"));
        command.args(arguments).current_dir(self.folder.path());
        command.env("ORT_DYLIB_PATH", self.path("no-onnxruntime.so"));
        command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    /// Every file and folder in the folder, with the bytes of files.
    pub fn listing(&self) -> BTreeMap<PathBuf, Option<Vec<u8>>> {
        let mut found = BTreeMap::new();
        list(self.folder.path(), &mut found);
        found
    }
}

fn list(folder: &Path, found: &mut BTreeMap<PathBuf, Option<Vec<u8>>>) {
    for entry in std::fs::read_dir(folder).expect("the folder can be read") {
        let path = entry.expect("the folder can be read").path();
        if path.is_dir() {
            list(&path, found);
            found.insert(path, None);
        } else {
            let bytes = std::fs::read(&path).expect("the file can be read");
            found.insert(path, Some(bytes));
        }
    }
}

/// What `child` printed; killed, and the test failed, when it runs longer than `limit`.
pub fn finish(mut child: Child, limit: Duration) -> Output {
    let deadline = Instant::now() + limit;
    while child.try_wait().expect("the child is ours").is_none() {
        if Instant::now() > deadline {
            child.kill().expect("the child is ours");
            let output = child.wait_with_output().expect("the child is ours");
            panic!(
                "the program did not end within {limit:?}; it printed {}",
                String::from_utf8_lossy(&output.stderr)
            );
        }
        std::thread::sleep(POLL);
    }
    child.wait_with_output().expect("the child is ours")
}
