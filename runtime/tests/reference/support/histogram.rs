//! The χ² test of random walks against the model's own values: the light that `sample` carries into every bin against
//! the integral of `eval` over it.
//!
//! A walk's density is not known, so bins hold sums of weights, and both sides have errors. Bins lie in the square of a
//! lobe frame placed on the lobe, where it is resolved at any roughness.

use super::chi_square::{SIGNIFICANCE, chi_square_tail, sidak};
use bake_runtime::frame::Frame;
use bake_runtime::{Bsdf, Rng};
use glam::DVec3;
use std::path::Path;

/// Bins per side.
const BINS: usize = 12;
/// Walks per test.
const WALKS: usize = 1_000_000;
/// Evaluations per bin, at random places in it.
const EVALS: usize = 8000;
/// Bins that fewer walks reach are pooled: sums of so few are not nearly normal.
const WALKS_MIN: usize = 400;

/// A sum with what its error is made of.
#[derive(Clone, Copy, Default)]
struct Sum {
    count: usize,
    sum: f64,
    square: f64,
}

impl Sum {
    fn add(&mut self, value: f64) {
        self.count += 1;
        self.sum += value;
        self.square += value * value;
    }

    /// Mean and its variance, over `n` draws of which the others were zero.
    fn mean(&self, n: usize) -> (f64, f64) {
        let n = n as f64;
        let mean = self.sum / n;
        (mean, (self.square / n - mean * mean).max(0.0) / n)
    }
}

/// Asserts for every (name, model, wo, frame) that walks carry as much green light into every bin as `eval` says, all
/// tests together at [`SIGNIFICANCE`] by Šidák's correction.
pub fn assert_samples_follow_eval(cases: &[(String, &dyn Bsdf, DVec3, Frame)]) {
    let least = sidak(SIGNIFICANCE, cases.len());
    for (case, (name, bsdf, wo, frame)) in cases.iter().enumerate() {
        let mut drawn = vec![Sum::default(); BINS * BINS];
        let mut rng = Rng::new(&[0x415, case as u64]);
        for _ in 0..WALKS {
            if let Some(sample) = bsdf.sample(*wo, rng.pair(), &mut rng) {
                let s = frame.direction_to_square(sample.wi.to_array());
                let [i, j] = s.map(|v| ((v * BINS as f64) as usize).min(BINS - 1));
                drawn[j * BINS + i].add(sample.weight.y);
            }
        }
        let evaluated: Vec<Sum> = (0..BINS * BINS)
            .map(|bin| {
                let mut sum = Sum::default();
                for _ in 0..EVALS {
                    let u = rng.pair();
                    let s = [
                        ((bin % BINS) as f64 + u[0]) / BINS as f64,
                        ((bin / BINS) as f64 + u[1]) / BINS as f64,
                    ];
                    let (wi, measure_cos) = frame.square_to_direction(s, [1.0 - s[0], 1.0 - s[1]]);
                    let f_cos = bsdf.eval(*wo, DVec3::from_array(wi), &mut rng).y;
                    sum.add(f_cos * measure_cos / wi[2] / (BINS * BINS) as f64);
                }
                sum
            })
            .collect();
        let (mut chi2, mut dof) = (0.0, 0.0);
        let mut rows = String::new();
        // (walks, evaluations) of the bins that few walks reach.
        let (mut pool, mut pooled) = ([(0.0, 0.0); 2], 0);
        for (drawn, evaluated) in drawn.iter().zip(&evaluated) {
            let (a, b) = (drawn.mean(WALKS), evaluated.mean(EVALS));
            rows += &format!("{},{},{},{}\n", a.0, a.1.sqrt(), b.0, b.1.sqrt());
            if drawn.count >= WALKS_MIN {
                chi2 += (a.0 - b.0).powi(2) / (a.1 + b.1);
                dof += 1.0;
            } else {
                for (pool, part) in pool.iter_mut().zip([a, b]) {
                    *pool = (pool.0 + part.0, pool.1 + part.1);
                }
                pooled += drawn.count;
            }
        }
        if pooled >= WALKS_MIN {
            chi2 += (pool[0].0 - pool[1].0).powi(2) / (pool[0].1 + pool[1].1);
            dof += 1.0;
        }
        let p = chi_square_tail(chi2, dof);
        if p < least {
            let evidence = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("histogram-{name}.csv"));
            std::fs::write(&evidence, rows).expect("target is writable");
            panic!(
                "{name}: χ² {chi2:.1} in {dof} bins, p {p:.1e}, at least {least:.1e} asked; walks, se, eval, se per bin in {}",
                evidence.display()
            );
        }
    }
}
