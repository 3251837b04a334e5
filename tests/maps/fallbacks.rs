//! Slices that Newton's method cannot follow: marginal maps stand in, the run says so and ends with an error, and goes on
//! when told to.

use crate::files::assert_same;
use crate::slices_file::SlicesFile;
use crate::{FAILED, OUT, json, maps, run, shards, studio};

/// Slices of the database.
const COUNT: usize = 4;
/// Pixels per side of the slices, and the distances of the dots that they are: far smaller than a cell of a map.
const SIDE: usize = 128;
const DOTS: [usize; 2] = [9, 7];

#[test]
fn maps_of_dots_fall_back_and_say_so() {
    let studio = studio();
    let pixel = |v: f64| (0.5 * (v + 1.0) * SIDE as f64) as usize;
    let dots = |_: [f64; 2], [x, y, _]: [f64; 3]| {
        let lit = pixel(x).is_multiple_of(DOTS[0]) && pixel(y).is_multiple_of(DOTS[1]);
        [if lit { 1.0 } else { 0.0 }; 3]
    };
    SlicesFile::isotropic("size", &[0.0], &[0.0, 89.0], SIDE, dots).write(&studio.path("dots.safetensors"));
    let text = "family = \"imported\"\nfile = \"dots.safetensors\"\nsize = 0.0\n";
    std::fs::write(studio.path("dots.toml"), text).expect("it can be written");
    let output = run(maps(&studio, "dots.toml", COUNT, &[]));
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(FAILED), "{said}");
    for part in [
        "100.0 % of the maps fell back",
        "more than 2 %",
        "--resume --allow-fallbacks",
    ] {
        assert!(said.contains(part), "`{part}` is not in: {said}");
    }
    let stored = shards(&studio);
    let report = json(maps(
        &studio,
        "dots.toml",
        COUNT,
        &["--resume", "--allow-fallbacks", "--json"],
    ));
    assert_eq!(
        (&report["computed"], &report["fallback_percent"]),
        (&0.into(), &100.0.into())
    );
    let strata = report["strata"].as_array().expect("a list");
    assert!(strata.iter().all(|s| s["fallbacks"] == s["maps"]), "{report}");
    assert_same(&stored, &shards(&studio));
    let viewed = json(studio.bake(&["maps", "dots.toml", "--out", OUT, "--view", "0", "--json"]));
    assert_eq!(viewed[0]["fallback"], true);
}
