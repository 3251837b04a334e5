//! Hard and forbidden directions, parameters at and beyond their ranges, black slices, damaged files, determinism.

use super::{At, File, Grid, PATH, bound, circle, direction, eval, lobe, spaced};
use bake_runtime::imported::{Imported, ImportedTable};
use bake_runtime::{Bsdf, Error, Rng};
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;

/// Largest uniform number.
const LAST_UNIFORM: f64 = 1.0 - f64::EPSILON / 2.0;

/// Round-off of a unit vector.
const UNIT_TOL: f64 = 1e-12;

fn isotropic() -> Grid {
    Grid {
        theta: spaced(88.0, 12),
        phi: vec![0.0],
        height: 16,
        width: 16,
        ..Grid::default()
    }
}

/// Smooth, black in one slice, one lit pixel on the horizon, one pixel alone, anisotropic.
fn tables() -> Vec<Imported> {
    let anisotropic = Grid {
        phi: circle(7),
        ..isotropic()
    };
    let one = Grid {
        theta: vec![30.0],
        height: 1,
        width: 1,
        ..isotropic()
    };
    let half_black = |at: &At| {
        if at.theta > 40.0 {
            [0.0; 3]
        } else {
            [0.5, 0.2, 0.0]
        }
    };
    let spike = |at: &At| {
        if at.wi.z < 0.2 && at.wi.x > 0.9 {
            [1e15; 3]
        } else {
            [0.0; 3]
        }
    };
    vec![
        bound(&isotropic(), &[], |at| lobe(0.2, at)),
        bound(&isotropic(), &[], half_black),
        bound(&anisotropic, &[], spike),
        bound(&one, &[], |_| [1e-30, 0.0, 0.0]),
        bound(&anisotropic, &[], |at| lobe(0.1, at)),
    ]
}

#[test]
fn hard_directions_stay_finite_and_non_negative() {
    let thetas = [0.0, 1e-7, 0.01, 44.0, 45.0, 89.0, 89.9, 89.99];
    let directions: Vec<DVec3> = thetas
        .iter()
        .flat_map(|&t| [0.0, 90.0, 180.0, 233.0, 359.999_999].map(|p| direction(t, p)))
        .collect();
    for (k, bsdf) in tables().iter().enumerate() {
        for &wo in &directions {
            for &wi in &directions {
                let (f, pdf) = (eval(bsdf, wo, wi), bsdf.pdf(wo, wi));
                let what = format!("table {k}, {wo} to {wi}: {f}, pdf {pdf}");
                assert!(f.is_finite() && f.min_element() >= 0.0, "{what}");
                assert!(pdf.is_finite() && pdf > 0.0, "{what}");
            }
            for u in [
                [0.0; 2],
                [0.0, LAST_UNIFORM],
                [LAST_UNIFORM, 0.5],
                [LAST_UNIFORM; 2],
                [0.5; 2],
            ] {
                let what = format!("table {k}, {wo}, u {u:?}");
                let wi = bsdf.propose(wo, u).expect("wo is above the horizon");
                assert!(wi.z > 0.0 && (wi.length() - 1.0).abs() < UNIT_TOL, "{wi}: {what}");
                if let Some(s) = bsdf.sample(wo, u, &mut Rng::new(&[])) {
                    assert_eq!(s.wi, wi, "{what}");
                    let weight = s.weight;
                    assert!(
                        weight.is_finite() && weight.min_element() >= 0.0,
                        "{weight}: {what}"
                    );
                    assert!(weight.max_element() > 0.0, "{what}");
                }
            }
        }
    }
}

#[test]
fn directions_below_the_horizon_or_not_finite_or_not_unit_give_nothing() {
    let above = direction(30.0, 10.0);
    for bsdf in tables() {
        for bad in [
            -above,
            DVec3::X,
            DVec3::ZERO,
            above * 1.01,
            above * 0.5,
            above.with_x(f64::NAN),
            above.with_z(f64::NAN),
            above.with_z(f64::INFINITY),
        ] {
            for (wo, wi) in [(above, bad), (bad, above), (bad, bad)] {
                assert_eq!(eval(&bsdf, wo, wi), DVec3::ZERO, "{wo} to {wi}");
                assert_eq!(bsdf.pdf(wo, wi), 0.0, "{wo} to {wi}");
            }
            assert_eq!(bsdf.sample(bad, [0.5, 0.5], &mut Rng::new(&[])), None);
            assert_eq!(bsdf.propose(bad, [0.5, 0.5]), None);
            assert_eq!(bsdf.slice(bad, 1, 1).eval(above), DVec3::ZERO);
        }
    }
}

#[test]
fn a_black_table_is_legal_and_scatters_nothing() {
    let bsdf = bound(&isotropic(), &[], |_| [0.0; 3]);
    let wo = direction(33.0, 20.0);
    let mut rng = Rng::new(&[1]);
    for _ in 0..100 {
        let wi = bsdf.propose(wo, rng.pair()).expect("wo is above the horizon");
        assert_eq!(eval(&bsdf, wo, wi), DVec3::ZERO);
        assert!(bsdf.pdf(wo, wi) > 0.0);
        assert_eq!(bsdf.sample(wo, rng.pair(), &mut Rng::new(&[])), None);
    }
    assert_eq!(bsdf.albedo(wo, 64, 1).mean, DVec3::ZERO);
}

#[test]
fn parameters_are_checked_against_the_range_of_the_table() {
    let grid = Grid {
        params: vec![vec![0.1, 0.8], vec![1.5]],
        theta: vec![0.0],
        phi: vec![0.0],
        height: 2,
        width: 2,
    };
    let mut file = File::of(&grid, |at| [at.params[0]; 3]);
    let names = r#"["roughness", "ior"]"#.into();
    file.metadata.insert("param_names".into(), names);
    let table = file.table();
    // 0.1 and 0.8 are no single-precision numbers, but the decimals that the file means.
    assert_eq!(table.ranges(), [[0.1, 0.8], [1.5, 1.5]]);
    for good in [[0.1, 1.5], [0.8, 1.5], [0.3, 1.5], [0.1f32.into(), 1.5]] {
        assert!(table.bind(&good).is_ok(), "{good:?}");
    }
    let refused = |params: &[f64]| match table.bind(params) {
        Err(error @ Error::Parameter { .. }) => error.to_string(),
        other => panic!("{params:?} gave {other:?}"),
    };
    for (bad, shown) in [
        (0.09, "0.09"),
        (0.81, "0.81"),
        (f64::NAN, "NaN"),
        (f64::INFINITY, "inf"),
    ] {
        let message = refused(&[bad, 1.5]);
        for part in ["`roughness`", &format!("is {shown}"), "0.1..0.8"] {
            assert!(message.contains(part), "{message}");
        }
        assert!(refused(&[0.5, bad]).contains("`ior`"));
    }
    for wrong in [&[][..], &[0.5], &[0.5, 1.5, 1.0]] {
        let message = refused(wrong);
        let found = format!("{} numbers", wrong.len());
        assert!(
            message.contains(&found) && message.contains("[roughness, ior]"),
            "{message}"
        );
    }
}

#[test]
fn names_are_made_up_where_the_file_has_none() {
    let grid = Grid {
        params: vec![vec![1.0], vec![2.0]],
        theta: vec![0.0],
        phi: vec![0.0],
        height: 1,
        width: 1,
    };
    let mut file = File::of(&grid, |_| [0.1; 3]);
    assert_eq!(file.table().param_names(), ["p0", "p1"]);
    file.metadata.insert("description".into(), "a grey patch".into());
    assert_eq!(file.table().description(), Some("a grey patch"));
}

#[test]
fn a_file_that_is_not_there_is_an_error_that_names_it() {
    match ImportedTable::load(Path::new(PATH)) {
        Err(error @ Error::Io { .. }) => assert!(error.to_string().contains(PATH), "{error}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn load_reads_what_from_bytes_reads() {
    let file = File::of(&isotropic(), |at| lobe(0.3, at));
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let path = folder.path().join("table.safetensors");
    std::fs::write(&path, file.bytes()).expect("a temporary folder can be written");
    assert!(ImportedTable::load(&path).expect("a table") == file.read().expect("a table"));
}

/// Whatever a bit flips to, the file is refused or read, and what is read answers with numbers.
#[test]
fn damaged_files_never_panic() {
    let grid = Grid {
        params: vec![vec![0.0, 1.0]],
        theta: vec![0.0, 60.0],
        phi: circle(3),
        height: 3,
        width: 3,
    };
    let bytes = File::of(&grid, |at| lobe(0.5, at)).bytes();
    let mut rng = Rng::new(&[2]);
    let (mut read, mut refused) = (0, 0);
    for _ in 0..20_000 {
        let mut damaged = bytes.clone();
        for _ in 0..1 + rng.bits() % 3 {
            let at = rng.bits() as usize % damaged.len();
            damaged[at] ^= 1 << (rng.bits() % 8);
        }
        let Ok(table) = ImportedTable::from_bytes(&damaged, Path::new(PATH)) else {
            refused += 1;
            continue;
        };
        read += 1;
        let table = Arc::new(table);
        let middle: Vec<f64> = table.ranges().iter().map(|r| 0.5 * r[0] + 0.5 * r[1]).collect();
        let Ok(bsdf) = table.bind(&middle) else { continue };
        let wo = direction(80.0 * rng.uniform(), 360.0 * rng.uniform());
        let wi = bsdf.propose(wo, rng.pair()).expect("wo is above the horizon");
        let f = eval(&bsdf, wo, wi);
        assert!(f.is_finite() && f.min_element() >= 0.0, "{f}");
        assert!(bsdf.pdf(wo, wi) > 0.0);
    }
    assert!(read > 0 && refused > 0, "{read} read, {refused} refused");
}

#[test]
fn the_model_is_deterministic_and_slices_agree_with_eval() {
    for bsdf in tables() {
        assert!(!bsdf.is_stochastic());
        let mut rng = Rng::new(&[3]);
        let before = rng.clone().bits();
        let (wo, wi) = (direction(50.0, 100.0), direction(40.0, 290.0));
        let f = bsdf.eval(wo, wi, &mut rng);
        let sample = bsdf.sample(wo, [0.3, 0.6], &mut rng);
        assert_eq!(rng.bits(), before, "no random number was drawn");
        assert_eq!(bsdf.eval(wo, wi, &mut rng), f);
        assert_eq!(bsdf.clone().sample(wo, [0.3, 0.6], &mut rng), sample);
        assert_eq!(bsdf.slice(wo, 16, 7).eval(wi), f);
    }
}
