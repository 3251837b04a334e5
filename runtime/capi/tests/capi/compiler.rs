//! Compiles programs in C and C++ against the header and the library that these tests were built with, and runs them.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::path::{Path, PathBuf};
use std::process::Command;

/// A language: the environment variable that names its compiler, the usual name of that, and its options.
pub struct Language {
    variable: &'static str,
    compiler: &'static str,
    options: &'static [&'static str],
}

pub const C: Language = Language {
    variable: "CC",
    compiler: "cc",
    options: &["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror"],
};

pub const CPP: Language = Language {
    variable: "CXX",
    compiler: "c++",
    options: &["-std=c++11", "-pedantic", "-Wall", "-Wextra", "-Werror"],
};

/// A compiled program, in a folder of its own.
pub struct Program {
    folder: tempfile::TempDir,
}

impl Program {
    /// Compiles `source`, relative to the package.
    pub fn new(language: &Language, source: &str) -> Program {
        let package = Path::new(env!("CARGO_MANIFEST_DIR"));
        let program = Program {
            folder: tempfile::tempdir().expect("a temporary folder can be made"),
        };
        let library = library_folder();
        let compiler = std::env::var(language.variable).unwrap_or(language.compiler.to_string());
        let mut command = Command::new(&compiler);
        command
            .args(language.options)
            .arg("-I")
            .arg(package.join("../include"))
            .arg(package.join(source))
            .arg("-L")
            .arg(&library)
            .arg("-lbake")
            .arg(format!("-Wl,-rpath,{}", library.display()))
            .arg("-o")
            .arg(program.path());
        let output = command.output().unwrap_or_else(|e| {
            panic!(
                "cannot run `{compiler}`, which these tests compile with: {e}; install it, or name another in {}",
                language.variable
            )
        });
        let complaint = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{command:?}:\n{complaint}");
        program
    }

    fn path(&self) -> PathBuf {
        self.file("program")
    }

    /// A file beside the program.
    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// What the program prints with `arguments`.
    pub fn run(&self, arguments: &[&str]) -> String {
        let mut command = Command::new(self.path());
        // Cargo's own value may name folders with an older library.
        command.args(arguments).env_remove("LD_LIBRARY_PATH");
        let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
        let complaint = String::from_utf8_lossy(&output.stderr);
        assert!(
            output.status.success(),
            "{command:?}: {}\n{complaint}",
            output.status
        );
        String::from_utf8(output.stdout).expect("programs print text")
    }
}

/// Cargo puts the library beside the tests that it is built for, or one folder up.
fn library_folder() -> PathBuf {
    let test = std::env::current_exe().expect("tests have a path");
    let name = format!("{DLL_PREFIX}bake{DLL_SUFFIX}");
    let found = test
        .ancestors()
        .skip(1)
        .take(2)
        .find(|folder| folder.join(&name).is_file());
    found
        .unwrap_or_else(|| panic!("{name} does not stand beside {} or above it", test.display()))
        .to_path_buf()
}
