//! Nanoseconds per query on one thread: medians of interleaved runs, so that a drifting clock hits all alike.
//!
//! Every round has other values of the free parameters, the same for its whole batch, as a renderer has them that goes
//! through one material after another; the reference is bound once for it, too. So the median is one over the domain.

use super::Runners;
use super::batch::{BATCH, columns, points, views};
use crate::bench::peak::Peak;
use crate::error::Result;
use crate::places::value_at;
use bake_runtime::bsdf::direction;
use bake_runtime::estimator::exact_weight;
use bake_runtime::native::Tier;
use bake_runtime::{Bsdf, Material, Rng};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::hint::black_box;
use std::time::Instant;

/// Rounds of interleaved runs; the median counts.
const ROUNDS: usize = 25;
/// Largest polar angle of the queries, degrees.
const THETA_MAX_DEG: f64 = 85.0;
/// Largest u: f32 must not round it to 1.
const U_MAX: f64 = 0.999;
/// Key of the queries.
const KEY: u64 = 0xc057;

/// Nanoseconds per query, one thread.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Always 1.
    pub threads: usize,
    /// Queries per call.
    pub batch: usize,
    /// SIMD tier.
    pub tier: String,
    /// Learned estimator.
    pub sample_learned_ns: f64,
    /// Direction with its jacobian.
    pub sample_jacobian_ns: f64,
    /// Direction with the jacobian of the exact mixture of charts.
    pub sample_mixture_ns: Option<f64>,
    /// Direction with its jacobian and the reference's f_cos.
    pub exact_total_ns: f64,
    /// Evaluation network.
    pub eval_ns: f64,
    /// Pdf network.
    pub pdf_ns: f64,
    /// The reference's own sampling, a random walk where it has no other.
    pub reference_sample_ns: f64,
    /// One evaluation of the reference, an estimate where it is stochastic.
    pub reference_eval_ns: f64,
    /// onnxruntime, learned estimator.
    pub ort_sample_ns: Option<f64>,
    /// Share of the tier's multiply-add peak, measured in the same rounds, that the layers of the learned estimator's networks
    /// take.
    pub percent_of_fma_peak: Option<f64>,
}

/// Measures the cost of every query on this thread; `macs` are the multiply-adds of the learned estimator.
///
/// # Errors
/// Whatever a backend reports.
pub(super) fn cost(material: &Material, macs: usize, runners: &Runners) -> Result<Cost> {
    let tier = Tier::named(runners.tier).ok();
    let mut rng = Rng::new(&[KEY]);
    let directions: Vec<DVec3> = (0..BATCH)
        .map(|_| direction(THETA_MAX_DEG * rng.uniform(), 360.0 * rng.uniform()))
        .collect();
    let wo: [Vec<f32>; 3] = [0, 1, 2].map(|c: usize| directions.iter().map(|w| w[c] as f32).collect());
    let u: [Vec<f32>; 2] =
        std::array::from_fn(|_| (0..BATCH).map(|_| (U_MAX * rng.uniform()) as f32).collect());
    let mut wi: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0; BATCH]);
    let mut rgb: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0; BATCH]);
    let mut scalar = vec![0.0f32; BATCH];

    let free = material.free();
    let native = runners.native;
    let mut laps = Laps::default();
    let mut peaks = Vec::new();
    for _ in 0..ROUNDS {
        if let Some(tier) = tier {
            peaks.push(Peak::measure(tier)?);
        }
        let values = free
            .iter()
            .map(|(label, min, max)| value_at(label, *min, *max, rng.uniform()));
        let values: Vec<f64> = values.collect();
        let bsdf = material.bind(&values)?;
        let params: Vec<[f32; 1]> = values.iter().map(|v| [*v as f32]).collect();
        let params = columns(&params);
        let (points, u) = (points(&params, &wo), views(&u));
        let [x, y, z] = wi.each_mut().map(|c| c.as_mut_slice());
        let [r, g, b] = rgb.each_mut().map(|c| c.as_mut_slice());
        laps.time(0, || {
            native.sample_learned(
                points,
                u,
                [&mut *x, &mut *y, &mut *z],
                [&mut *r, &mut *g, &mut *b],
            )
        })?;
        laps.time(1, || {
            native.sample_jacobian(points, u, [&mut *x, &mut *y, &mut *z], &mut scalar)
        })?;
        laps.time(2, || {
            native.eval(points, [&*x, &*y, &*z], [&mut *r, &mut *g, &mut *b])
        })?;
        laps.time(3, || native.pdf(points, [&*x, &*y, &*z], &mut scalar))?;
        laps.time(4, || {
            for (i, wo) in directions.iter().enumerate() {
                let u = u.map(|c| f64::from(c[i]));
                black_box(bsdf.sample(*wo, u, &mut Rng::new(&[KEY, i as u64])));
            }
            Ok(())
        })?;
        laps.time(5, || {
            for (i, wo) in directions.iter().enumerate() {
                let wi = DVec3::new(x[i].into(), y[i].into(), z[i].into());
                black_box(bsdf.eval(*wo, wi, &mut Rng::new(&[KEY, i as u64])));
            }
            Ok(())
        })?;
        laps.time(6, || {
            native.sample_jacobian(points, u, [&mut *x, &mut *y, &mut *z], &mut scalar)?;
            for (i, wo) in directions.iter().enumerate() {
                let wi = DVec3::new(x[i].into(), y[i].into(), z[i].into());
                let mut rng = Rng::new(&[KEY, i as u64]);
                black_box(exact_weight(&bsdf, *wo, wi, scalar[i].into(), &mut rng));
            }
            Ok(())
        })?;
        if let Some(ort) = runners.ort {
            laps.time(7, || {
                ort.sample_learned(
                    points,
                    u,
                    [&mut *x, &mut *y, &mut *z],
                    [&mut *r, &mut *g, &mut *b],
                )
            })?;
        }
        if let Some(mixture) = runners.mixture {
            laps.time(8, || {
                mixture(points, u, [&mut *x, &mut *y, &mut *z], &mut scalar).map(|_| ())
            })?;
        }
    }
    let gflops = laps.median_ns(0).map(|ns| 2.0 * macs as f64 / ns);
    let peak = (!peaks.is_empty()).then(|| Peak::highest(&peaks).gflops);
    let ns = |k: usize| laps.median_ns(k).unwrap_or(f64::NAN);
    Ok(Cost {
        threads: 1,
        batch: BATCH,
        tier: runners.tier.to_string(),
        sample_learned_ns: ns(0),
        sample_jacobian_ns: ns(1),
        sample_mixture_ns: laps.median_ns(8),
        eval_ns: ns(2),
        pdf_ns: ns(3),
        reference_sample_ns: ns(4),
        reference_eval_ns: ns(5),
        exact_total_ns: ns(6),
        ort_sample_ns: laps.median_ns(7),
        percent_of_fma_peak: peak.zip(gflops).map(|(peak, gflops)| 100.0 * gflops / peak),
    })
}

/// Seconds of every round of every kind of query.
#[derive(Default)]
struct Laps([Vec<f64>; 9]);

impl Laps {
    fn time(
        &mut self,
        kind: usize,
        run: impl FnOnce() -> bake_runtime::Result<()>,
    ) -> bake_runtime::Result<()> {
        let start = Instant::now();
        run()?;
        self.0[kind].push(start.elapsed().as_secs_f64());
        Ok(())
    }

    /// Median over the rounds, per query; `None` where there were none.
    fn median_ns(&self, kind: usize) -> Option<f64> {
        let mut all = self.0[kind].clone();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).map(|s| s * 1e9 / BATCH as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::card::fake::{Damage, Fake, vase};
    use bake_runtime::{Backend, Points};
    use serde_json::Value;

    #[test]
    fn every_key_is_a_number_or_null_where_nothing_runs() {
        let material = vase();
        let fake = Fake::new(&material, Damage::None);
        let mixture = |points: Points, u: [&[f32]; 2], wi: [&mut [f32]; 3], jacobian: &mut [f32]| {
            fake.sample_jacobian(points, u, wi, jacobian)?;
            Ok(0)
        };
        let alone = Runners {
            tier: "none",
            native: &fake,
            ort: None,
            mixture: None,
        };
        let with_others = Runners {
            ort: Some(&fake),
            mixture: Some(&mixture),
            ..alone
        };
        let on_a_tier = Runners {
            tier: "portable",
            ..with_others
        };
        for (runners, nulls) in [
            (
                alone,
                &["ort_sample_ns", "percent_of_fma_peak", "sample_mixture_ns"][..],
            ),
            (with_others, &["percent_of_fma_peak"]),
            (on_a_tier, &[]),
        ] {
            let found = cost(&material, 1000, &runners).expect("it runs");
            assert_eq!(
                (found.threads, found.batch, &found.tier[..]),
                (1, BATCH, runners.tier)
            );
            let Ok(Value::Object(keys)) = serde_json::to_value(&found) else {
                panic!("no object: {found:?}");
            };
            let mut null = Vec::new();
            let mut timed = 0;
            for (key, value) in &keys {
                match value.as_f64() {
                    _ if value.is_null() => null.push(key.as_str()),
                    // Infinite ones would be null as well.
                    Some(ns) if key.ends_with("_ns") => {
                        assert!(ns > 0.0, "{key}: {ns}");
                        timed += 1;
                    }
                    _ => {}
                }
            }
            null.sort_unstable();
            assert_eq!(null, nulls);
            assert_eq!(timed, 9 - nulls.iter().filter(|key| key.ends_with("_ns")).count());
        }
    }
}
