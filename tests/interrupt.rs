//! Ctrl-C and `--resume` on the real program: it stops at once, leaves checkpoints and nothing half-written, and
//! goes on from them.
#![cfg(unix)]

#[path = "support/program.rs"]
mod program;

use program::{SCENE, Studio, finish};
use safetensors::SafeTensors;
use std::path::Path;
use std::process::{Child, Command};
use std::time::{Duration, Instant};

/// Exit status after Ctrl-C, as shells have it.
const INTERRUPTED: i32 = 130;
/// A step, a slice and a pass over a tile take a fraction of a second; the rest is for a busy machine.
const STOP_MAX: Duration = Duration::from_secs(5);
/// Frames and maps of a quick bake, and the first 500 steps, take about ten seconds each; as above.
const STAGE_MAX: Duration = Duration::from_secs(120);
/// How long the sampling network is trained before the interruption, so that it comes between two checkpoints.
const TRAIN: Duration = Duration::from_secs(1);
/// How often a condition is looked at.
const POLL: Duration = Duration::from_millis(20);

const FRAME: &str = "baked/vase/checkpoints/train-frame.safetensors";
const MAPS: &str = "baked/vase/checkpoints/maps-0000.safetensors";
const SAMPLE: &str = "baked/vase/checkpoints/train-sample.safetensors";
const BAKE: [&str; 5] = ["scene", SCENE, "--quick", "--out", "baked"];

#[test]
fn an_interrupted_bake_stops_at_once_and_goes_on_where_it_was() {
    let studio = Studio::new();
    let mut child = studio.bake(&BAKE).spawn().expect("the program starts");
    wait_for(&mut child, || studio.path(MAPS).exists());
    std::thread::sleep(TRAIN);
    let said = interrupt(child, &studio);
    assert!(
        said.contains("importance maps") && said.ends_with("bake: interrupted: go on with --resume\n"),
        "{said}"
    );
    let finished =
        [FRAME, MAPS].map(|file| std::fs::read(studio.path(file)).expect("finished stages are kept"));
    let first = steps(&studio.path(SAMPLE)).expect("the network being trained is kept");

    let mut child = studio
        .bake(&[&BAKE[..], &["--resume"]].concat())
        .spawn()
        .expect("the program starts");
    wait_for(&mut child, || steps(&studio.path(SAMPLE)) > Some(first));
    let said = interrupt(child, &studio);
    assert!(
        !said.contains("importance maps"),
        "maps were computed again: {said}"
    );
    assert!(
        steps(&studio.path(SAMPLE)) > Some(first),
        "the training did not go on"
    );
    for (file, bytes) in [FRAME, MAPS].iter().zip(finished) {
        assert!(
            std::fs::read(studio.path(file)).is_ok_and(|now| now == bytes),
            "{file} changed"
        );
    }
}

#[test]
fn an_interrupted_render_stops_at_once_and_leaves_no_picture() {
    let studio = Studio::new();
    let render = [
        "render",
        SCENE,
        "--method",
        "cosine",
        "--spp",
        "1000000",
        "--out",
        "pictures/vase.exr",
    ];
    let mut child = studio.bake(&render).spawn().expect("the program starts");
    wait_for(&mut child, || studio.path("pictures").exists());
    std::thread::sleep(TRAIN);
    interrupt(child, &studio);
    let left: Vec<_> = studio
        .listing()
        .into_keys()
        .filter(|p| p.starts_with(studio.path("pictures/")))
        .collect();
    assert_eq!(left, [studio.path("pictures")]);
}

/// Sends Ctrl-C to `child` and asserts how it ends; what it said on standard error.
fn interrupt(child: Child, studio: &Studio) -> String {
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

/// Steps of the training whose checkpoint is `path`, if there is one.
fn steps(path: &Path) -> Option<u64> {
    let bytes = std::fs::read(path).ok()?;
    let file = SafeTensors::deserialize(&bytes).expect("a checkpoint is whole at any time");
    let step = file.tensor("step").expect("a checkpoint counts its steps");
    Some(u64::from_le_bytes(step.data().try_into().expect("one number")))
}

fn wait_for(child: &mut Child, holds: impl Fn() -> bool) {
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
