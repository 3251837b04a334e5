//! The reference models built in single precision from the same source (`runtime/single_precision`), against the
//! library's double precision, on hard cases: everything stays finite and not negative, and what is deterministic
//! differs by no more than stated.
//!
//! Both builds get the same numbers: directions and parameters are rounded to f32 first, so that the differences are
//! those of the formulas and not of their input.

use bake_runtime::Bsdf as _;
use bake_single_precision::bsdf::Bsdf as _;
use bake_single_precision::conductor::{CompensatedConductor, Conductor};
use bake_single_precision::layered::Layered;
use bake_single_precision::principled::{Principled, PrincipledParameters};
use bake_single_precision::random::Rng;
use glam::{DVec3, Vec3};

/// Largest relative difference of closed forms: unit vectors in f32 are off by 1e-7 of their length, which lobes of
/// alpha 0.001 and directions next to the horizon magnify. Found: 1e-4 for the table of the compensated conductor, 1e-5
/// for the other models.
const RELATIVE_TOL: f64 = 5e-4;
/// Values below this share of the largest one at the same `wo` count as this: what nobody sees may differ.
const FLOOR: f64 = 1e-9;
/// Standard errors allowed between the means of both builds' walks: seven comparisons exceed 4 once in 2000 runs.
const SIGMAS: f64 = 4.0;

/// Directions up to 89.99°, as f32 has them, with their mirror images.
fn directions() -> Vec<Vec3> {
    let mut all = Vec::new();
    for theta in [0.0, 1e-5, 0.1, 30.0, 60.0, 85.0, 89.0, 89.9, 89.99_f64] {
        for phi in [0.0, 45.0, 90.0, 180.0, 233.0_f64] {
            let ((sin, cos), (y, x)) = (theta.to_radians().sin_cos(), phi.to_radians().sin_cos());
            let w = DVec3::new(sin * x, sin * y, cos).as_vec3();
            all.extend([w, Vec3::new(-w.x, -w.y, w.z)]);
        }
    }
    all
}

/// The largest relative difference found so far, and where.
#[derive(Default)]
struct Worst {
    difference: f64,
    place: String,
}

impl Worst {
    /// Compares two slices of values over all `wi`, both finite and not negative.
    fn compare(&mut self, single: &[f32], double: &[f64], place: impl Fn(usize) -> String) {
        let largest = double.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        for (i, (s, d)) in single.iter().zip(double).enumerate() {
            assert!(s.is_finite() && *s >= 0.0, "f32 gives {s}: {}", place(i));
            assert!(d.is_finite() && *d >= 0.0, "f64 gives {d}: {}", place(i));
            let difference = (f64::from(*s) - d).abs() / d.max(FLOOR * largest);
            if difference > self.difference {
                *self = Worst {
                    difference,
                    place: format!("{s} and {d} at {}", place(i)),
                };
            }
        }
    }

    /// [`Worst::compare`] of one number per direction, from both builds.
    fn compare_numbers(
        &mut self,
        wis: &[Vec3],
        single: impl Fn(Vec3) -> f32,
        double: impl Fn(DVec3) -> f64,
        place: impl Fn(usize) -> String,
    ) {
        let single: Vec<f32> = wis.iter().map(|wi| single(*wi)).collect();
        let double: Vec<f64> = wis.iter().map(|wi| double(wi.as_dvec3())).collect();
        self.compare(&single, &double, place);
    }

    fn assert_small(&self, what: &str) {
        eprintln!("{what}: {:.1e}, {}", self.difference, self.place);
        assert!(
            self.difference < RELATIVE_TOL,
            "{what}: {:e}, {}",
            self.difference,
            self.place
        );
    }
}

#[test]
fn conductor() {
    let (mut single, mut pdf, mut compensated) = (Worst::default(), Worst::default(), Worst::default());
    for alpha in [
        [1e-3, 1e-3],
        [0.3, 0.003],
        [0.01, 1.0],
        [0.1, 0.1],
        [1.0, 1.0_f32],
    ] {
        for reflectance in [[0.0; 3], [1.0, 0.782, 0.344], [1.0; 3_usize]] {
            let low = Conductor::new(alpha, reflectance).expect("valid parameters");
            let high =
                bake_runtime::conductor::Conductor::new(alpha.map(f64::from), reflectance.map(f64::from))
                    .expect("valid parameters");
            let low_compensated = CompensatedConductor::new(low.clone());
            let high_compensated = bake_runtime::conductor::CompensatedConductor::new(high.clone());
            for wo in directions() {
                let wis: Vec<Vec3> = directions().into_iter().chain([wo]).collect();
                let place = |i: usize| format!("{alpha:?} {reflectance:?} {wo} {}", wis[i / 3]);
                let rgb =
                    |f: &dyn Fn(Vec3) -> Vec3| wis.iter().flat_map(|w| f(*w).to_array()).collect::<Vec<_>>();
                let rgb64 = |f: &dyn Fn(DVec3) -> DVec3| {
                    wis.iter()
                        .flat_map(|w| f(w.as_dvec3()).to_array())
                        .collect::<Vec<_>>()
                };
                let wo64 = wo.as_dvec3();
                single.compare(
                    &rgb(&|wi| low.single(wo, wi)),
                    &rgb64(&|wi| high.single(wo64, wi)),
                    place,
                );
                pdf.compare(
                    &rgb(&|wi| Vec3::splat(low.pdf(wo, wi))),
                    &rgb64(&|wi| DVec3::splat(high.pdf(wo64, wi))),
                    place,
                );
                compensated.compare(
                    &rgb(&|wi| low_compensated.eval(wo, wi, &mut Rng::new(&[]))),
                    &rgb64(&|wi| high_compensated.eval(wo64, wi, &mut bake_runtime::Rng::new(&[]))),
                    place,
                );
                for key in 0..2 {
                    for wi in &wis {
                        let f = low.eval(wo, *wi, &mut Rng::new(&[50, key]));
                        assert!(
                            f.is_finite() && f.min_element() >= 0.0,
                            "eval {f} at {alpha:?} {wo} {wi}"
                        );
                    }
                    for u in [[0.0, 0.0], [0.3, 0.7], [1.0 - f32::EPSILON / 2.0; 2]] {
                        if let Some(s) = low.sample(wo, u, &mut Rng::new(&[51, key])) {
                            assert!(
                                s.wi.is_finite() && s.wi.z > 0.0 && s.weight.is_finite(),
                                "{s:?} at {wo}"
                            );
                        }
                    }
                }
            }
        }
    }
    single.assert_small("conductor, single scattering");
    pdf.assert_small("conductor, pdf");
    compensated.assert_small("conductor, compensated");
}

#[test]
fn layered() {
    let (mut reflection, mut pdf) = (Worst::default(), Worst::default());
    for alpha in [1e-3, 0.1, 1.0_f32] {
        for eta in [1.0, 1.0 - 1e-6, 1.0 + 1e-6, 0.7, 1.5, 3.0_f32] {
            for (sigma_t, colour, g) in [
                (0.0, 1.0, 0.0),
                (0.8, 0.5, 0.6),
                (50.0, 0.9, 0.0),
                (1.0, 0.0, 0.0_f32),
            ] {
                let low =
                    Layered::new(alpha, eta, sigma_t, [colour; 3], [colour; 3], g).expect("valid parameters");
                let wide = [colour.into(); 3];
                let high = bake_runtime::layered::Layered::new(
                    alpha.into(),
                    eta.into(),
                    sigma_t.into(),
                    wide,
                    wide,
                    g.into(),
                )
                .expect("valid parameters");
                for wo in directions() {
                    let wis: Vec<Vec3> = directions().into_iter().chain([wo]).collect();
                    let place = |i: usize| format!("{low:?} {wo} {}", wis[i]);
                    let wo64 = wo.as_dvec3();
                    reflection.compare_numbers(
                        &wis,
                        |wi| low.reflection(wo, wi),
                        |wi| high.reflection(wo64, wi),
                        place,
                    );
                    pdf.compare_numbers(&wis, |wi| low.pdf(wo, wi), |wi| high.pdf(wo64, wi), place);
                    for wi in wis.iter().step_by(7) {
                        let f = low.eval(wo, *wi, &mut Rng::new(&[52]));
                        assert!(
                            f.is_finite() && f.min_element() >= 0.0,
                            "eval {f} of {low:?} at {wo} {wi}"
                        );
                    }
                    if let Some(s) = low.sample(wo, [0.3, 0.7], &mut Rng::new(&[53])) {
                        assert!(
                            s.wi.is_finite() && s.wi.z > 0.0 && s.weight.is_finite(),
                            "{s:?} at {wo}"
                        );
                    }
                }
            }
        }
    }
    reflection.assert_small("layered, reflection");
    pdf.assert_small("layered, pdf");
}

#[test]
fn principled() {
    let (mut value, mut pdf) = (Worst::default(), Worst::default());
    for roughness in [0.0, 0.0317, 0.3, 1.0_f32] {
        for anisotropic in [0.0, 1.0_f32] {
            for metallic in [0.0, 0.5, 1.0_f32] {
                for (colour, rest) in [(0.0, 0.0), (1.0, 1.0), (0.5, 0.5_f32)] {
                    let low = Principled::new(PrincipledParameters {
                        base_color: Vec3::splat(colour),
                        metallic,
                        roughness,
                        specular: 0.5,
                        specular_tint: rest,
                        anisotropic,
                        sheen: rest,
                        sheen_tint: rest,
                        clearcoat: rest,
                        clearcoat_gloss: rest,
                        flatness: rest,
                    })
                    .expect("valid parameters");
                    let rest = f64::from(rest);
                    let high = bake_runtime::principled::Principled::new(
                        bake_runtime::principled::PrincipledParameters {
                            base_color: DVec3::splat(colour.into()),
                            metallic: metallic.into(),
                            roughness: roughness.into(),
                            specular: 0.5,
                            specular_tint: rest,
                            anisotropic: anisotropic.into(),
                            sheen: rest,
                            sheen_tint: rest,
                            clearcoat: rest,
                            clearcoat_gloss: rest,
                            flatness: rest,
                        },
                    )
                    .expect("valid parameters");
                    for wo in directions() {
                        let wis: Vec<Vec3> = directions().into_iter().chain([wo]).collect();
                        let place = |i: usize| format!("{:?} {wo} {}", low.parameters(), wis[i]);
                        let wo64 = wo.as_dvec3();
                        value.compare_numbers(
                            &wis,
                            |wi| low.eval(wo, wi, &mut Rng::new(&[])).x,
                            |wi| high.eval(wo64, wi, &mut bake_runtime::Rng::new(&[])).x,
                            place,
                        );
                        pdf.compare_numbers(&wis, |wi| low.pdf(wo, wi), |wi| high.pdf(wo64, wi), place);
                        for u in [[0.0, 0.0], [0.3, 0.7], [1.0 - f32::EPSILON / 2.0; 2]] {
                            if let Some(s) = low.sample(wo, u, &mut Rng::new(&[])) {
                                assert!(
                                    s.wi.is_finite() && s.wi.z > 0.0 && s.weight.is_finite(),
                                    "{s:?} at {wo}"
                                );
                            }
                        }
                    }
                }
            }
        }
    }
    value.assert_small("principled, eval");
    pdf.assert_small("principled, pdf");
}

/// Walks take other turns in f32; their means must not.
#[test]
fn walks_have_the_same_means() {
    const WALKS: u64 = 200_000;
    let wo = Vec3::new(0.6, 0.3, 0.7).normalize();
    let low = Conductor::new([0.6, 0.2], [0.9, 0.5, 0.1]).expect("valid parameters");
    let high =
        bake_runtime::conductor::Conductor::new([0.6, 0.2], [0.9, 0.5, 0.1]).expect("valid parameters");
    let pairs: [(&dyn bake_single_precision::bsdf::Bsdf, &dyn bake_runtime::Bsdf); 2] = [
        (&low, &high),
        (
            &Layered::new(0.3, 1.5, 2.0, [0.9, 0.6, 0.3], [0.8, 0.5, 0.2], 0.4).expect("valid parameters"),
            &bake_runtime::layered::Layered::new(0.3, 1.5, 2.0, [0.9, 0.6, 0.3], [0.8, 0.5, 0.2], 0.4)
                .expect("valid parameters"),
        ),
    ];
    for (low, high) in pairs {
        let low = low.albedo(wo, WALKS, 1);
        let high = high.albedo(wo.as_dvec3(), WALKS, 2);
        let difference = (low.mean.as_dvec3() - high.mean).abs();
        let allowed = SIGMAS * (low.se.as_dvec3().powf(2.0) + high.se.powf(2.0)).powf(0.5);
        assert!(difference.cmple(allowed).all(), "{low:?} {high:?}");
    }
}
