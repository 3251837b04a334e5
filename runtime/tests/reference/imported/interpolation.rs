//! What a table gives between its points: analytic BSDFs that it must reproduce exactly, and smooth ones to a
//! stated error.

use super::{At, File, Grid, bound, circle, direction, eval, lobe, spaced};
use bake_runtime::Rng;
use glam::DVec3;
use std::f64::consts::FRAC_1_PI;

/// The file holds f_cos and the table f, both in single precision, and sums of a dozen of them: ten roundings.
const ROUND_OFF: f64 = 10.0 * f32::EPSILON as f64;

/// Directions over the whole hemisphere, up to the horizon.
fn directions(count: usize, key: u64) -> impl Iterator<Item = DVec3> {
    let mut rng = Rng::new(&[0x1e7, key]);
    let hard = [0.0, 1e-7, 89.0, 89.9, 89.99].map(|theta| direction(theta, 200.0));
    let drawn = move |_| direction(90.0 * rng.uniform(), 360.0 * rng.uniform());
    hard.into_iter().chain((0..count).map(drawn))
}

fn assert_close(found: DVec3, expected: DVec3, tolerance: f64, what: &str) {
    let error = (found - expected).abs().max_element();
    assert!(
        error <= tolerance,
        "{what}: {found}, expected {expected} ± {tolerance}"
    );
}

#[test]
fn lambertian_is_reproduced_up_to_the_horizon() {
    let albedo = DVec3::new(0.9, 0.5, 0.0);
    for (height, width) in [(1, 1), (9, 13), (2, 30), (32, 32)] {
        for phi in [vec![77.0], circle(5)] {
            let grid = Grid {
                params: vec![vec![-1.0, 0.5, 4.0]],
                theta: vec![0.0, 20.0, 75.0],
                phi,
                height,
                width,
            };
            let bsdf = bound(&grid, &[1.3], |_| (albedo * FRAC_1_PI).to_array());
            for (wo, wi) in directions(200, 1).zip(directions(200, 2)) {
                let expected = albedo * FRAC_1_PI * wi.z;
                let what = format!("{height} × {width}, {wo} to {wi}");
                // Relative to f_cos itself, which becomes small at the horizon.
                assert_close(eval(&bsdf, wo, wi), expected, ROUND_OFF * expected.x, &what);
            }
        }
    }
}

/// A function that is linear in every coordinate apart: any exchange of rows, columns, axes or weights shows.
#[test]
fn multilinear_functions_are_reproduced_inside_the_disk() {
    /// Further in than the outermost cells, which bilinear interpolation does not continue linearly.
    const RADIUS: f64 = 0.75;
    let f = |p: &[f64], theta: f64, x: f64, y: f64| {
        let base = (1.0 + 2.0 * p[0]) * (4.0 - p[1]) * (1.0 + theta / 50.0) * (3.0 + x) * (2.0 - y);
        [base, 2.0 * base + x, 1.0 + y * theta / 90.0]
    };
    let grid = Grid {
        params: vec![vec![0.0, 0.25, 1.0], vec![-2.0, 3.0]],
        theta: vec![0.0, 10.0, 45.0, 80.0],
        phi: circle(4),
        height: 14,
        width: 21,
    };
    let table = File::of(&grid, |at| f(at.params, at.theta, at.wi.x, at.wi.y)).table();
    let mut rng = Rng::new(&[0x1e8]);
    for _ in 0..2000 {
        let params = [rng.uniform(), -2.0 + 5.0 * rng.uniform()].map(|v| f64::from(v as f32));
        let (theta, phi) = (80.0 * rng.uniform(), 360.0 * rng.uniform());
        let wi = direction(
            (RADIUS * rng.uniform()).asin().to_degrees(),
            360.0 * rng.uniform(),
        );
        let bsdf = table.bind(&params).expect("params are in range");
        let found = eval(&bsdf, direction(theta, phi), wi);
        let expected = DVec3::from_array(f(&params, theta, wi.x, wi.y)) * wi.z;
        let what = format!("{params:?}, {theta}, {phi}, {wi}");
        assert_close(found, expected, ROUND_OFF * expected.max_element(), &what);
    }
}

/// Largest errors of the Gaussian lobe of width 0.6 and height 1, whose curvature is 1/0.6² = 2.8.
///
/// Linear interpolation errs by curvature·step²/8. The mirror direction moves by 0.175 on the disk in 10 degrees,
/// and a pixel is 1/8 wide in x and in y: 0.0107 + 2·0.0055 at the peak.
#[test]
fn smooth_lobes_err_with_the_square_of_the_spacing() {
    const WIDTH: f64 = 0.6;
    const COARSE_TOL: f64 = 0.022;
    /// Halved spacing leaves a quarter; a little more where the worst point moves.
    const ORDER_MIN: f64 = 3.5;
    let worst = |steps: usize, phi: Vec<f32>| {
        let grid = Grid {
            theta: spaced(80.0, 8 * steps + 1),
            phi,
            height: 16 * steps,
            width: 16 * steps,
            ..Grid::default()
        };
        let bsdf = bound(&grid, &[], |at| lobe(WIDTH, at));
        let mut rng = Rng::new(&[0x1e9]);
        (0..20_000).fold(0.0, |worst: f64, _| {
            let (theta, phi) = (80.0 * rng.uniform(), 360.0 * rng.uniform());
            // Within the outermost centres: beyond them the value is continued, which errs by the slope times the
            // distance, not by its square.
            let wi = direction((0.9 * rng.uniform()).asin().to_degrees(), 360.0 * rng.uniform());
            let at = At {
                params: &[],
                theta,
                phi,
                wi,
            };
            let error = eval(&bsdf, direction(theta, phi), wi) / wi.z - DVec3::from_array(lobe(WIDTH, &at));
            worst.max(error.abs().max_element())
        })
    };
    for (phi, finer) in [(vec![0.0], vec![0.0]), (circle(36), circle(72))] {
        let anisotropic = phi.len() > 1;
        let (coarse, fine) = (worst(1, phi), worst(2, finer));
        // The azimuth adds as much as θ does, at most.
        let tolerance = if anisotropic { 1.5 * COARSE_TOL } else { COARSE_TOL };
        assert!(
            coarse < tolerance,
            "worst error {coarse}, anisotropic: {anisotropic}"
        );
        assert!(
            coarse > ORDER_MIN * fine,
            "{coarse} coarse, {fine} fine, anisotropic: {anisotropic}"
        );
    }
}

#[test]
fn azimuths_are_neighbours_round_the_circle() {
    // Uneven, unsorted, without 0, partly written as negative angles.
    let phi = [200.0, -70.0, 15.0, 90.0];
    let value = |phi: f64| 1.0 + (phi.rem_euclid(360.0) / 100.0).floor();
    let grid = Grid {
        theta: vec![40.0],
        phi: phi.to_vec(),
        height: 3,
        width: 3,
        ..Grid::default()
    };
    let table = File::of(&grid, |at| [value(at.phi), 0.0, at.phi.to_radians().sin() + 1.0]).table();
    assert_eq!(table.phi(), [15.0, 90.0, 200.0, 290.0]);
    let bsdf = table.bind(&[]).expect("there are no parameters");
    let at = |phi: f64| eval(&bsdf, direction(40.0, phi), DVec3::Z).x;
    for (phi, expected) in [
        (15.0, 1.0),
        (50.0, 1.0),
        (145.0, 2.0),
        (200.0, 3.0),
        (290.0, 3.0),
        (324.0, 3.0 - 2.0 * 34.0 / 85.0),
        (0.0, 3.0 - 2.0 * 70.0 / 85.0),
        (-1.0, 3.0 - 2.0 * 69.0 / 85.0),
        (359.0, 3.0 - 2.0 * 69.0 / 85.0),
        (5.0, 3.0 - 2.0 * 75.0 / 85.0),
    ] {
        assert_close(
            DVec3::splat(at(phi)),
            DVec3::splat(expected),
            ROUND_OFF * expected,
            &format!("phi {phi}"),
        );
    }
}

#[test]
fn isotropic_slices_turn_with_wo() {
    let grid = |phi: f32| Grid {
        theta: spaced(85.0, 18),
        phi: vec![phi],
        height: 24,
        width: 24,
        ..Grid::default()
    };
    let bsdf = bound(&grid(0.0), &[], |at| lobe(0.2, at));
    let quarter = bound(&grid(90.0), &[], |at| lobe(0.2, at));
    for (wo, wi) in directions(500, 3).zip(directions(500, 4)) {
        let expected = eval(&bsdf, wo, wi);
        let what = format!("{wo} to {wi}");
        for turn in [30.0, 90.0, 180.0, 271.0] {
            let turn = glam::DMat3::from_rotation_z(f64::to_radians(turn));
            // The pole itself has no azimuth, and there the slice stays as it is.
            if wo.z < 1.0 {
                assert_close(eval(&bsdf, turn * wo, turn * wi), expected, ROUND_OFF, &what);
            }
        }
        // A slice tabulated at another azimuth is the same one, turned: by a right angle, pixel by pixel.
        if wo.z < 1.0 {
            assert_close(eval(&quarter, wo, wi), expected, ROUND_OFF, &what);
        }
    }
}

#[test]
fn theta_outside_the_table_takes_the_nearest_slice() {
    let grid = Grid {
        theta: vec![20.0, 50.0, 70.0],
        phi: circle(3),
        height: 8,
        width: 8,
        ..Grid::default()
    };
    let bsdf = bound(&grid, &[], |at| [at.theta, 1.0, 0.0]);
    for (theta, expected) in [
        (0.0, 20.0),
        (10.0, 20.0),
        (35.0, 35.0),
        (70.0, 70.0),
        (89.99, 70.0),
    ] {
        let wi = direction(60.0, 10.0);
        let found = eval(&bsdf, direction(theta, 50.0), wi).x;
        let expected = expected * wi.z;
        assert!(
            (found - expected).abs() < ROUND_OFF * expected,
            "{found} at theta {theta}, expected {expected}"
        );
    }
}

#[test]
fn rows_may_come_in_any_order() {
    let grid = Grid {
        params: vec![vec![0.1, 0.9], vec![5.0, 6.0, 7.0]],
        theta: vec![0.0, 30.0, 60.0],
        phi: circle(4),
        height: 3,
        width: 5,
    };
    let file = File::of(&grid, |at| {
        [at.params[0], at.params[1] + at.theta, at.phi + at.wi.x + 1.0]
    });
    let n = 2 * 3 * 3 * 4;
    // 7 has no common divisor with the number of rows, so every row comes once.
    let mut shuffled = file.clone();
    for (_, _, bytes) in shuffled.tensors.values_mut() {
        let row = bytes.len() / n;
        *bytes = (0..n)
            .flat_map(|k| bytes[7 * k % n * row..][..row].to_vec())
            .collect();
    }
    assert_ne!(file.bytes(), shuffled.bytes());
    assert!(file.read().expect("a table") == shuffled.read().expect("a table"));
}
