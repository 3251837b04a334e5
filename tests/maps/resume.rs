//! Databases that are killed, interrupted or grown become, byte by byte, those of one uninterrupted run.

use crate::files::{Files, assert_same};
use crate::program::Studio;
use crate::signals::{interrupt, wait_for};
use crate::{METAL, OUT, SHARD_SLICES, json, maps, shards, studio, succeed};
use std::os::unix::process::ExitStatusExt;
use std::sync::OnceLock;

/// Slices of the vase: one shard, and a second that takes long enough to be killed in.
const VASE_SLICES: usize = 200;
/// Slices of the metal: two shards and a part of a third.
const METAL_SLICES: usize = 300;
/// Number of the signal that no process can catch.
const KILL: i32 = 9;

fn vase(studio: &Studio, more: &[&str]) -> std::process::Command {
    maps(studio, "vase", VASE_SLICES, more)
}

/// Shards of the vase in one go, at two threads.
fn whole() -> &'static Files {
    static WHOLE: OnceLock<Files> = OnceLock::new();
    WHOLE.get_or_init(|| {
        let studio = Studio::new();
        succeed(vase(&studio, &["--threads", "2"]));
        shards(&studio)
    })
}

/// Kills a run once its first shard is there, and resumes it.
fn killed_and_resumed(threads: &str) {
    let studio = Studio::new();
    let mut child = vase(&studio, &["--threads", threads])
        .spawn()
        .expect("the program starts");
    let first = studio.path(OUT).join("maps-0000.safetensors");
    wait_for(&mut child, || first.exists());
    child.kill().expect("the child is ours");
    let status = child.wait().expect("the child is ours");
    assert_eq!(status.signal(), Some(KILL), "it ended before it was killed");
    let left = shards(&studio);
    assert_eq!(left.keys().collect::<Vec<_>>(), ["maps-0000.safetensors"]);
    let report = json(vase(&studio, &["--threads", threads, "--resume", "--json"]));
    assert_eq!(report["slices"], VASE_SLICES);
    assert_eq!(
        report["computed"],
        VASE_SLICES - SHARD_SLICES,
        "a finished shard was made again"
    );
    assert_same(whole(), &shards(&studio));
}

#[test]
fn a_killed_run_goes_on_to_the_same_bytes_at_one_thread() {
    killed_and_resumed("1");
}

#[test]
fn a_killed_run_goes_on_to_the_same_bytes_at_two_threads() {
    killed_and_resumed("2");
}

#[test]
fn ctrl_c_stops_at_once_and_keeps_what_is_finished() {
    let studio = Studio::new();
    let mut child = vase(&studio, &[]).spawn().expect("the program starts");
    let first = studio.path(OUT).join("maps-0000.safetensors");
    wait_for(&mut child, || first.exists());
    let said = interrupt(child, &studio);
    assert!(
        said.ends_with("bake: interrupted: go on with --resume\n"),
        "{said}"
    );
    let left = shards(&studio);
    assert_eq!(left.keys().collect::<Vec<_>>(), ["maps-0000.safetensors"]);
    assert!(left["maps-0000.safetensors"] == whole()["maps-0000.safetensors"]);
}

#[test]
fn a_grown_database_is_that_of_one_run() {
    let (once, grown) = (studio(), studio());
    succeed(maps(&once, METAL, METAL_SLICES, &[]));
    let expected = shards(&once);
    assert_eq!(expected.len(), METAL_SLICES.div_ceil(SHARD_SLICES));
    for count in [1, 200, METAL_SLICES] {
        let report = json(maps(&grown, METAL, count, &["--resume", "--json"]));
        assert_eq!(report["slices"], count);
    }
    assert_same(&expected, &shards(&grown));
    // Asking for fewer takes nothing away.
    let report = json(maps(&grown, METAL, 200, &["--resume", "--json"]));
    assert_eq!((&report["slices"], &report["computed"]), (&200.into(), &0.into()));
    assert_same(&expected, &shards(&grown));
}

#[test]
fn another_seed_gives_other_places() {
    let (one, two) = (studio(), studio());
    succeed(maps(&one, METAL, 2, &["--seed", "1"]));
    succeed(maps(&two, METAL, 2, &["--seed", "2"]));
    assert!(shards(&one) != shards(&two));
}
