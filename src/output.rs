//! Standard output and standard error: results on the one, everything for people watching on the other.

use serde::Serialize;

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

/// Says what went wrong.
pub fn complain(text: &str) {
    eprintln!("bake: {text}");
}

/// Says something that does not stop the work.
pub fn warn(text: &str) {
    eprintln!("bake: warning: {text}");
}
