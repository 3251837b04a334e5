//! Ctrl-C and `--resume` on the real program: it stops at once, leaves checkpoints and nothing half-written, and
//! goes on from them.
#![cfg(unix)]

#[path = "support/program.rs"]
mod program;
#[path = "support/signals.rs"]
mod signals;

use program::{SCENE, Studio};
use safetensors::SafeTensors;
use signals::{interrupt, wait_for};
use std::path::Path;
use std::time::Duration;

/// How long the sampling network is trained before the interruption, so that it comes between two checkpoints.
const TRAIN: Duration = Duration::from_secs(1);

const CHARTS: &str = "baked/vase/checkpoints/train-charts.safetensors";
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
        [CHARTS, MAPS].map(|file| std::fs::read(studio.path(file)).expect("finished stages are kept"));
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
    for (file, bytes) in [CHARTS, MAPS].iter().zip(finished) {
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

/// Steps of the training whose checkpoint is `path`, if there is one.
fn steps(path: &Path) -> Option<u64> {
    let bytes = std::fs::read(path).ok()?;
    let file = SafeTensors::deserialize(&bytes).expect("a checkpoint is whole at any time");
    let step = file.tensor("step").expect("a checkpoint counts its steps");
    Some(u64::from_le_bytes(step.data().try_into().expect("one number")))
}
