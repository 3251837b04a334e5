//! Hard and forbidden inputs, and what holds exactly.

use super::{bound, direction, eval, settings};
use bake_runtime::principled::{Principled, PrincipledParameters};
use bake_runtime::{Bsdf, Error, Rng};
use glam::DVec3;

/// Round-off of a handful of f64 operations whose terms do not cancel.
const ROUND_OFF: f64 = 1e-11;

/// Largest number below 1 that a generator gives.
const LAST_UNIFORM: f64 = 1.0 - f64::EPSILON / 2.0;

type Set = fn(&mut PrincipledParameters, f64);

/// Every parameter that is one number: its name and how to set it.
const SCALARS: [(&str, Set); 10] = [
    ("metallic", |p, v| p.metallic = v),
    ("roughness", |p, v| p.roughness = v),
    ("specular", |p, v| p.specular = v),
    ("specular_tint", |p, v| p.specular_tint = v),
    ("anisotropic", |p, v| p.anisotropic = v),
    ("sheen", |p, v| p.sheen = v),
    ("sheen_tint", |p, v| p.sheen_tint = v),
    ("clearcoat", |p, v| p.clearcoat = v),
    ("clearcoat_gloss", |p, v| p.clearcoat_gloss = v),
    ("flatness", |p, v| p.flatness = v),
];

/// Every corner of the domain with few parameters at 1, or few at 0, and black, white and saturated base colours.
fn corners() -> Vec<PrincipledParameters> {
    let mut corners = Vec::new();
    for base_color in [DVec3::ZERO, DVec3::ONE, DVec3::Z, DVec3::new(1.0, 0.5, 0.0)] {
        for others in [0.0, 1.0] {
            let mut all = PrincipledParameters {
                base_color,
                ..PrincipledParameters::default()
            };
            for (_, set) in SCALARS {
                set(&mut all, others);
            }
            corners.push(all);
            for (i, (_, set)) in SCALARS.into_iter().enumerate() {
                let mut one = all;
                set(&mut one, 1.0 - others);
                corners.push(one);
                for (_, set) in SCALARS.into_iter().skip(i + 1) {
                    let mut two = one;
                    set(&mut two, 1.0 - others);
                    corners.push(two);
                }
            }
        }
    }
    // Next to the corners: denormal numbers, and the last one below 1.
    for faint in [0.1 * f64::MIN_POSITIVE, f64::MIN_POSITIVE, LAST_UNIFORM] {
        for metallic in [0.0, faint, 1.0] {
            let mut all = PrincipledParameters::default();
            for (_, set) in SCALARS {
                set(&mut all, faint);
            }
            all.base_color = DVec3::new(faint, 0.0, faint);
            corners.push(PrincipledParameters { metallic, ..all });
        }
    }
    corners
}

#[test]
fn hard_inputs_stay_finite_and_non_negative() {
    let thetas = [0.0, 1e-7, 45.0, 89.0, 89.99];
    let directions: Vec<DVec3> = thetas
        .iter()
        .flat_map(|&t| [0.0, 90.0, 180.0, 233.0].map(|p| direction(t, p)))
        .chain([DVec3::Z, 1.000_04 * DVec3::Z, DVec3::new(0.8, -0.6, 1e-200)])
        .collect();
    for parameters in corners() {
        let bsdf = bound(parameters);
        for &wo in &directions {
            let mirrored = DVec3::new(-wo.x, -wo.y, wo.z);
            for &wi in directions.iter().chain([&mirrored]) {
                let (f, pdf) = (eval(&bsdf, wo, wi), bsdf.pdf(wo, wi));
                let what = format!("{parameters:?}, {wo} to {wi}");
                assert!(f.is_finite() && f.min_element() >= 0.0, "eval {f}: {what}");
                assert!(pdf.is_finite() && pdf >= 0.0, "pdf {pdf}: {what}");
                assert!(f == DVec3::ZERO || pdf > 0.0, "eval {f} but pdf {pdf}: {what}");
            }
            for u in [0.0, 0.3, 0.6, 0.97, LAST_UNIFORM].map(|u| [[u, 0.0], [u, 0.4], [u, LAST_UNIFORM]]) {
                for u in u {
                    let sample = bsdf
                        .sample(wo, u, &mut Rng::new(&[]))
                        .expect("wo is above the horizon");
                    let what = format!("{sample:?}: {parameters:?}, {wo}, u {u:?}");
                    let (wi, weight) = (sample.wi, sample.weight);
                    // Mirrored, a direction of not quite unit length keeps it.
                    let longer = (wi.length() - 1.0).abs() - (wo.length() - 1.0).abs();
                    assert!(wi.z > 0.0 && longer < ROUND_OFF, "{what}");
                    assert!(weight.is_finite() && weight.min_element() >= 0.0, "{what}");
                    assert_eq!(bsdf.propose(wo, u), Some(wi), "{what}");
                }
            }
        }
    }
}

#[test]
fn directions_below_the_horizon_or_not_unit_give_nothing() {
    let above = direction(30.0, 10.0);
    let bad_ones = [
        -above,
        DVec3::X,
        DVec3::ZERO,
        1.01 * above,
        above.with_x(f64::NAN),
        above.with_z(f64::NAN),
        above.with_z(f64::INFINITY),
    ];
    for (name, bsdf) in settings() {
        for bad in bad_ones {
            for (wo, wi) in [(above, bad), (bad, above), (bad, bad)] {
                assert_eq!(eval(&bsdf, wo, wi), DVec3::ZERO, "{name}, {bad}");
                assert_eq!(bsdf.pdf(wo, wi), 0.0, "{name}, {bad}");
            }
            let mut rng = Rng::new(&[]);
            assert_eq!(bsdf.sample(bad, [0.5, 0.5], &mut rng), None, "{name}, {bad}");
            assert_eq!(bsdf.propose(bad, [0.5, 0.5]), None, "{name}, {bad}");
        }
    }
}

#[test]
fn new_names_the_parameter_it_refuses() {
    let refused = |parameters: PrincipledParameters| match Principled::new(parameters) {
        Err(Error::Parameter { name, reason }) => {
            assert!(reason.contains("0..1"), "{name}: {reason}");
            name
        }
        other => panic!("{parameters:?} gave {other:?}"),
    };
    for bad in [-f64::MIN_POSITIVE, 1.0 + f64::EPSILON, f64::NAN, f64::INFINITY] {
        for (name, set) in SCALARS {
            let mut parameters = PrincipledParameters::default();
            set(&mut parameters, bad);
            assert_eq!(refused(parameters), name);
        }
        for i in 0..3 {
            let mut parameters = PrincipledParameters::default();
            parameters.base_color[i] = bad;
            assert_eq!(refused(parameters), format!("base_color[{i}]"));
        }
    }
}

#[test]
fn parameters_are_given_back() {
    for parameters in corners() {
        assert_eq!(*bound(parameters).parameters(), parameters);
    }
}

#[test]
fn eval_is_reciprocal() {
    const PAIRS: usize = 1000;
    for (name, bsdf) in settings() {
        let mut rng = Rng::new(&[0x4ec]);
        for _ in 0..PAIRS {
            let a = direction(89.9 * rng.uniform(), 360.0 * rng.uniform());
            let b = bsdf.propose(a, rng.pair()).expect("a is above the horizon");
            let (there, back) = (eval(&bsdf, a, b) / b.z, eval(&bsdf, b, a) / a.z);
            let error = (there - back).abs().max_element();
            assert!(
                error <= ROUND_OFF * there.max_element(),
                "{there} and {back}: {name}, {a} and {b}"
            );
        }
    }
}

/// As Mitsuba has it: see the documentation of [`Principled`].
#[test]
fn without_specular_not_even_a_metal_mirrors() {
    let metal = PrincipledParameters {
        metallic: 1.0,
        ..PrincipledParameters::default()
    };
    let (wo, wi) = (direction(30.0, 0.0), direction(32.0, 170.0));
    let with = |specular: f64| eval(&bound(PrincipledParameters { specular, ..metal }), wo, wi);
    assert_eq!(with(0.0), DVec3::ZERO);
    assert_eq!(with(f64::MIN_POSITIVE), with(1.0));
}

#[test]
fn a_slice_is_eval() {
    let wo = direction(50.0, 20.0);
    for (name, bsdf) in settings() {
        assert!(!bsdf.is_stochastic());
        let slice = bsdf.slice(wo, 0, 1);
        for wi in [direction(48.0, 195.0), direction(80.0, 20.0), -wo] {
            assert_eq!(slice.eval(wi), eval(&bsdf, wo, wi), "{name}");
        }
    }
}
