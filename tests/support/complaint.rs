//! What every complaint of the program about bad input must be.

use crate::program::{Studio, finish};
use std::process::Command;
use std::time::Duration;

/// Exit status of bad input.
const BAD_INPUT: i32 = 2;
/// Nothing is baked or rendered before bad input is noticed; loading onnxruntime on a busy machine takes longest.
const SECONDS_MAX: Duration = Duration::from_secs(20);

/// Runs the program and asserts that it refuses its input with one line that has all of `parts`.
pub fn complains(studio: &Studio, arguments: &[&str], parts: &[&str]) {
    assert_complaint(studio, studio.bake(arguments), parts);
}

/// The same for a `command` of the caller's.
pub fn assert_complaint(studio: &Studio, mut command: Command, parts: &[&str]) {
    let before = studio.listing();
    let output = finish(command.spawn().expect("the program starts"), SECONDS_MAX);
    let complaint = String::from_utf8(output.stderr).expect("complaints are UTF-8");
    assert_eq!(output.status.code(), Some(BAD_INPUT), "{command:?}: {complaint}");
    assert!(output.stdout.is_empty(), "{command:?} printed a result");
    assert!(
        complaint.ends_with('\n') && complaint.lines().count() == 1,
        "not one line: {complaint}"
    );
    for part in parts {
        assert!(complaint.contains(part), "`{part}` is not in: {complaint}");
    }
    let reason = complaint.rsplit(": ").next().unwrap_or_default().trim_end();
    assert_eq!(complaint.matches(reason).count(), 1, "said twice: {complaint}");
    let after = studio.listing();
    let names = |listing: &std::collections::BTreeMap<_, _>| listing.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&before), names(&after), "{command:?} left something behind");
    assert!(before == after, "{command:?} changed a file");
}
