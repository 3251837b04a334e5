//! The parameters of every family as the help of a command lists them, from the tables that files are read by.

use bake_runtime::Family;

/// Width of help that a terminal of ordinary width holds.
const WIDTH: usize = 100;
/// Where the second column begins.
const COLUMN: usize = 18;

/// All families with their parameters, ranges, defaults and meaning.
pub fn families() -> String {
    let mut text =
        String::from("Families and their parameters (colours are linear RGB; all without unit):\n");
    for family in Family::ALL {
        text.push_str(&format!(
            "\n{}\n",
            wrapped(&format!("{}: {}", family.name(), family.doc()), 0)
        ));
        for parameter in family.parameters() {
            let described = format!("{}: {}", parameter.domain(), parameter.doc);
            let described = wrapped(&described, COLUMN);
            let name = format!("  {}", parameter.name);
            text.push_str(&format!("{name:<COLUMN$}{}\n", described.trim_start()));
        }
    }
    text
}

/// `text` in lines of at most [`WIDTH`], each after `indent` spaces.
fn wrapped(text: &str, indent: usize) -> String {
    let margin = " ".repeat(indent);
    let mut lines = vec![margin.clone()];
    for word in text.split_whitespace() {
        let line = lines.last_mut().map_or(0, |line| line.chars().count());
        if line > indent && line + 1 + word.chars().count() > WIDTH {
            lines.push(margin.clone());
        }
        if let Some(line) = lines.last_mut() {
            if line.len() > indent {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines.join("\n")
}
