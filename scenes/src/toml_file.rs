//! Reads one TOML file into a type, with errors that name the file and the key in one sentence.

use crate::error::{Error, Result};
use serde::de::DeserializeOwned;
use std::path::Path;

/// Parses `path` as `T`.
///
/// # Errors
/// [`Error::Io`], [`Error::Syntax`], or [`Error::Key`] for an unknown or missing key or a value of a wrong type.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::io(path, source))?;
    let syntax = |e: toml::de::Error| {
        let start = e.span().map_or(0, |span| span.start.min(text.len()));
        Error::Syntax {
            path: path.into(),
            line: 1 + text.as_bytes()[..start].iter().filter(|&&b| b == b'\n').count(),
            reason: one_line(e.message()),
        }
    };
    let document = toml::Deserializer::parse(&text).map_err(syntax)?;
    serde_path_to_error::deserialize(document).map_err(|e| {
        let key = match e.path().to_string() {
            root if root == "." => "top level".to_owned(),
            key => key,
        };
        Error::key(path, key, one_line(e.inner().message()))
    })
}

fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}
