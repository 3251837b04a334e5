//! Pictures that no map can be made of, or only just: a clear error for each, or numbers that are finite.

use crate::complaint::complains;
use crate::program::Studio;
use crate::{json, run};
use bake_scenes::exr_file::write_rgb;
use bake_scenes::picture::write_codes;
use std::collections::BTreeMap;

/// Pixels per side of the pictures.
const SIDE: usize = 16;
/// Binning L1 of maps onto a dot: 2 where no sample hits it, and 0.81 where the marginal map of 32² cells stands in.
const DOT_L1_MAX: f64 = 1.0;
/// Texel that spoils a picture: column 5 of row 3.
const SPOILED: usize = 3 * SIDE + 5;
/// What all maps here are made with: small, and by all solvers but the exact one, whose points the others share.
const QUICK: [&str; 6] = [
    "--compare",
    "--cells",
    "32",
    "--solver",
    "marginal,hierarchical,sinkhorn_sliced,frame",
    "--json",
];

/// Writes an even grey picture in which one texel has `value`.
fn exr(studio: &Studio, name: &str, value: f32) {
    let mut texels = vec![[0.5; 3]; SIDE * SIDE];
    texels[SPOILED] = [value; 3];
    write_rgb(&studio.path(name), [SIDE; 2], &texels, &BTreeMap::new()).expect("it can be written");
}

/// A dot smaller than any cell of a map, and between the centres of cells.
#[test]
fn a_dot_that_cells_do_not_see() {
    const FINE: usize = 256;
    let studio = Studio::new();
    let mut codes = vec![0; 3 * FINE * FINE];
    let dot = 3 * (30 * FINE + 50);
    codes[dot..dot + 3].fill(255);
    write_codes(&studio.path("dot.png"), [FINE; 2], &codes).expect("it can be written");
    let arguments = [
        "maps",
        "dot.png",
        "--compare",
        "--cells",
        "32",
        "--solver",
        "marginal,frame",
        "--json",
    ];
    let rows = json(studio.bake(&arguments));
    assert!(rows[0]["binning_l1"].as_f64() < Some(DOT_L1_MAX), "{rows}");
    assert_eq!(rows[1]["fallback"], "marginal", "{rows}");
}

/// Writes a black picture in which one pixel has the sRGB code `code`.
fn png(studio: &Studio, name: &str, code: u8) {
    let mut codes = vec![0; 3 * SIDE * SIDE];
    codes[3 * SPOILED..3 * SPOILED + 3].fill(code);
    write_codes(&studio.path(name), [SIDE; 2], &codes).expect("it can be written");
}

fn refused(studio: &Studio, name: &str, parts: &[&str]) {
    let arguments = [&["maps", name][..], &QUICK].concat();
    complains(studio, &arguments, &[&[name][..], parts].concat());
}

#[test]
fn pictures_that_are_no_densities() {
    let studio = Studio::new();
    png(&studio, "black.png", 0);
    refused(&studio, "black.png", &["zero everywhere", "nothing to sample"]);
    for (name, value, found) in [
        ("nan.exr", f32::NAN, "NaN"),
        ("endless.exr", f32::INFINITY, "inf"),
        ("negative.exr", -1.0, "-1"),
    ] {
        exr(&studio, name, value);
        refused(&studio, name, &["texel (5, 3)", found]);
    }
}

#[test]
fn files_that_are_no_pictures() {
    let studio = Studio::new();
    refused(&studio, "missing.png", &["No such file"]);
    std::fs::write(studio.path("text.png"), "width 3").expect("it can be written");
    refused(&studio, "text.png", &["neither PNG, JPEG nor OpenEXR"]);
    std::fs::create_dir(studio.path("folder.png")).expect("it can be made");
    refused(&studio, "folder.png", &["directory"]);
    refused(&studio, "missing.gif", &["there is no such material"]);
}

/// All mass in one pixel: every solver makes a map of it, or says what stands in.
#[test]
fn a_picture_with_a_single_pixel() {
    let studio = Studio::new();
    png(&studio, "dot.png", 255);
    let rows = json(studio.bake(&[&["maps", "dot.png"][..], &QUICK].concat()));
    let rows = rows.as_array().expect("a list of rows");
    assert_eq!(rows.len(), 4);
    for row in rows {
        let solver = &row["solver"];
        for (key, value) in row.as_object().expect("a row is an object") {
            match key.as_str() {
                "slice" => assert_eq!(value, "dot"),
                "solver" => assert!(value.is_string()),
                "fallback" => assert!(value.is_null() || value == "marginal", "{row}"),
                _ => assert!(
                    value.as_f64().is_some_and(f64::is_finite),
                    "{solver}: {key} in {row}"
                ),
            }
        }
        assert!(row["binning_l1"].as_f64() < Some(DOT_L1_MAX), "{row}");
    }
}

#[test]
fn a_dark_picture_is_as_good_as_a_bright_one() {
    let studio = Studio::new();
    png(&studio, "dark.png", 1);
    let output = run(studio.bake(&[
        "maps",
        "dark.png",
        "--compare",
        "--cells",
        "32",
        "--solver",
        "frame",
    ]));
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}
