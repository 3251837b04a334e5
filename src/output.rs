//! Standard output and standard error: results on the one, everything for people watching on the other.

use anyhow::Context;
use serde::Serialize;
use std::io::{ErrorKind, Write};

/// Prints one JSON object, the only thing a command with `--json` writes to standard output.
#[expect(clippy::print_stdout, reason = "this is the program's output")]
pub fn json(value: &impl Serialize) -> anyhow::Result<()> {
    println!("{}", serde_json::to_string_pretty(value)?);
    Ok(())
}

/// Prints a line of a result.
#[expect(clippy::print_stdout, reason = "this is the program's output")]
pub fn line(text: &str) {
    println!("{text}");
}

/// Prints `text` at once; false when nobody reads it any more, which is no failure.
pub fn stream(text: &str) -> anyhow::Result<bool> {
    let mut output = std::io::stdout().lock();
    match output.write_all(text.as_bytes()).and_then(|()| output.flush()) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
        Err(error) => Err(error).context("standard output"),
    }
}

/// Says what went wrong.
pub fn complain(text: &str) {
    eprintln!("bake: {text}");
}

/// Says something that does not stop the work.
pub fn warn(text: &str) {
    eprintln!("bake: warning: {text}");
}
