//! A shard that cannot be written: one error, nothing half-written, and `--resume` once there is room.
//!
//! The disk is full at a limit on the size of files, which a test can set without being a superuser.

use crate::files::assert_same;
use crate::program::Studio;
use crate::{METAL, OUT, SHARD_SLICES, fails, maps, shards, studio, succeed, unfinished};
use std::process::{Command, Stdio};

/// Starts its arguments with files of at most a quarter of a mebibyte, a twelfth of a shard; writes beyond it fail, as
/// the signal that comes with them is ignored.
const LIMITED: &str = "trap '' XFSZ; ulimit -f 256; exec \"$0\" \"$@\"";
/// Slices of the second shard.
const MORE: usize = 20;

fn limited(studio: &Studio, command: &Command) -> Command {
    let mut limited = Command::new("bash");
    limited
        .args(["-c", LIMITED])
        .arg(command.get_program())
        .args(command.get_args())
        .current_dir(studio.path("."))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    limited
}

#[test]
fn a_full_disk_leaves_earlier_shards_and_resume_completes_them() {
    let (once, full) = (studio(), studio());
    succeed(maps(&once, METAL, SHARD_SLICES + MORE, &[]));
    succeed(maps(&full, METAL, SHARD_SLICES, &[]));
    let earlier = shards(&full);
    let resume = maps(&full, METAL, SHARD_SLICES + MORE, &["--resume"]);
    fails(
        limited(&full, &resume),
        &[OUT, "maps-0001.safetensors", "File too large"],
    );
    assert_same(&earlier, &shards(&full));
    assert_eq!(unfinished(&full), [""; 0]);
    succeed(resume);
    assert_same(&shards(&once), &shards(&full));
}

#[test]
fn a_shard_that_cannot_grow_stays_as_it_was() {
    let studio = studio();
    succeed(maps(&studio, METAL, 2, &[]));
    let earlier = shards(&studio);
    let resume = maps(&studio, METAL, MORE, &["--resume"]);
    fails(
        limited(&studio, &resume),
        &["maps-0000.safetensors", "File too large"],
    );
    assert_same(&earlier, &shards(&studio));
    assert_eq!(unfinished(&studio), [""; 0]);
}
