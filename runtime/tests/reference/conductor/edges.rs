//! Hard and forbidden inputs, determinism, and why walks end.

use crate::support::{ROUND_OFF, direction};
use bake_runtime::conductor::Conductor;
use bake_runtime::{Bsdf, Error, Rng};
use glam::DVec3;

#[test]
fn hard_inputs_stay_finite_and_non_negative() {
    const KEYS: u64 = 8;
    const LAST_UNIFORM: f64 = 1.0 - f64::EPSILON / 2.0;
    let thetas = [0.0, 1e-7, 0.01, 45.0, 89.0, 89.9, 89.99];
    let directions: Vec<DVec3> = thetas
        .iter()
        .flat_map(|&t| [0.0, 90.0, 180.0, 233.0].map(|p| direction(t, p)))
        .collect();
    for alpha in [
        [1e-4; 2],
        [1e-3; 2],
        [0.01, 1e-4],
        [1.0, 0.01],
        [0.01, 1.0],
        [1.0; 2],
    ] {
        for reflectance in [[0.0; 3], [1.0; 3], [1.0, 0.5, 0.0]] {
            let conductor = Conductor::new(alpha, reflectance).expect("valid parameters");
            for &wo in &directions {
                let mirrored = DVec3::new(-wo.x, -wo.y, wo.z);
                for &wi in directions.iter().chain([&mirrored]) {
                    let what = format!("alpha {alpha:?}, reflectance {reflectance:?}, {wo} to {wi}");
                    let pdf = conductor.pdf(wo, wi);
                    assert!(pdf.is_finite() && pdf >= 0.0, "pdf {pdf}: {what}");
                    for key in 0..KEYS {
                        let f = conductor.eval(wo, wi, &mut Rng::new(&[10, key]));
                        assert!(f.is_finite() && f.min_element() >= 0.0, "eval {f}: {what}");
                    }
                }
                for u in [
                    [0.0, 0.0],
                    [0.0, LAST_UNIFORM],
                    [LAST_UNIFORM, 0.5],
                    [LAST_UNIFORM; 2],
                    [0.3, 0.7],
                ] {
                    let what = format!("alpha {alpha:?}, reflectance {reflectance:?}, {wo}, u {u:?}");
                    let wi = conductor.propose(wo, u).expect("wo is above the horizon");
                    assert!(
                        wi.z > 0.0 && (wi.length() - 1.0).abs() < ROUND_OFF,
                        "propose {wi}: {what}"
                    );
                    for key in 0..KEYS {
                        let Some(s) = conductor.sample(wo, u, &mut Rng::new(&[11, key])) else {
                            continue;
                        };
                        assert!(
                            s.wi.z > 0.0 && (s.wi.length() - 1.0).abs() < ROUND_OFF,
                            "sample {s:?}: {what}"
                        );
                        let weights = (s.weight.min_element(), s.weight.max_element());
                        assert!(
                            weights.0 >= 0.0 && weights.1 <= 1.0 + ROUND_OFF,
                            "sample {s:?}: {what}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn directions_below_the_horizon_or_not_finite_give_nothing() {
    let conductor = Conductor::new([0.3, 0.1], [1.0; 3]).expect("valid parameters");
    let above = direction(30.0, 10.0);
    for bad in [
        -above,
        DVec3::X,
        above.with_x(f64::NAN),
        above.with_z(f64::NAN),
        above.with_z(f64::INFINITY),
    ] {
        let mut rng = Rng::new(&[12]);
        for (wo, wi) in [(above, bad), (bad, above), (bad, bad)] {
            assert_eq!(conductor.eval(wo, wi, &mut rng), DVec3::ZERO);
            assert_eq!(conductor.single(wo, wi), DVec3::ZERO);
            assert_eq!(conductor.pdf(wo, wi), 0.0);
        }
        assert_eq!(conductor.sample(bad, [0.5, 0.5], &mut rng), None);
        assert_eq!(conductor.propose(bad, [0.5, 0.5]), None);
        let mut vertices = Vec::new();
        while vertices.is_empty() {
            conductor.walk(above, rng.pair(), &mut rng, |vertex| vertices.push(*vertex));
        }
        assert_eq!(conductor.connect(&vertices[0], bad), DVec3::ZERO);
    }
}

#[test]
fn new_names_the_parameter_it_refuses() {
    let refused = |alpha: [f64; 2], reflectance: [f64; 3]| match Conductor::new(alpha, reflectance) {
        Err(Error::Parameter { name, .. }) => name,
        other => panic!("{alpha:?} {reflectance:?} gave {other:?}"),
    };
    for bad in [
        0.0,
        -0.1,
        0.5 * Conductor::ALPHA_MIN,
        1.0 + f64::EPSILON,
        f64::NAN,
        f64::INFINITY,
    ] {
        assert_eq!(refused([bad, 0.5], [1.0; 3]), "alpha[0]");
        assert_eq!(refused([0.5, bad], [1.0; 3]), "alpha[1]");
    }
    for bad in [
        -f64::MIN_POSITIVE,
        1.0 + f64::EPSILON,
        f64::NAN,
        f64::NEG_INFINITY,
    ] {
        assert_eq!(refused([0.5; 2], [bad, 0.5, 0.5]), "reflectance[0]");
        assert_eq!(refused([0.5; 2], [0.5, 0.5, bad]), "reflectance[2]");
    }
    assert!(Conductor::new([Conductor::ALPHA_MIN, 1.0], [0.0, 0.5, 1.0]).is_ok());
}

#[test]
fn each_order_hands_on_so_little_that_walks_end() {
    /// The share in the reason why walks need no bound on their order.
    const HANDED_ON_MAX: f64 = 0.7;
    const WALKS: usize = 400_000;
    let conductor = Conductor::new([1.0; 2], [1.0; 3]).expect("valid parameters");
    let mut rng = Rng::new(&[13]);
    let mut reached = [0u32; 16];
    for _ in 0..WALKS {
        let mut order = 0;
        let u = rng.pair();
        conductor.walk(DVec3::Z, u, &mut rng, |_| {
            order = (order + 1).min(reached.len() - 1);
            reached[order] += 1;
        });
        reached[0] += 1;
    }
    // The first shares are the largest; far down the counts are too small to speak of shares.
    for pair in reached.windows(2).take_while(|pair| pair[1] > 1000) {
        assert!(
            f64::from(pair[1]) < HANDED_ON_MAX * f64::from(pair[0]),
            "{reached:?}"
        );
    }
}

#[test]
fn one_key_gives_one_result() {
    let conductor = Conductor::new([0.6, 0.2], [0.9, 0.5, 0.1]).expect("valid parameters");
    let (wo, wi) = (direction(60.0, 20.0), direction(40.0, 190.0));
    for key in 0..1000 {
        let run = || {
            let mut rng = Rng::new(&[14, key]);
            (
                conductor.sample(wo, [0.1, 0.9], &mut rng),
                conductor.eval(wo, wi, &mut rng),
                rng.bits(),
            )
        };
        assert_eq!(run(), run());
    }
}
