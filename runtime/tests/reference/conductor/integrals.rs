//! What the model must integrate to: white furnace, normalised pdf, reciprocity, and walks that average to the
//! integral of `eval`.

use crate::support::draws::assert_draws_follow_pdf;
use crate::support::histogram::assert_samples_follow_eval;
use crate::support::quadrature::{QUADRATURE_TOL, draw_normal};
use crate::support::{Means, ROUND_OFF, assert_agree, direction, lobe_frame};
use bake_runtime::conductor::{CompensatedConductor, Conductor};
use bake_runtime::{Bsdf, Rng};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Slack of the white furnace beside the standard errors: one tenth of a percent of light is not seen.
const FURNACE_TOL: f64 = 1e-3;
/// Largest standard error with which the furnace still says something about half a percent of light.
const FURNACE_SE_MAX: f64 = 1.5e-3;
/// Largest standard error with which the roulette still says something: it plays for 2 to 6 % of this light.
const ROULETTE_SE_MAX: f64 = 5e-4;
/// One estimate of ∫ g(wi)·eval(wo, wi) dω: the sum over the calls `add(f, wi)` of f·g(wi).
///
/// The single scattering has its directions from `propose`, and every vertex of a walk its own, mirrored at
/// a drawn normal. One direction for all parts would be correct, too, but where lobes are narrow one vertex in a
/// million would carry as much as all others, and no affordable mean would have an honest standard error.
fn integrate_eval(conductor: &Conductor, wo: DVec3, rng: &mut Rng, mut add: impl FnMut(DVec3, DVec3)) {
    let wi = conductor
        .propose(wo, rng.pair())
        .expect("wo is above the horizon");
    add(conductor.single(wo, wi) / conductor.pdf(wo, wi), wi);
    let mut vertices = Vec::new();
    conductor.walk(wo, rng.pair(), rng, |vertex| vertices.push(*vertex));
    for vertex in vertices {
        let (m, density) = draw_normal(conductor.alpha, rng.pair());
        let cos = -vertex.direction.dot(m);
        let wi = vertex.direction + 2.0 * cos * m;
        if cos > 0.0 && wi.z > 0.0 {
            add(conductor.connect(&vertex, wi) * (4.0 * cos / density), wi);
        }
    }
}

/// The oracle of `multiple` is the plain one-ended estimate: the connections of one walk from `wo`.
#[test]
fn walks_from_both_ends_agree_with_walks_from_one() {
    const DRAWS: usize = 400_000;
    let conductor = Conductor::new([0.6, 0.2], [0.9, 0.5, 0.1]).expect("valid parameters");
    let pairs = [
        (direction(50.0, 20.0), direction(40.0, 190.0)),
        (direction(80.0, 0.0), direction(10.0, 90.0)),
        (direction(30.0, 70.0), direction(85.0, 70.0)),
    ];
    for (k, (wo, wi)) in pairs.into_iter().enumerate() {
        let mut rng = Rng::new(&[3, k as u64]);
        let one = Means::of(DRAWS, || {
            let mut sum = DVec3::ZERO;
            let u = rng.pair();
            conductor.walk(wo, u, &mut rng, |v| sum += conductor.connect(v, wi));
            sum.to_array()
        });
        let mut rng = Rng::new(&[4, k as u64]);
        let both = Means::of(DRAWS, || conductor.multiple(wo, wi, &mut rng).to_array());
        for c in 0..3 {
            let what = format!("pair {k}, channel {c}");
            assert_agree((both.mean(c), both.se(c)), (one.mean(c), one.se(c)), 0.0, &what);
            assert!(both.se(c) < one.se(c), "{what}: two ends are noisier than one");
        }
    }
}

#[test]
fn white_furnace_by_integrating_eval() {
    const DRAWS: usize = 1_000_000;
    let thetas = [0.0, 30.0, 60.0, 75.0, 85.0, 88.0, 89.0, 89.9];
    for (k, alpha) in [
        [0.001, 0.001],
        [0.01, 0.01],
        [0.1, 0.001],
        [0.1, 0.1],
        [0.3, 0.1],
        [1.0, 1.0],
    ]
    .into_iter()
    .enumerate()
    {
        let conductor = Conductor::new(alpha, [1.0; 3]).expect("valid parameters");
        for (j, theta) in thetas.into_iter().enumerate() {
            let wo = direction(theta, 35.0);
            let mut rng = Rng::new(&[4, k as u64, j as u64]);
            let albedo = Means::of(DRAWS, || {
                let mut sum = 0.0;
                integrate_eval(&conductor, wo, &mut rng, |f, _| sum += f.x);
                [sum]
            });
            let (mean, se) = (albedo.mean(0), albedo.se(0));
            let what = format!("albedo at alpha {alpha:?}, theta {theta}");
            assert!(se < FURNACE_SE_MAX, "{what}: standard error {se}");
            assert_agree((mean, se), (1.0, 0.0), FURNACE_TOL, &what);
        }
    }
}

/// Compares the three channels and the direction of the reddest light.
#[test]
fn walks_average_to_the_integral_of_eval() {
    const DRAWS: usize = 400_000;
    let moments = |f: DVec3, wi: DVec3| [f.x, f.y, f.z, f.x * wi.x, f.x * wi.y, f.x * wi.z];
    // The second reflectance is low in every channel, so that roulette plays.
    for (k, reflectance) in [[0.9, 0.5, 0.1], [0.6, 0.3, 0.0]].into_iter().enumerate() {
        for (j, alpha) in [[0.1, 0.1], [0.3, 0.1], [1.0, 1.0]].into_iter().enumerate() {
            let conductor = Conductor::new(alpha, reflectance).expect("valid parameters");
            let wo = direction(75.0 - 25.0 * j as f64, 200.0);
            let mut rng = Rng::new(&[5, k as u64, j as u64]);
            let eval = Means::of(DRAWS, || {
                let mut sum = [0.0; 6];
                integrate_eval(&conductor, wo, &mut rng, |f, wi| {
                    sum.iter_mut()
                        .zip(moments(f, wi))
                        .for_each(|(s, moment)| *s += moment);
                });
                sum
            });
            let walk = Means::of(DRAWS, || {
                let sample = conductor.sample(wo, rng.pair(), &mut rng);
                sample.map_or([0.0; 6], |s| moments(s.weight, s.wi))
            });
            for i in 0..6 {
                let what = format!("moment {i} at alpha {alpha:?}, reflectance {reflectance:?}");
                assert_agree((walk.mean(i), walk.se(i)), (eval.mean(i), eval.se(i)), 0.0, &what);
            }
        }
    }
}

#[test]
fn roulette_keeps_the_mean() {
    const WALKS: usize = 400_000;
    // A white red channel keeps roulette away, and no channel knows of another's reflectance.
    let green_and_blue = |red: f64| {
        let conductor = Conductor::new([1.0, 1.0], [red, 0.6, 0.4]).expect("valid parameters");
        let mut rng = Rng::new(&[6]);
        Means::of(WALKS, || {
            let sample = conductor.sample(DVec3::Z, rng.pair(), &mut rng);
            sample.map_or([0.0; 2], |s| [s.weight.y, s.weight.z])
        })
    };
    let (with, without) = (green_and_blue(0.6), green_and_blue(1.0));
    for i in 0..2 {
        assert!(with.se(i) < ROULETTE_SE_MAX, "standard error {}", with.se(i));
        assert_agree(
            (with.mean(i), with.se(i)),
            (without.mean(i), without.se(i)),
            0.0,
            &format!("channel {i}"),
        );
    }
}

#[test]
fn pdf_integrates_to_one_and_is_the_density_of_propose() {
    const CELLS: usize = 1000;
    const DRAWS: usize = 200_000;
    for alpha in [[1e-4, 1e-4], [0.01, 0.01], [1.0, 0.01], [0.3, 0.1], [1.0, 1.0]] {
        let conductor = Conductor::new(alpha, [1.0; 3]).expect("valid parameters");
        for theta in [0.0, 45.0, 80.0, 89.0, 89.99] {
            let wo = direction(theta, 25.0);
            let what = format!("alpha {alpha:?}, theta {theta}");
            // Midpoint rule over the normals m that mirror wo to the upper hemisphere, dω_i = 4 (wo·m) dω_m, in
            // polar coordinates (tan ψ, φ) of the slopes that alpha has scaled to 1.
            let mut integral = [0.0; 4];
            for cell in 0..CELLS * CELLS {
                let psi = FRAC_PI_2 * ((cell % CELLS) as f64 + 0.5) / CELLS as f64;
                let (sin, cos) = (TAU * ((cell / CELLS) as f64 + 0.5) / CELLS as f64).sin_cos();
                let slope = DVec3::new(alpha[0] * psi.tan() * cos, alpha[1] * psi.tan() * sin, 1.0);
                let m = slope.normalize();
                let wi = 2.0 * wo.dot(m) * m - wo;
                if wo.dot(m) > 0.0 && wi.z > 0.0 {
                    let measure = m.z.powi(3) * alpha[0] * alpha[1] * psi.tan() / psi.cos().powi(2);
                    let mass = conductor.pdf(wo, wi) * 4.0 * wo.dot(m) * measure;
                    let cell_area = FRAC_PI_2 * TAU / (CELLS * CELLS) as f64;
                    for (sum, g) in integral.iter_mut().zip([1.0, wi.x, wi.y, wi.z]) {
                        *sum += g * mass * cell_area;
                    }
                }
            }
            assert!(
                (integral[0] - 1.0).abs() < QUADRATURE_TOL,
                "{what}: pdf integrates to {}",
                integral[0]
            );
            let mut rng = Rng::new(&[7]);
            let drawn = Means::of(DRAWS, || {
                conductor.propose(wo, rng.pair()).expect("above").to_array()
            });
            for i in 0..3 {
                let found = (drawn.mean(i), drawn.se(i));
                assert_agree(
                    found,
                    (integral[1 + i], 0.0),
                    QUADRATURE_TOL,
                    &format!("mean of wi[{i}], {what}"),
                );
            }
        }
    }
}

#[test]
fn single_is_reciprocal_exactly() {
    const PAIRS: usize = 1000;
    for alpha in [[1e-3, 1e-3], [0.01, 0.1], [0.3, 0.1], [1.0, 1.0]] {
        let conductor = Conductor::new(alpha, [0.9, 0.5, 0.1]).expect("valid parameters");
        let mut rng = Rng::new(&[8]);
        for _ in 0..PAIRS {
            let (a, b) = (direction(89.9 * rng.uniform(), 360.0 * rng.uniform()), rng.pair());
            let b = conductor.propose(a, b).expect("a is above the horizon");
            let (there, back) = (conductor.single(a, b) / b.z, conductor.single(b, a) / a.z);
            let error = (there - back).abs().max_element();
            assert!(
                error <= ROUND_OFF * there.max_element(),
                "{there} and {back}: {alpha:?}, {a} and {b}"
            );
        }
    }
}

/// Narrower lobes than alpha 0.1 are left to the white furnace, for the reason given at [`integrate_eval`].
#[test]
fn eval_is_reciprocal_on_average() {
    const EVALS: usize = 400_000;
    let pairs = [
        (direction(20.0, 10.0), direction(60.0, 170.0)),
        (direction(80.0, 100.0), direction(70.0, -75.0)),
        (direction(50.0, 45.0), direction(35.0, 60.0)),
    ];
    for (k, alpha) in [[0.1, 0.1], [0.3, 0.1], [1.0, 1.0]].into_iter().enumerate() {
        let conductor = Conductor::new(alpha, [0.9, 0.5, 0.1]).expect("valid parameters");
        for (j, &(a, b)) in pairs.iter().enumerate() {
            let mut rng = Rng::new(&[9, k as u64, j as u64]);
            let there = Means::of(EVALS, || (conductor.eval(a, b, &mut rng) / b.z).to_array());
            let back = Means::of(EVALS, || (conductor.eval(b, a, &mut rng) / a.z).to_array());
            for i in 0..3 {
                let what = format!("channel {i} at alpha {alpha:?}, {a} and {b}");
                assert_agree(
                    (there.mean(i), there.se(i)),
                    (back.mean(i), back.se(i)),
                    0.0,
                    &what,
                );
            }
        }
    }
}

#[test]
fn propose_draws_from_pdf() {
    let models: Vec<Conductor> = [[1e-3, 1e-3], [0.01, 0.3], [0.3, 0.1], [1.0, 1.0], [0.5, 0.005]]
        .map(|alpha| Conductor::new(alpha, [1.0; 3]).expect("valid parameters"))
        .to_vec();
    let mut cases = Vec::new();
    for conductor in &models {
        for theta in [0.0, 60.0, 85.0] {
            let wo = direction(theta, 35.0);
            let frame = lobe_frame(wo, conductor.alpha);
            let name = format!("conductor {:?} {theta}", conductor.alpha);
            cases.push((name, conductor as &dyn Bsdf, wo, frame));
        }
    }
    assert_draws_follow_pdf(&cases);
}

#[test]
fn walks_fill_bins_as_eval_says() {
    let models: Vec<Conductor> = [[0.1, 0.1], [0.3, 0.1], [1.0, 1.0]]
        .map(|alpha| Conductor::new(alpha, [0.9, 0.6, 0.3]).expect("valid parameters"))
        .to_vec();
    let mut cases = Vec::new();
    for conductor in &models {
        for theta in [30.0, 80.0] {
            let wo = direction(theta, 35.0);
            let name = format!("conductor {:?} {theta}", conductor.alpha);
            cases.push((name, conductor as &dyn Bsdf, wo, lobe_frame(wo, conductor.alpha)));
        }
    }
    assert_samples_follow_eval(&cases);
}

/// Sharing walks does not bias: means over many seeds agree with plain evaluations, direction by direction.
#[test]
fn slices_agree_with_eval() {
    const SEEDS: usize = 400;
    const WALKS: usize = 64;
    const EVALS: usize = 100_000;
    for (k, alpha) in [[0.1, 0.1], [0.3, 0.1], [1.0, 1.0]].into_iter().enumerate() {
        let conductor = Conductor::new(alpha, [1.0, 0.782, 0.344]).expect("valid parameters");
        let wo = direction(60.0, 20.0);
        for (j, wi) in [
            direction(10.0, 0.0),
            direction(60.0, 210.0),
            direction(85.0, 120.0),
        ]
        .into_iter()
        .enumerate()
        {
            let mut seed = 0;
            let shared = Means::of(SEEDS, || {
                seed += 1;
                conductor.slice(wo, WALKS, seed).eval(wi).to_array()
            });
            let mut rng = Rng::new(&[15, k as u64, j as u64]);
            let plain = Means::of(EVALS, || conductor.eval(wo, wi, &mut rng).to_array());
            for c in 0..3 {
                let what = format!("channel {c} at alpha {alpha:?}, wi {j}");
                assert_agree(
                    (shared.mean(c), shared.se(c)),
                    (plain.mean(c), plain.se(c)),
                    0.0,
                    &what,
                );
            }
        }
    }
}

#[test]
fn complex_indices_reflect_as_their_fresnel_term_says() {
    const DRAWS: usize = 200_000;
    // Gold: its walks and evaluations must agree as with Schlick's term, and stay below the white furnace.
    let gold = Conductor::with_ior([0.4, 0.2], [0.143, 0.375, 1.442], [3.983, 2.386, 1.603]).expect("gold");
    for theta in [10.0, 80.0] {
        let wo = direction(theta, 30.0);
        let mut rng = Rng::new(&[16]);
        let eval = Means::of(DRAWS, || {
            let mut sum = DVec3::ZERO;
            integrate_eval(&gold, wo, &mut rng, |f, _| sum += f);
            sum.to_array()
        });
        let walk = Means::of(DRAWS, || {
            let sample = gold.sample(wo, rng.pair(), &mut rng);
            sample.map_or([0.0; 3], |s| s.weight.to_array())
        });
        for c in 0..3 {
            let what = format!("channel {c} at theta {theta}");
            assert_agree((walk.mean(c), walk.se(c)), (eval.mean(c), eval.se(c)), 0.0, &what);
            assert!(walk.mean(c) < 1.0);
        }
    }
    // A mirror smooth enough: the albedo is the Fresnel term itself.
    let smooth = Conductor {
        alpha: [Conductor::ALPHA_MIN; 2],
        ..gold
    };
    let albedo = smooth.albedo(direction(60.0, 0.0), 1 << 14, 1).mean;
    let expected = smooth.fresnel.at(0.5);
    assert!(
        (albedo / expected - 1.0).abs().max_element() < FURNACE_TOL,
        "{albedo} {expected}"
    );
}

/// Compensated single scattering has the energy that the table of E promises.
#[test]
fn compensation_conserves_energy() {
    /// Interpolation between the table's nodes, largest next to the horizon.
    const TABLE_TOL: f64 = 1e-2;
    for alpha in [[0.05, 0.05], [0.3, 0.1], [1.0, 1.0], [0.8, 0.02]] {
        let white = Conductor::new(alpha, [1.0; 3]).expect("valid parameters");
        let compensated = CompensatedConductor::new(white);
        for theta in [0.0, 40.0, 70.0, 85.0, 89.0] {
            for phi in [0.0, 33.0, 90.0] {
                let albedo = compensated.albedo(direction(theta, phi), 1 << 14, 1);
                let error = albedo.mean.x - 1.0;
                assert!(
                    error.abs() < TABLE_TOL,
                    "{error} at alpha {alpha:?}, theta {theta}, phi {phi}"
                );
            }
        }
    }
}
