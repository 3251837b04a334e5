//! Nanoseconds per query on one thread: medians of interleaved runs, so that a drifting clock hits all alike.

use super::Cost;
use super::measure::BackendFactory;
use crate::error::Result;
use bake_runtime::bsdf::direction;
use bake_runtime::conductor::Conductor;
use bake_runtime::estimator::exact_weight;
use bake_runtime::{Bsdf, Points, Rng};
use glam::DVec3;
use std::hint::black_box;
use std::time::Instant;

/// Queries per call.
const BATCH: usize = 4096;
/// Rounds of interleaved runs; the median counts.
const ROUNDS: usize = 25;
/// Largest polar angle of the queries, degrees.
const THETA_MAX_DEG: f64 = 85.0;
/// Key of the queries.
const KEY: u64 = 0xc057;

/// Measures the cost of every query on this thread.
///
/// # Errors
/// Whatever a backend reports.
pub fn cost(
    bsdf: &Conductor,
    tier: &str,
    native: BackendFactory,
    ort: Option<BackendFactory>,
) -> Result<Cost> {
    let mut rng = Rng::new(&[KEY]);
    let directions: Vec<DVec3> = (0..BATCH)
        .map(|_| direction(THETA_MAX_DEG * rng.uniform(), 360.0 * rng.uniform()))
        .collect();
    let column = |c: usize| directions.iter().map(|w| w[c] as f32).collect::<Vec<f32>>();
    let wo = [column(0), column(1), column(2)];
    let u: [Vec<f32>; 2] =
        std::array::from_fn(|_| (0..BATCH).map(|_| rng.uniform() as f32 * 0.999).collect());
    let wo = wo.each_ref().map(|c| c.as_slice());
    let u = u.each_ref().map(|c| c.as_slice());
    let mut wi: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0; BATCH]);
    let mut rgb: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0; BATCH]);
    let mut scalar = vec![0.0f32; BATCH];

    let mut native = native()?;
    let mut ort = ort.map(|make| make()).transpose()?;
    let mut seconds: [Vec<f64>; 8] = Default::default();
    for _ in 0..ROUNDS {
        let mut laps = Vec::with_capacity(seconds.len());
        let mut lap = |start: Instant| laps.push(start.elapsed().as_secs_f64());
        let [x, y, z] = wi.each_mut().map(|c| c.as_mut_slice());
        let [r, g, b] = rgb.each_mut().map(|c| c.as_mut_slice());
        let start = Instant::now();
        native.sample_learned(
            Points::fixed(wo),
            u,
            [&mut *x, &mut *y, &mut *z],
            [&mut *r, &mut *g, &mut *b],
        )?;
        lap(start);
        let start = Instant::now();
        native.sample_jacobian(Points::fixed(wo), u, [&mut *x, &mut *y, &mut *z], &mut scalar)?;
        lap(start);
        let start = Instant::now();
        native.eval(Points::fixed(wo), [&*x, &*y, &*z], [&mut *r, &mut *g, &mut *b])?;
        lap(start);
        let start = Instant::now();
        native.pdf(Points::fixed(wo), [&*x, &*y, &*z], &mut scalar)?;
        lap(start);
        let start = Instant::now();
        for (i, wo) in directions.iter().enumerate() {
            let u = [f64::from(u[0][i]), f64::from(u[1][i])];
            black_box(bsdf.sample(*wo, u, &mut Rng::new(&[KEY, i as u64])));
        }
        lap(start);
        let start = Instant::now();
        for (i, wo) in directions.iter().enumerate() {
            let wi = DVec3::new(x[i].into(), y[i].into(), z[i].into());
            black_box(bsdf.eval(*wo, wi, &mut Rng::new(&[KEY, i as u64])));
        }
        lap(start);
        let start = Instant::now();
        native.sample_jacobian(Points::fixed(wo), u, [&mut *x, &mut *y, &mut *z], &mut scalar)?;
        for (i, wo) in directions.iter().enumerate() {
            let wi = DVec3::new(x[i].into(), y[i].into(), z[i].into());
            let mut rng = Rng::new(&[KEY, i as u64]);
            black_box(exact_weight(bsdf, *wo, wi, scalar[i].into(), &mut rng));
        }
        lap(start);
        if let Some(ort) = &mut ort {
            let start = Instant::now();
            ort.sample_learned(
                Points::fixed(wo),
                u,
                [&mut *x, &mut *y, &mut *z],
                [&mut *r, &mut *g, &mut *b],
            )?;
            lap(start);
        }
        seconds.iter_mut().zip(laps).for_each(|(all, lap)| all.push(lap));
    }
    let median = |k: usize| {
        let mut all = seconds[k].clone();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).map(|s| s * 1e9 / BATCH as f64)
    };
    let ns = |k: usize| median(k).unwrap_or(f64::NAN);
    Ok(Cost {
        threads: 1,
        batch: BATCH,
        tier: tier.to_string(),
        sample_learned_ns: ns(0),
        sample_jacobian_ns: ns(1),
        eval_ns: ns(2),
        pdf_ns: ns(3),
        reference_sample_ns: ns(4),
        reference_eval_ns: ns(5),
        exact_total_ns: ns(6),
        ort_sample_ns: median(7),
        percent_of_fma_peak: None,
    })
}
