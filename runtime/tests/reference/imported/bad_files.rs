//! Every file that must be refused, with the message that it gets: one line that names tensor, element and value.

use super::{File, Grid, PATH, circle};
use bake_runtime::Error;
use bake_runtime::imported::ImportedTable;
use safetensors::tensor::Dtype;
use std::path::Path;

/// 2 × 2 values of parameters, 2 θ, 3 φ, slices of 4 × 5 pixels.
fn good() -> File {
    let grid = Grid {
        params: vec![vec![0.25, 0.5], vec![1.0, 2.0]],
        theta: vec![0.0, 45.0],
        phi: circle(3),
        height: 4,
        width: 5,
    };
    let mut file = File::of(&grid, |_| [0.3, 0.2, 0.1]);
    let names = r#"["rough", "ior"]"#.into();
    file.metadata.insert("param_names".into(), names);
    file
}

/// Asserts that `bytes` are refused with one line that holds all of `parts`.
fn refused_bytes(bytes: &[u8], parts: &[&str]) {
    let error = match ImportedTable::from_bytes(bytes, Path::new(PATH)) {
        Err(error @ Error::Import { .. }) => error.to_string(),
        other => panic!("expected {parts:?}, but got {other:?}"),
    };
    assert_eq!(error.lines().count(), 1, "{error}");
    for part in parts.iter().chain(&[PATH, "write_slices"]) {
        assert!(error.contains(part), "`{part}` is not in: {error}");
    }
}

/// Asserts that [`good`] is refused once `spoil` has been at it.
fn refused(spoil: impl Fn(&mut File), parts: &[&str]) {
    let mut file = good();
    spoil(&mut file);
    refused_bytes(&file.bytes(), parts);
}

#[test]
fn the_unspoiled_file_is_read() {
    let table = good().read().expect("a table");
    assert_eq!(table.param_names(), ["rough", "ior"]);
    assert_eq!(table.ranges(), [[0.25, 0.5], [1.0, 2.0]]);
    assert_eq!(table.theta(), [0.0, 45.0]);
    assert_eq!(table.phi(), [0.0, 120.0, 240.0]);
    assert_eq!((table.resolution(), table.len()), ([4, 5], 24));
    assert!(!table.is_empty());
    assert_eq!(table.description(), None);
}

#[test]
fn files_that_are_no_safetensors() {
    let bytes = good().bytes();
    let parts = ["not a whole safetensors file"];
    for end in (0..bytes.len()).step_by(7) {
        refused_bytes(&bytes[..end], &parts);
    }
    refused_bytes(b"# not a table, but a text of some length\n", &parts);
    refused_bytes(&[&bytes[..], &[0]].concat(), &parts);
    refused_bytes(&[0; 64], &parts);
}

#[test]
fn headers_that_lie() {
    let bytes = |header: &str, data: usize| {
        let length = (header.len() as u64).to_le_bytes();
        [&length[..], header.as_bytes(), &vec![0; data]].concat()
    };
    let header = |shape: &str, end: usize| {
        format!(r#"{{"f_cos":{{"dtype":"F32","shape":{shape},"data_offsets":[0,{end}]}}}}"#)
    };
    let parts = ["not a whole safetensors file"];
    refused_bytes(&bytes(&header("[1000000000000,64,64,3]", 48), 48), &parts);
    refused_bytes(&bytes(&header("[4294967296,4294967296,64,3]", 48), 48), &parts);
    refused_bytes(&bytes(&header("[1,2,2,3]", 4096), 48), &parts);
    refused_bytes(&u64::MAX.to_le_bytes(), &parts);
    // Shapes that claim much and hold nothing agree with the file's length.
    for shape in [
        [1 << 60, 0, 8, 3],
        [1 << 30, 1 << 30, 0, 3],
        [0, 4, 5, 3],
        [1, 4, 5, 0],
    ] {
        refused(
            |file| file.set("f_cos", &shape, &[]),
            &["`f_cos`", &format!("{shape:?}"), "[N, H, W, 3]"],
        );
    }
    refused(
        |file| file.set("params", &[1 << 60, 0], &[]),
        &["`params`", "rows, but `f_cos` has 24"],
    );
}

#[test]
fn metadata() {
    refused(
        |file| file.metadata.clear(),
        &["no `bake.import`", "another kind"],
    );
    refused(
        |file| drop(file.metadata.insert("bake.import".into(), "2".into())),
        &["format version is \"2\"", "reads \"1\""],
    );
    let names = |names: &'static str, parts: &[&str]| {
        let insert = |file: &mut File| drop(file.metadata.insert("param_names".into(), names.into()));
        refused(insert, parts);
    };
    names("rough", &["`param_names`", "not a JSON list of strings"]);
    names("[1, 2]", &["`param_names`", "not a JSON list of strings"]);
    names(
        r#"["rough"]"#,
        &["`param_names` has 1 names", "`params` has 2 columns"],
    );
    names(r#"["a", "a"]"#, &["`param_names` has \"a\" at 1", "distinct"]);
    names(r#"["a", ""]"#, &["`param_names` has \"\" at 1", "not empty"]);
    names(
        r#"["a\nb", "c"]"#,
        &["`param_names` has \"a\\nb\" at 0", "one line"],
    );
}

#[test]
fn tensors_of_the_wrong_kind_or_shape() {
    for (name, layout) in [("params", "[N, P]"), ("wo", "[N, 2]"), ("f_cos", "[N, H, W, 3]")] {
        let tensor = format!("tensor `{name}`");
        refused(
            |file| drop(file.tensors.remove(name)),
            &[&tensor, layout, "missing"],
        );
        refused(|file| file.set(name, &[3], &[0.0; 3]), &[&tensor, "[3]", layout]);
        let halves = |file: &mut File| {
            let (dtype, shape, bytes) = file.tensors.get_mut(name).expect("it is there");
            *dtype = Dtype::F16;
            bytes.truncate(2 * shape.iter().product::<usize>());
        };
        refused(halves, &[&tensor, "F16", "must be F32"]);
    }
    refused(
        |file| file.set("wo", &[24, 3], &[0.0; 72]),
        &["`wo` is [24, 3]", "[24, 2]"],
    );
    refused(
        |file| file.set("wo", &[23, 2], &[0.0; 46]),
        &["`wo` is [23, 2]", "24 rows"],
    );
    refused(
        |file| file.set("params", &[25, 2], &[0.0; 50]),
        &["`params` has 25 rows", "`f_cos` has 24"],
    );
    refused(
        |file| file.set("f_cos", &[24, 4, 5, 1], &[0.0; 480]),
        &["`f_cos` is [24, 4, 5, 1]", "[N, H, W, 3]"],
    );
    refused(
        |file| file.set("f_cos", &[12, 8, 5, 3], &[0.0; 1440]),
        &["`wo` is [24, 2]", "`f_cos` has 12 rows"],
    );
}

#[test]
fn numbers_that_no_bsdf_has() {
    for (bad, shown) in [
        (-0.5, "-0.5"),
        (f32::NAN, "NaN"),
        (f32::INFINITY, "inf"),
        (f32::NEG_INFINITY, "-inf"),
        (1e21, "1000000000000000000000"),
    ] {
        refused(
            |file| file.put("f_cos", &[17, 2, 3, 1], bad),
            &[&format!("f_cos[17, 2, 3, 1] is {shown}"), "0..1e20"],
        );
        // The corner lies outside the disk.
        let mut file = good();
        file.put("f_cos", &[17, 0, 4, 1], bad);
        assert_eq!(file.read().expect("ignored"), good().read().expect("a table"));
    }
    for (bad, shown) in [(f32::NAN, "NaN"), (f32::INFINITY, "inf")] {
        refused(
            |file| file.put("params", &[5, 1], bad),
            &[&format!("params[5, 1] is {shown}"), "finite"],
        );
        refused(
            |file| file.put("wo", &[6, 1], bad),
            &[&format!("wo[6, 1] is {shown}"), "phi", "finite"],
        );
    }
    for (bad, shown) in [(90.0, "90"), (-0.1, "-0.1"), (120.0, "120"), (f32::NAN, "NaN")] {
        refused(
            |file| file.put("wo", &[7, 0], bad),
            &[&format!("wo[7, 0] is {shown}"), "theta must lie in 0..90"],
        );
    }
}

#[test]
fn grids_with_holes_or_repetitions() {
    // Row 23, the last, is (0.5, 2, 45, 240): each change leaves a hole where it was.
    refused(
        |file| file.put("wo", &[23, 1], 250.0),
        &[
            "no row has rough = 0.25, ior = 1, theta = 0, phi = 250",
            "2 × 2 × 2 × 4",
        ],
    );
    refused(
        |file| file.put("params", &[23, 0], 0.75),
        &[
            "no row has rough = 0.5, ior = 2, theta = 45, phi = 240",
            "3 × 2 × 2 × 3",
        ],
    );
    refused(
        |file| file.put("wo", &[23, 1], 120.0),
        &["rows 22 and 23 are both for rough = 0.5, ior = 2, theta = 45, phi = 120"],
    );
    refused(
        |file| file.put("wo", &[0, 1], 480.0),
        &["rows 0 and 1 are both for rough = 0.25, ior = 1, theta = 0, phi = 120"],
    );
    // The last combination is missing, and nothing else is wrong.
    let shorter = |file: &mut File| {
        for (_, shape, bytes) in file.tensors.values_mut() {
            bytes.truncate(bytes.len() / shape[0] * 23);
            shape[0] = 23;
        }
    };
    refused(
        shorter,
        &[
            "no row has rough = 0.5, ior = 2, theta = 45, phi = 240",
            "2 × 2 × 2 × 3",
        ],
    );
    // As many distinct values as rows on each of twenty axes: their product does not fit any integer.
    let many = |file: &mut File| {
        let params: Vec<f32> = (0..24 * 20).map(|i| i as f32).collect();
        file.set("params", &[24, 20], &params);
        file.metadata.remove("param_names");
    };
    refused(many, &["no row has p0 = 0, p1 = 1, ", "24 × 24 × "]);
}

#[test]
fn azimuths_that_leave_a_gap() {
    let grid = |phi: &[f32]| Grid {
        theta: vec![0.0],
        phi: phi.to_vec(),
        height: 2,
        width: 2,
        ..Grid::default()
    };
    for (phi, gap) in [
        (&[0.0, 45.0, 90.0][..], "from 90 to 360"),
        (&[0.0, 60.0, 120.0, 180.0], "from 180 to 360"),
        (&[-90.0, 0.0, 90.0], "from 90 to 270"),
        (&[10.0, 190.0], "from 190 to 370"),
    ] {
        let file = File::of(&grid(phi), |_| [0.1; 3]);
        refused_bytes(
            &file.bytes(),
            &["azimuths of `wo` leave a gap", gap, "round the circle"],
        );
    }
    for phi in [
        &[0.0, 120.0, 240.0][..],
        &[0.1, 120.1, 240.1],
        &[-60.0, 60.0, 180.0],
        &[33.0],
    ] {
        assert!(File::of(&grid(phi), |_| [0.1; 3]).read().is_ok(), "{phi:?}");
    }
}
