//! What the model must integrate to: white furnace, walks that average to the integral of `eval`, reciprocity,
//! normalised and sampled pdf, and slices that share their walks.

use super::{SETTINGS, Setting};
use crate::support::draws::assert_draws_follow_pdf;
use crate::support::histogram::assert_samples_follow_eval;
use crate::support::quadrature::{QUADRATURE_TOL, hemisphere};
use crate::support::{Means, ROUND_OFF, assert_agree, direction, lobe_frame};
use bake_runtime::layered::Layered;
use bake_runtime::microfacet::{mirror_pdf, sample_mirror};
use bake_runtime::{Bsdf, Rng};
use glam::DVec3;
use std::f64::consts::PI;

/// Slack of the white furnace beside the standard errors: one tenth of a percent of light is not seen.
const FURNACE_TOL: f64 = 1e-3;
/// Largest standard error with which the furnace still says something about one percent of light.
const FURNACE_SE_MAX: f64 = 4e-3;
/// Standard errors allowed where hundreds of comparisons are made: one of 300 exceeds 4 by chance in 1 of 50 runs, and
/// the seeds are fixed.
const MANY_SIGMAS: f64 = 4.0;

/// A direction of density half cos θ/π, half uniform, and that density, sr⁻¹: next to the horizon a slab is brighter
/// than the cosine alone would sample well.
fn draw_direction(rng: &mut Rng) -> (DVec3, f64) {
    let u = rng.pair();
    let (y, x) = (2.0 * PI * u[1]).sin_cos();
    let z = if rng.uniform() < 0.5 {
        (1.0 - u[0]).sqrt()
    } else {
        1.0 - u[0]
    };
    let r = (1.0 - z * z).max(0.0).sqrt();
    (DVec3::new(r * x, r * y, z), (0.5 * z + 0.25) / PI)
}

/// One estimate of ∫ f_cos·g dω, where `add(f, wi)` is called with every f: the reflection over the visible normals,
/// the rest over all directions.
fn integrate_eval(
    layered: &Layered,
    alpha: f64,
    wo: DVec3,
    rng: &mut Rng,
    mut add: impl FnMut(DVec3, DVec3),
) {
    let wi = sample_mirror(wo, [alpha; 2], rng.pair()).expect("wo is above the horizon");
    let pdf = mirror_pdf(wo, wi, [alpha; 2]);
    add(DVec3::splat(layered.reflection(wo, wi) / pdf), wi);
    let (wi, pdf) = draw_direction(rng);
    add(layered.body(wo, wi, rng) / pdf, wi);
}

#[test]
fn white_furnace_by_integrating_eval() {
    for (k, (sigma_t, draws)) in [(0.0, 100_000), (0.3, 150_000), (5.0, 150_000), (50.0, 60_000)]
        .into_iter()
        .enumerate()
    {
        for (j, g) in [0.0, 0.7].into_iter().enumerate() {
            let layered = Layered::new(0.3, 1.0, sigma_t, [1.0; 3], [1.0; 3], g).expect("valid parameters");
            for (i, theta) in [0.0, 60.0, 89.9].into_iter().enumerate() {
                let mut rng = Rng::new(&[33, k as u64, j as u64, i as u64]);
                // Next to the horizon walks are short, and their light is bright where few directions are drawn.
                let draws = if theta > 89.0 && g > 0.0 { 400_000 } else { draws };
                let albedo = Means::of(draws, || {
                    let mut sum = 0.0;
                    integrate_eval(&layered, 0.3, direction(theta, 10.0), &mut rng, |f, _| sum += f.x);
                    [sum]
                });
                let what = format!("albedo at sigma_t {sigma_t}, g {g}, theta {theta}");
                let found = (albedo.mean(0), albedo.se(0));
                assert!(found.1 < FURNACE_SE_MAX, "{what}: standard error {}", found.1);
                assert_agree(found, (1.0, 0.0), FURNACE_TOL, &what);
            }
        }
    }
}

/// Compares the three channels and the direction of the reddest light.
#[test]
fn walks_average_to_the_integral_of_eval() {
    const DRAWS: usize = 100_000;
    let moments = |f: DVec3, wi: DVec3| [f.x, f.y, f.z, f.x * wi.x, f.x * wi.y, f.x * wi.z];
    for (k, setting) in SETTINGS.iter().enumerate() {
        let layered = setting.layered();
        for (j, theta) in [0.0, 50.0, 85.0, 89.0].into_iter().enumerate() {
            let wo = direction(theta, 200.0);
            let mut rng = Rng::new(&[34, k as u64, j as u64]);
            let eval = Means::of(DRAWS, || {
                let mut sum = [0.0; 6];
                integrate_eval(&layered, setting.1, wo, &mut rng, |f, wi| {
                    sum.iter_mut()
                        .zip(moments(f, wi))
                        .for_each(|(s, moment)| *s += moment);
                });
                sum
            });
            let walk = Means::of(2 * DRAWS, || {
                let sample = layered.sample(wo, rng.pair(), &mut rng);
                sample.map_or([0.0; 6], |s| moments(s.weight, s.wi))
            });
            for i in 0..6 {
                let what = format!("moment {i} of {} at theta {theta}", setting.0);
                let sigma = walk.se(i).hypot(eval.se(i));
                let difference = (walk.mean(i) - eval.mean(i)).abs();
                assert!(
                    difference <= MANY_SIGMAS * sigma,
                    "{what}: {} ± {} and {} ± {}",
                    walk.mean(i),
                    walk.se(i),
                    eval.mean(i),
                    eval.se(i)
                );
            }
        }
    }
}

#[test]
fn eval_is_reciprocal_on_average() {
    const EVALS: usize = 100_000;
    let pairs = [
        (direction(20.0, 10.0), direction(60.0, 170.0)),
        (direction(85.0, 100.0), direction(40.0, -75.0)),
        (direction(89.0, 45.0), direction(80.0, 60.0)),
    ];
    for (k, setting) in SETTINGS.iter().enumerate() {
        let layered = setting.layered();
        for (j, &(a, b)) in pairs.iter().enumerate() {
            let mut rng = Rng::new(&[35, k as u64, j as u64]);
            let there = Means::of(EVALS, || (layered.eval(a, b, &mut rng) / b.z).to_array());
            let back = Means::of(EVALS, || (layered.eval(b, a, &mut rng) / a.z).to_array());
            for c in 0..3 {
                let sigma = there.se(c).hypot(back.se(c));
                let difference = (there.mean(c) - back.mean(c)).abs();
                assert!(
                    difference <= MANY_SIGMAS * sigma + ROUND_OFF * there.mean(c),
                    "channel {c} of {}, pair {j}: {} and {} ± {sigma}",
                    setting.0,
                    there.mean(c),
                    back.mean(c)
                );
            }
        }
    }
}

/// The density of walks, weighed by a test function, against the walks themselves.
#[test]
fn the_stochastic_pdf_is_the_density_of_sample() {
    const DRAWS: usize = 200_000;
    // Roulette is not part of the density; without colours it is never played.
    for (k, &(alpha, eta, sigma_t, g)) in [(0.3, 1.5, 0.8, 0.0), (0.6, 1.3, 2.0, 0.5), (0.2, 1.0, 1.0, 0.0)]
        .iter()
        .enumerate()
    {
        let layered = Layered::new(alpha, eta, sigma_t, [1.0; 3], [1.0; 3], g).expect("valid parameters");
        for theta in [10.0, 75.0] {
            let wo = direction(theta, 0.0);
            let mut rng = Rng::new(&[36, k as u64]);
            let moments = |wi: DVec3| [1.0, wi.x, wi.z, wi.x * wi.x];
            let density = Means::of(DRAWS, || {
                let wi = layered.propose(wo, rng.pair()).expect("wo is above the horizon");
                let share = layered.pdf_stochastic(wo, wi, &mut rng) / layered.pdf(wo, wi);
                moments(wi).map(|m| m * share)
            });
            let drawn = Means::of(DRAWS, || {
                let sample = layered.sample(wo, rng.pair(), &mut rng);
                sample.map_or([0.0; 4], |s| moments(s.wi))
            });
            for i in 0..4 {
                let what = format!("moment {i} at alpha {alpha}, eta {eta}, theta {theta}");
                assert_agree(
                    (density.mean(i), density.se(i)),
                    (drawn.mean(i), drawn.se(i)),
                    0.0,
                    &what,
                );
            }
        }
    }
}

#[test]
fn pdf_integrates_to_one() {
    const SIDE: usize = 1000;
    for setting in &SETTINGS {
        let layered = setting.layered();
        for theta in [0.0, 60.0, 89.0, 89.99] {
            let wo = direction(theta, 30.0);
            let [integral] = hemisphere(wo, [setting.1; 2], SIDE, |wi| [layered.pdf(wo, wi)]);
            assert!(
                (integral - 1.0).abs() < QUADRATURE_TOL,
                "pdf of {} at theta {theta} integrates to {integral}",
                setting.0
            );
        }
    }
}

#[test]
fn propose_draws_from_pdf() {
    let models: Vec<(&Setting, Layered)> = SETTINGS.iter().map(|s| (s, s.layered())).collect();
    let mut cases = Vec::new();
    for (Setting(name, alpha, ..), layered) in models.iter().filter(|(s, _)| s.0 != "thick" && s.0 != "back")
    {
        for theta in [30.0, 80.0] {
            let wo = direction(theta, 20.0);
            let frame = lobe_frame(wo, [*alpha; 2]);
            cases.push((format!("layered {name} {theta}"), layered as &dyn Bsdf, wo, frame));
        }
    }
    assert_draws_follow_pdf(&cases);
}

#[test]
fn walks_fill_bins_as_eval_says() {
    let chosen = ["rough", "very rough", "no interface", "ahead", "thinner than air"];
    let models: Vec<(&Setting, Layered)> = SETTINGS
        .iter()
        .filter(|s| chosen.contains(&s.0))
        .map(|s| (s, s.layered()))
        .collect();
    let mut cases = Vec::new();
    for (Setting(name, alpha, ..), layered) in &models {
        for theta in [20.0, 75.0] {
            let wo = direction(theta, 20.0);
            // Light out of the slab goes everywhere: a broad frame serves both.
            let frame = lobe_frame(wo, [alpha.max(0.5); 2]);
            cases.push((format!("layered {name} {theta}"), layered as &dyn Bsdf, wo, frame));
        }
    }
    assert_samples_follow_eval(&cases);
}

/// Sharing walks does not bias: means over many seeds agree with plain evaluations, direction by direction.
#[test]
fn slices_agree_with_eval() {
    const SEEDS: u64 = 256;
    const WALKS: usize = 64;
    const EVALS: usize = 50_000;
    for (k, setting) in SETTINGS.iter().enumerate().filter(|(_, s)| s.0 != "thick") {
        let layered = setting.layered();
        let wo = direction(50.0, 0.0);
        let wis = [
            direction(10.0, 0.0),
            direction(50.0, 175.0),
            direction(85.0, 90.0),
        ];
        let mut seed = 0;
        let shared = Means::<9>::of(SEEDS as usize, || {
            let slice = layered.slice(wo, WALKS, seed);
            seed += 1;
            let values = wis.map(|wi| slice.eval(wi).to_array());
            std::array::from_fn(|i| values[i / 3][i % 3])
        });
        for (i, &wi) in wis.iter().enumerate() {
            let mut rng = Rng::new(&[37, k as u64, i as u64]);
            let plain = Means::of(EVALS, || layered.eval(wo, wi, &mut rng).to_array());
            for c in 0..3 {
                let sigma = shared.se(3 * i + c).hypot(plain.se(c));
                let difference = (shared.mean(3 * i + c) - plain.mean(c)).abs();
                assert!(
                    difference <= MANY_SIGMAS * sigma + ROUND_OFF * plain.mean(c),
                    "channel {c} of {}, wi {i}: {} and {} ± {sigma}",
                    setting.0,
                    shared.mean(3 * i + c),
                    plain.mean(c)
                );
            }
        }
    }
}
