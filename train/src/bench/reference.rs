//! What the reference models cost on one thread: nanoseconds per `sample` and per `eval`, and seconds per slice.
//!
//! Times are medians of interleaved rounds, so that a drifting clock hits all rows alike.

use super::median;
use crate::Tick;
use crate::error::{Error, Result};
use crate::lobes::LUMINANCE;
use bake_runtime::bsdf::{direction, shifted_r2};
use bake_runtime::concentric::square_to_hemisphere;
use bake_runtime::conductor::{CompensatedConductor, Conductor};
use bake_runtime::family::Family;
use bake_runtime::layered::Layered;
use bake_runtime::principled::{Principled, PrincipledParameters};
use bake_runtime::{Bsdf, Rng};
use glam::DVec3;
use serde::Serialize;
use std::f64::consts::PI;
use std::hint::black_box;
use std::time::Instant;

/// Queries per timed call.
const BATCH: usize = 4096;
/// Interleaved rounds; the median counts.
const ROUNDS: usize = 15;
/// Polar angles of `wo`, degrees.
pub const THETAS: [f64; 4] = [0.0, 30.0, 60.0, 85.0];
/// Azimuth of `wo`, degrees: off the axes.
const PHI: f64 = 30.0;
/// Directions, and evaluations at each, behind the spread of `eval`.
const SPREAD_DIRECTIONS: usize = 256;
const SPREAD_EVALS: u64 = 64;
/// Directions per side of a slice.
pub const SLICE_SIDE: usize = 128;
/// Noise that a slice may have: see [`Row::slice_noise`].
pub const SLICE_NOISE: f64 = 0.01;
/// Walks of the first slice tried; they grow until the noise is low enough.
const FIRST_WALKS: usize = 64;
/// Walks at which the search gives up; the row then tells the noise reached.
const LAST_WALKS: usize = 1 << 16;
/// Pairs of slices of different seeds behind the noise: it is mostly common to all directions, so one pair says little.
const NOISE_PAIRS: u64 = 8;
/// Of the directions of a slice, the noise is measured at every so many: it hardly differs between neighbours. Odd, so
/// that it goes through all columns.
const NOISE_STRIDE: usize = 31;
/// Slices timed; the median counts.
const SLICES_TIMED: u64 = 3;
/// Key of the queries.
const KEY: u64 = 0xbe9c;

/// One model at one direction.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The family, or the name of a baseline or a variant beside it.
    pub model: &'static str,
    /// Roughness along x and y.
    pub alpha: [f64; 2],
    /// Polar angle of `wo`, degrees.
    pub theta_deg: f64,
    /// Nanoseconds per `sample`.
    pub sample_ns: f64,
    /// Variance over squared mean of the luminance weight of `sample`.
    pub sample_relvar: f64,
    /// Nanoseconds per `propose` with its `pdf`: the deterministic baseline sampler.
    pub propose_ns: f64,
    /// Nanoseconds per `eval`.
    pub eval_ns: f64,
    /// Standard deviation of one `eval` over its mean, weighed by energy; 0 where nothing is random.
    pub eval_rel_sd: f64,
    /// Seconds per slice of 128² directions on the disk, walks included.
    pub slice_seconds: f64,
    /// Noise of that slice: standard deviation over mean, weighed by energy, from pairs of seeds.
    pub slice_noise: f64,
    /// Walks that the slice shares.
    pub slice_walks: usize,
}

/// A model with its roughness.
struct Case {
    model: &'static str,
    alpha: [f64; 2],
    bsdf: Box<dyn Bsdf>,
}

/// Measures `family` and the baselines beside it.
///
/// # Errors
/// [`Error::Interrupted`] when `tick` breaks; [`bake_runtime::Error::Parameter`] for a family that has no settings of
/// its own ([`Family::Imported`]).
pub fn rows(family: Family, tick: Tick) -> Result<Vec<Row>> {
    let cases = cases(family)?;
    let places: Vec<(&Case, DVec3, f64)> = cases
        .iter()
        .flat_map(|case| THETAS.map(|theta| (case, direction(theta, PHI), theta)))
        .collect();
    let total = (ROUNDS + 1) as u64 * places.len() as u64;
    let mut done = 0;
    let mut step = || {
        done += 1;
        match tick(done, total).is_break() {
            true => Err(Error::Interrupted),
            false => Ok(()),
        }
    };
    let mut times = vec![[const { Vec::new() }; 3]; places.len()];
    for _ in 0..ROUNDS {
        for (&(case, wo, _), times) in places.iter().zip(&mut times) {
            for (all, ns) in times.iter_mut().zip(lap(case.bsdf.as_ref(), wo)) {
                all.push(ns);
            }
            step()?;
        }
    }
    let mut rows = Vec::new();
    for (&(case, wo, theta_deg), times) in places.iter().zip(&times) {
        let bsdf = case.bsdf.as_ref();
        let [sample_ns, propose_ns, eval_ns] = times.each_ref().map(|all| median(all));
        let (slice_seconds, slice_noise, slice_walks) = slice(bsdf, wo);
        rows.push(Row {
            model: case.model,
            alpha: case.alpha,
            theta_deg,
            sample_ns,
            sample_relvar: sample_relvar(bsdf, wo),
            propose_ns,
            eval_ns,
            eval_rel_sd: eval_rel_sd(bsdf, wo),
            slice_seconds,
            slice_noise,
            slice_walks,
        });
        step()?;
    }
    Ok(rows)
}

/// The models of `family`, smooth to rough: gold, a varnish, a coated plastic with some metal.
fn cases(family: Family) -> Result<Vec<Case>> {
    /// Schlick reflectance of gold.
    const GOLD: [f64; 3] = [1.0, 0.782, 0.344];
    let mut cases: Vec<Case> = Vec::new();
    match family {
        Family::Conductor => {
            for alpha in [[0.01, 0.01], [0.1, 0.1], [0.3, 0.1], [1.0, 1.0]] {
                let conductor = Conductor::new(alpha, GOLD)?;
                let compensated = Box::new(CompensatedConductor::new(conductor.clone()));
                cases.push(Case {
                    model: "conductor",
                    alpha,
                    bsdf: Box::new(conductor),
                });
                cases.push(Case {
                    model: "compensated",
                    alpha,
                    bsdf: compensated,
                });
            }
        }
        Family::Layered => {
            for (model, alpha, sigma_t, g) in [
                ("layered", 0.02, 0.8, 0.0),
                ("layered", 0.1, 0.8, 0.0),
                ("layered", 0.3, 0.8, 0.0),
                ("layered", 0.6, 5.0, 0.0),
                ("layered g=.5", 0.1, 0.8, 0.5),
            ] {
                let (albedo, base) = ([0.9, 0.6, 0.3], [0.8, 0.5, 0.2]);
                cases.push(Case {
                    model,
                    alpha: [alpha; 2],
                    bsdf: Box::new(Layered::new(alpha, 1.5, sigma_t, albedo, base, g)?),
                });
            }
        }
        Family::Principled => {
            for alpha in [0.01_f64, 0.1, 0.3, 1.0] {
                cases.push(Case {
                    model: "principled",
                    alpha: [alpha; 2],
                    bsdf: Box::new(Principled::new(PrincipledParameters {
                        base_color: DVec3::new(0.8, 0.4, 0.1),
                        roughness: alpha.sqrt(),
                        metallic: 0.3,
                        sheen: 0.3,
                        clearcoat: 0.5,
                        clearcoat_gloss: 0.5,
                        ..PrincipledParameters::default()
                    })?),
                });
            }
        }
        Family::Imported => {
            return Err(bake_runtime::Error::parameter(
                "family",
                "`imported` has no settings of its own to measure; give another family",
            )
            .into());
        }
    }
    Ok(cases)
}

/// Nanoseconds per `sample`, `propose` with `pdf`, and `eval`.
fn lap(bsdf: &dyn Bsdf, wo: DVec3) -> [f64; 3] {
    let ns = |start: Instant| start.elapsed().as_secs_f64() * 1e9 / BATCH as f64;
    let rng = |i: usize| Rng::new(&[KEY, i as u64]);
    let start = Instant::now();
    for i in 0..BATCH {
        black_box(bsdf.sample(wo, shifted_r2(i as u64, [0.0; 2]), &mut rng(i)));
    }
    let sample = ns(start);
    let mut wis = Vec::with_capacity(BATCH);
    let start = Instant::now();
    for i in 0..BATCH {
        let wi = bsdf
            .propose(wo, shifted_r2(i as u64, [0.0; 2]))
            .unwrap_or(DVec3::Z);
        black_box(bsdf.pdf(wo, wi));
        wis.push(wi);
    }
    let propose = ns(start);
    let start = Instant::now();
    for (i, wi) in wis.iter().enumerate() {
        black_box(bsdf.eval(wo, *wi, &mut rng(i)));
    }
    [sample, propose, ns(start)]
}

/// Variance over squared mean of the luminance weight of `sample`.
fn sample_relvar(bsdf: &dyn Bsdf, wo: DVec3) -> f64 {
    let (mut sum, mut square) = (0.0, 0.0);
    let n = 4 * BATCH;
    for i in 0..n {
        let mut rng = Rng::new(&[KEY, 1, i as u64]);
        let weight = bsdf
            .sample(wo, rng.pair(), &mut rng)
            .map_or(0.0, |s| s.weight.dot(LUMINANCE));
        sum += weight;
        square += weight * weight;
    }
    square * n as f64 / (sum * sum) - 1.0
}

/// Standard deviation of one `eval` over its mean, weighed by energy.
fn eval_rel_sd(bsdf: &dyn Bsdf, wo: DVec3) -> f64 {
    let (mut deviations, mut means) = (0.0, 0.0);
    for i in 0..SPREAD_DIRECTIONS {
        let Some(wi) = bsdf.propose(wo, shifted_r2(i as u64, [0.0; 2])) else {
            continue;
        };
        // Directions come with the density of the proposal, which weighs them as the integral would.
        let pdf = bsdf.pdf(wo, wi);
        let (mut sum, mut square) = (0.0, 0.0);
        for j in 0..SPREAD_EVALS {
            let value = bsdf
                .eval(wo, wi, &mut Rng::new(&[KEY, 2, i as u64, j]))
                .dot(LUMINANCE);
            sum += value;
            square += value * value;
        }
        let n = SPREAD_EVALS as f64;
        let variance = (square / n - (sum / n) * (sum / n)).max(0.0) * n / (n - 1.0);
        if pdf > 0.0 {
            deviations += variance.sqrt() / pdf;
            means += sum / n / pdf;
        }
    }
    deviations / means
}

/// Seconds, noise and walks of a slice whose noise is at most [`SLICE_NOISE`].
fn slice(bsdf: &dyn Bsdf, wo: DVec3) -> (f64, f64, usize) {
    let wis = disk_directions();
    let (walks, noise) = match bsdf.is_stochastic() {
        true => walks_for_noise(bsdf, wo, &wis),
        false => (0, 0.0),
    };
    let seconds: Vec<f64> = (0..SLICES_TIMED)
        .map(|seed| {
            let start = Instant::now();
            black_box(luminances(bsdf, wo, wis.iter(), walks, seed));
            start.elapsed().as_secs_f64()
        })
        .collect();
    (median(&seconds), noise, walks)
}

/// Luminance of f_cos at `wis`, from one slice.
fn luminances<'a>(
    bsdf: &dyn Bsdf,
    wo: DVec3,
    wis: impl Iterator<Item = &'a DVec3>,
    walks: usize,
    seed: u64,
) -> Vec<f64> {
    let slice = bsdf.slice(wo, walks, seed);
    wis.map(|wi| slice.eval(*wi).dot(LUMINANCE)).collect()
}

/// Walks whose noise is at most [`SLICE_NOISE`], and that noise, at every [`NOISE_STRIDE`]-th of `wis`.
fn walks_for_noise(bsdf: &dyn Bsdf, wo: DVec3, wis: &[DVec3]) -> (usize, f64) {
    let mut walks = FIRST_WALKS;
    loop {
        let (mut difference, mut mean) = (0.0, 0.0);
        for pair in 0..NOISE_PAIRS {
            let [a, b] = [2 * pair, 2 * pair + 1]
                .map(|seed| luminances(bsdf, wo, wis.iter().step_by(NOISE_STRIDE), walks, seed));
            difference += a.iter().zip(&b).map(|(a, b)| (a - b).abs()).sum::<f64>();
            mean += a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).sum::<f64>();
        }
        // The mean absolute difference of two normal numbers is 2/√π standard deviations.
        let noise = difference / mean * 0.5 * PI.sqrt();
        if noise <= SLICE_NOISE || walks >= LAST_WALKS {
            return (walks, noise);
        }
        // Noise falls at least as the root of the walks.
        let wanted = walks as f64 * (noise / SLICE_NOISE).powi(2);
        walks = (wanted as usize)
            .clamp(walks + walks / 4, 4 * walks)
            .min(LAST_WALKS);
    }
}

/// [`SLICE_SIDE`]² directions, even over the orthographic disk: the cell centres of the concentric square.
fn disk_directions() -> Vec<DVec3> {
    let centre = |k: usize| (k as f64 + 0.5) / SLICE_SIDE as f64;
    (0..SLICE_SIDE * SLICE_SIDE)
        .map(|k| {
            let s = [centre(k % SLICE_SIDE), centre(k / SLICE_SIDE)];
            DVec3::from_array(square_to_hemisphere(s, s.map(|v| 1.0 - v)))
        })
        .collect()
}
