//! What `bake maps` refuses: one line that names the file or the flag and the way out, status 2, nothing changed on disk.

use crate::complaint::complains;
use crate::program::{SCENE, Studio, finish};
use crate::{FAILED, METAL, OUT, PATIENCE, PLASTIC, SHARD_SLICES, fails, maps, shards, studio, succeed};

/// Slices of the databases: one shard and a few of the next.
const COUNT: usize = SHARD_SLICES + 4;

/// A studio with a database of the metal.
fn with_maps() -> Studio {
    let studio = studio();
    succeed(maps(&studio, METAL, COUNT, &[]));
    studio
}

/// Asserts that the command line itself is refused: the parser's first line has all of `parts`, and nothing changes.
fn misread(studio: &Studio, arguments: &[&str], parts: &[&str]) {
    let before = studio.listing();
    let child = studio.bake(arguments).spawn().expect("the program starts");
    let output = finish(child, PATIENCE);
    let said = String::from_utf8(output.stderr).expect("complaints are UTF-8");
    assert_eq!(output.status.code(), Some(FAILED), "{said}");
    assert!(output.stdout.is_empty(), "{arguments:?} printed a result");
    let complaint = said.lines().next().unwrap_or_default();
    for part in parts {
        assert!(complaint.contains(part), "`{part}` is not in: {said}");
    }
    assert!(before == studio.listing(), "{arguments:?} changed something");
}

#[test]
fn maps_of_something_else() {
    let studio = with_maps();
    let count = COUNT.to_string();
    let run = |material: &str, cells: &str, more: &[&str], parts: &[&str]| {
        let arguments = [
            "maps", material, "--count", &count, "--cells", cells, "--out", OUT,
        ];
        complains(&studio, &[&arguments[..], more].concat(), parts);
    };
    run(
        METAL,
        "32",
        &[],
        &["maps: there are maps already", "--resume", "--out"],
    );
    let other = ["maps: these maps are of another", "give another --out"];
    run(PLASTIC, "32", &["--resume"], &other);
    run(METAL, "64", &["--resume"], &other);
    run(METAL, "32", &["--resume", "--seed", "2"], &other);
    run(METAL, "32", &["--resume", "--solver", "marginal"], &other);
    run(METAL, "32", &["--resume", "--set", "roughness=0.6"], &other);
}

#[test]
fn a_truncated_shard() {
    let studio = with_maps();
    let first = shards(&studio).remove("maps-0000.safetensors");
    let file = studio.path(OUT).join("maps-0001.safetensors");
    let whole = std::fs::read(&file).expect("just written");
    for length in [whole.len() / 2, 4, 0] {
        std::fs::write(&file, &whole[..length]).expect("it can be written");
        let broken = [
            "maps/maps-0001.safetensors: not a whole map shard",
            "delete it to start over",
        ];
        let count = COUNT.to_string();
        let resume = [
            "maps", METAL, "--count", &count, "--cells", "32", "--out", OUT, "--resume",
        ];
        complains(&studio, &resume, &broken);
        let view = SHARD_SLICES.to_string();
        complains(&studio, &["maps", METAL, "--out", OUT, "--view", &view], &broken);
        let now = std::fs::read(studio.path(OUT).join("maps-0000.safetensors")).ok();
        assert!(now == first, "the earlier shard changed");
    }
    // What the complaint says helps.
    std::fs::remove_file(&file).expect("it is there");
    succeed(maps(&studio, METAL, COUNT, &["--resume"]));
    assert!(shards(&studio)["maps-0001.safetensors"] == whole);
}

#[test]
fn a_shard_with_a_tensor_too_few() {
    let studio = with_maps();
    let file = studio.path(OUT).join("maps-0000.safetensors");
    let bytes = std::fs::read(&file).expect("just written");
    // Renamed in the header, which keeps its length.
    let at = bytes
        .windows(7)
        .position(|name| name == b"\"boost\"")
        .expect("there is one");
    let mut renamed = bytes;
    renamed[at + 1..at + 6].copy_from_slice(b"boast");
    std::fs::write(&file, renamed).expect("it can be written");
    let view = ["maps", METAL, "--out", OUT, "--view", "0"];
    complains(
        &studio,
        &view,
        &["maps/maps-0000.safetensors", "`boost`", "delete it"],
    );
}

#[test]
fn unknown_materials_solvers_and_sizes() {
    let studio = studio();
    complains(
        &studio,
        &["maps", "mettle"],
        &["mettle: there is no such material", "scenes/materials"],
    );
    complains(&studio, &["maps", "mettle.toml"], &["mettle.toml: No such file"]);
    complains(
        &studio,
        &["maps", METAL, "--set", "gloss=1"],
        &["`gloss`", "expected one of"],
    );
    complains(
        &studio,
        &["maps", METAL, "--set", "roughness=2"],
        &["`roughness`", "must lie in 0..1"],
    );
    misread(
        &studio,
        &["maps", METAL, "--solver", "newton"],
        &[
            "newton",
            "--solver",
            "marginal, hierarchical, sinkhorn_sliced, exact, frame",
        ],
    );
    for cells in ["48", "16", "512", "many"] {
        let parts = [cells, "--cells", "give 32, 64, 128 or 256"];
        misread(&studio, &["maps", METAL, "--cells", cells], &parts);
    }
    misread(&studio, &["maps", METAL, "--count", "0"], &["--count"]);
    complains(
        &studio,
        &["maps", METAL, "--solver", "marginal,frame"],
        &["--solver", "one solver", "--compare"],
    );
    complains(
        &studio,
        &["maps", METAL, "--cells", "32,64"],
        &["--cells", "one size", "--compare"],
    );
}

#[test]
fn an_exact_assignment_of_too_many_points() {
    let studio = studio();
    let parts = ["--solver exact", "128 × 128 points", "--cells 64"];
    let exact = ["maps", METAL, "--solver", "exact", "--cells", "128"];
    complains(&studio, &exact, &parts);
    complains(&studio, &[&exact[..], &["--compare"]].concat(), &parts);
}

#[test]
fn views_of_what_is_not_there() {
    let studio = with_maps();
    let view = |out: &str, index: &str, parts: &[&str]| {
        complains(&studio, &["maps", METAL, "--out", out, "--view", index], parts);
    };
    for index in [COUNT.to_string(), "4096".into()] {
        view(OUT, &index, &["maps: there is no entry", &index]);
    }
    view("nothing", "0", &["nothing: there are no maps", "without --view"]);
    view(SCENE, "0", &["vase: there are no maps", "without --view"]);
}

#[test]
fn a_folder_that_cannot_be_written() {
    let studio = studio();
    let hint = "cannot write there; choose another folder with --out";
    complains(&studio, &["maps", METAL, "--out", METAL], &[METAL, hint]);
}

#[test]
fn a_material_that_reflects_nothing() {
    let studio = studio();
    let black = [
        "--set",
        "base_color=[0,0,0]",
        "--set",
        "specular=0",
        "--set",
        "metallic=0",
    ];
    fails(
        maps(&studio, METAL, 4, &black),
        &[
            "slice at θ = ",
            "it reflects nothing, so there is nothing to sample",
        ],
    );
    assert!(shards(&studio).is_empty());
    let compare = ["maps", METAL, "--compare", "--cells", "32", "--out", OUT];
    fails(
        studio.bake(&[&compare[..], &black].concat()),
        &["slice at θ = ", "it reflects nothing"],
    );
}
