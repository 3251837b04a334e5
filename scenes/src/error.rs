//! The one error type of this crate.

use std::path::{Path, PathBuf};

/// What can go wrong when a scene is read, rendered or written.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A file is not TOML.
    #[error("{path}:{line}: not valid TOML: {reason}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line of the mistake, counted from 1.
        line: usize,
        /// What the parser said.
        reason: String,
    },
    /// A key is unknown, missing, of a wrong type, or its value makes no sense.
    #[error("{path}: `{key}`: {reason}")]
    Key {
        /// The file.
        path: PathBuf,
        /// The key as the file spells it, e.g. `camera.position[1]`.
        key: String,
        /// What is wrong and what is allowed.
        reason: String,
    },
    /// A material is described by values that its family does not allow.
    #[error("{path}: {source}")]
    Material {
        /// The material file.
        path: PathBuf,
        /// The parameter and what is wrong with it.
        source: bake_runtime::Error,
    },
    /// An image file is damaged, or not of the kind that was expected.
    #[error("{path}: not an image this program can use: {reason}")]
    ImageFile {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Two images that should be compared, averaged or shown together differ in size.
    #[error("images differ in size: {}×{} and {}×{} pixels", .first[0], .first[1], .second[0], .second[1])]
    ImageSize {
        /// Width and height of the first.
        first: [usize; 2],
        /// Width and height of the second.
        second: [usize; 2],
    },
    /// A backend or a reference model refused its work.
    #[error(transparent)]
    Runtime(#[from] bake_runtime::Error),
    /// The caller asked to stop.
    #[error("rendering was cancelled")]
    Cancelled,
}

/// `Result` with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// An [`Error::Io`] for `path`.
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        Error::Io {
            path: path.into(),
            source,
        }
    }

    /// An [`Error::Key`] for `key` of `path`.
    pub fn key(path: &Path, key: impl Into<String>, reason: impl Into<String>) -> Self {
        Error::Key {
            path: path.into(),
            key: key.into(),
            reason: reason.into(),
        }
    }

    /// An [`Error::ImageFile`] for `path`.
    pub fn image_file(path: &Path, reason: impl Into<String>) -> Self {
        Error::ImageFile {
            path: path.into(),
            reason: reason.into(),
        }
    }
}
