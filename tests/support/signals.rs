//! Waiting for something that a running program does, and Ctrl-C.

use crate::program::{Studio, finish};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

/// Exit status after Ctrl-C, as shells have it.
const INTERRUPTED: i32 = 130;
/// A step, a slice and a pass over a tile take a fraction of a second; the rest is for a busy machine.
const STOP_MAX: Duration = Duration::from_secs(5);
/// Frames and maps of a quick bake, and the first 500 steps, take about ten seconds each; as above.
const STAGE_MAX: Duration = Duration::from_secs(120);
/// How often a condition is looked at.
const POLL: Duration = Duration::from_millis(20);

/// Sends Ctrl-C to `child` and asserts how it ends; what it said on standard error.
pub fn interrupt(child: Child, studio: &Studio) -> String {
    let sent = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status();
    assert!(
        sent.is_ok_and(|status| status.success()),
        "kill is part of every Unix"
    );
    let output = finish(child, STOP_MAX);
    let said = String::from_utf8(output.stderr).expect("the program speaks UTF-8");
    assert_eq!(output.status.code(), Some(INTERRUPTED), "{said}");
    assert!(output.stdout.is_empty(), "an interrupted program has no result");
    let temporary = studio
        .listing()
        .into_keys()
        .find(|path| path.extension().is_some_and(|e| e == "tmp"));
    assert_eq!(temporary, None);
    said
}

/// Waits until `holds`; the test fails when `child` ends before.
pub fn wait_for(child: &mut Child, holds: impl Fn() -> bool) {
    let deadline = Instant::now() + STAGE_MAX;
    while !holds() {
        let ended = child.try_wait().expect("the child is ours");
        assert!(ended.is_none(), "the program ended by itself: {ended:?}");
        if Instant::now() > deadline {
            child.kill().expect("the child is ours");
            panic!("nothing happened within {STAGE_MAX:?}");
        }
        std::thread::sleep(POLL);
    }
}
