//! The one error type of this crate.

use crate::real::Real;
use std::path::PathBuf;

/// What can go wrong when a material or a network is described, loaded or queried.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A material parameter is missing, unknown, not a number, or out of its range.
    #[error("material parameter `{name}`: {reason}")]
    Parameter {
        /// The parameter as the material file spells it, e.g. `alpha[0]`.
        name: String,
        /// What is wrong and which values are allowed.
        reason: String,
    },
    /// A file could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A network file is truncated, of another program, or contradicts its own specification.
    #[error("{path}: not a network this program can run: {reason}; bake the material again")]
    Network {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A table of BSDF slices is truncated, of another program, or contradicts itself.
    #[error("{path}: cannot import its BSDF slices: {reason}; `bake_bsdf.write_slices` writes such files")]
    Import {
        /// The file.
        path: PathBuf,
        /// What is wrong, where, and what it must be.
        reason: String,
    },
    /// A line is not what was expected of it.
    #[error("not a JSON object: {0}")]
    Json(String),
    /// A query asks for something that makes no sense.
    #[error("`{name}`: {reason}")]
    Query {
        /// The part of the query, e.g. `wo` or, of a batch, `wo[3]`.
        name: String,
        /// What is wrong with it and what is allowed.
        reason: String,
    },
    /// The slices of one batch differ in length.
    #[error("batch of {expected} queries, but `{name}` has {found} elements")]
    BatchLength {
        /// The offending argument.
        name: &'static str,
        /// The length of the first argument.
        expected: usize,
        /// The length found.
        found: usize,
    },
    /// The SIMD tier asked for does not exist on this processor.
    #[error("SIMD tier `{0}` is not available on this processor")]
    Tier(&'static str),
    /// onnxruntime is missing, too old, or refused a model.
    #[error("{0}")]
    Onnxruntime(String),
}

/// `Result` with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// An [`Error::Io`] for `path`.
    pub fn io(path: impl Into<PathBuf>, source: std::io::Error) -> Self {
        Error::Io {
            path: path.into(),
            source,
        }
    }

    /// An [`Error::Parameter`] for `name`.
    pub fn parameter(name: impl Into<String>, reason: impl Into<String>) -> Self {
        Error::Parameter {
            name: name.into(),
            reason: reason.into(),
        }
    }

    /// An [`Error::Query`] for `name`.
    pub fn query(name: impl Into<String>, reason: impl Into<String>) -> Self {
        Error::Query {
            name: name.into(),
            reason: reason.into(),
        }
    }

    /// An [`Error::Network`] for `path`.
    pub fn network(path: impl Into<PathBuf>, reason: impl Into<String>) -> Self {
        Error::Network {
            path: path.into(),
            reason: on_one_line(reason.into()),
        }
    }

    /// An [`Error::Import`] for `path`.
    pub fn import(path: impl Into<PathBuf>, reason: impl Into<String>) -> Self {
        Error::Import {
            path: path.into(),
            reason: on_one_line(reason.into()),
        }
    }
}

/// `reason` as it is, or escaped: what it quotes from a file may break lines, or be what a terminal takes for commands.
fn on_one_line(reason: String) -> String {
    match reason.contains(char::is_control) {
        true => reason.escape_debug().to_string(),
        false => reason,
    }
}

/// Checks that every element of the parameter `name` lies in `lowest..=highest`.
pub(crate) fn check(name: &str, values: &[Real], lowest: Real, highest: Real) -> Result<()> {
    match values.iter().position(|v| !(lowest..=highest).contains(v)) {
        Some(i) => Err(Error::parameter(
            component(name, i, values.len()),
            format!("is {}, but must lie in {lowest}..{highest}", values[i]),
        )),
        None => Ok(()),
    }
}

/// What errors call component `i` of the `count` of parameter `name`: `g`, `alpha[0]`.
pub(crate) fn component(name: &str, i: usize, count: usize) -> String {
    match count {
        1 => name.to_string(),
        _ => format!("{name}[{i}]"),
    }
}
