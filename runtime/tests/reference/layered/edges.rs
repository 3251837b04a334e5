//! Hard and forbidden inputs, and determinism.

use super::SETTINGS;
use crate::support::{ROUND_OFF, direction};
use bake_runtime::layered::Layered;
use bake_runtime::{Bsdf, Error, Rng};
use glam::DVec3;

#[test]
fn hard_inputs_stay_finite_and_non_negative() {
    const KEYS: u64 = 3;
    const LAST_UNIFORM: f64 = 1.0 - f64::EPSILON / 2.0;
    let thetas = [0.0, 1e-7, 45.0, 89.0, 89.99];
    let directions: Vec<DVec3> = thetas
        .iter()
        .flat_map(|&t| [0.0, 90.0, 233.0].map(|p| direction(t, p)))
        .collect();
    for alpha in [1e-3, 0.2, 1.0] {
        for eta in [1.0, 1.0 - 1e-6, 1.0 + 1e-6, 0.6, 1.5, 3.0] {
            for (sigma_t, g) in [(0.0, 0.0), (1.0, 0.9), (50.0, 0.0)] {
                for (albedo, base) in [(0.0, 0.0), (1.0, 0.5), (0.5, 1.0)] {
                    let layered = Layered::new(alpha, eta, sigma_t, [albedo; 3], [base; 3], g)
                        .expect("valid parameters");
                    for &wo in &directions {
                        let mirrored = DVec3::new(-wo.x, -wo.y, wo.z);
                        let what = format!("{layered:?}, {wo}");
                        for &wi in directions.iter().chain([&mirrored]) {
                            let pdf = layered.pdf(wo, wi);
                            assert!(pdf.is_finite() && pdf >= 0.0, "pdf {pdf}: {what} to {wi}");
                            for key in 0..KEYS {
                                let mut rng = Rng::new(&[40, key]);
                                let f = layered.eval(wo, wi, &mut rng);
                                assert!(
                                    f.is_finite() && f.min_element() >= 0.0,
                                    "eval {f}: {what} to {wi}"
                                );
                                let pdf = layered.pdf_stochastic(wo, wi, &mut rng);
                                assert!(pdf.is_finite() && pdf >= 0.0, "pdf {pdf}: {what} to {wi}");
                            }
                        }
                        for u in [[0.0, 0.0], [0.0, LAST_UNIFORM], [LAST_UNIFORM; 2], [0.3, 0.7]] {
                            let wi = layered.propose(wo, u).expect("wo is above the horizon");
                            assert!(
                                wi.z > 0.0 && (wi.length() - 1.0).abs() < ROUND_OFF,
                                "propose {wi}: {what}"
                            );
                            for key in 0..KEYS {
                                let Some(s) = layered.sample(wo, u, &mut Rng::new(&[41, key])) else {
                                    continue;
                                };
                                assert!(
                                    s.wi.z > 0.0 && (s.wi.length() - 1.0).abs() < ROUND_OFF,
                                    "sample {s:?}: {what}"
                                );
                                assert!(
                                    s.weight.min_element() >= 0.0
                                        && s.weight.max_element() <= 1.0 + ROUND_OFF,
                                    "sample {s:?}: {what}"
                                );
                            }
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn directions_that_are_none_give_nothing() {
    let layered = SETTINGS[0].layered();
    let above = direction(30.0, 10.0);
    for bad in [
        -above,
        DVec3::X,
        above * 1.1,
        above.with_x(f64::NAN),
        above.with_z(f64::NAN),
        above.with_z(f64::INFINITY),
    ] {
        let mut rng = Rng::new(&[42]);
        for (wo, wi) in [(above, bad), (bad, above), (bad, bad)] {
            assert_eq!(layered.eval(wo, wi, &mut rng), DVec3::ZERO);
            assert_eq!(layered.reflection(wo, wi), 0.0);
            assert_eq!(layered.pdf(wo, wi), 0.0);
            assert_eq!(layered.pdf_stochastic(wo, wi, &mut rng), 0.0);
            assert_eq!(layered.slice(wo, 16, 1).eval(wi), DVec3::ZERO);
        }
        assert_eq!(layered.sample(bad, [0.5, 0.5], &mut rng), None);
        assert_eq!(layered.propose(bad, [0.5, 0.5]), None);
    }
}

#[test]
fn new_names_the_parameter_it_refuses() {
    let refused =
        |alpha, eta, sigma_t, albedo, base, g| match Layered::new(alpha, eta, sigma_t, albedo, base, g) {
            Err(Error::Parameter { name, reason }) => {
                assert!(reason.contains("must lie in"), "{reason}");
                name
            }
            other => panic!("gave {other:?}"),
        };
    let (half, above) = ([0.5; 3], [0.5, 1.0 + f64::EPSILON, 0.5]);
    for bad in [f64::NAN, -0.1, 1e-5, 1.1, f64::INFINITY] {
        assert_eq!(refused(bad, 1.5, 1.0, half, half, 0.0), "alpha");
    }
    for bad in [f64::NAN, 0.0, 0.4, 4.1] {
        assert_eq!(refused(0.3, bad, 1.0, half, half, 0.0), "eta");
    }
    for bad in [f64::NAN, -1e-9, 100.1, f64::INFINITY] {
        assert_eq!(refused(0.3, 1.5, bad, half, half, 0.0), "sigma_t");
    }
    assert_eq!(refused(0.3, 1.5, 1.0, above, half, 0.0), "albedo[1]");
    assert_eq!(refused(0.3, 1.5, 1.0, half, above, 0.0), "base[1]");
    for bad in [f64::NAN, 1.0, -1.0] {
        assert_eq!(refused(0.3, 1.5, 1.0, half, half, bad), "g");
    }
}

#[test]
fn one_key_gives_one_result() {
    let layered = SETTINGS[8].layered();
    let (wo, wi) = (direction(60.0, 20.0), direction(40.0, 190.0));
    for key in 0..1000 {
        let run = || {
            let mut rng = Rng::new(&[43, key]);
            (
                layered.sample(wo, [0.1, 0.9], &mut rng),
                layered.eval(wo, wi, &mut rng),
                rng.bits(),
            )
        };
        assert_eq!(run(), run());
    }
}
