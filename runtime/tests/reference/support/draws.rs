//! The χ² test of drawn directions against the density that they claim.
//!
//! Bins lie where the lobe is: in the square of a lobe frame placed on it, and on the disk. Both tests see each
//! direction once. Evidence of a failure is written under `target/`.

use super::chi_square::{SIGNIFICANCE, chi_square, sidak};
use bake_runtime::frame::Frame;
use bake_runtime::{Bsdf, Rng};
use glam::DVec3;
use std::path::Path;

/// Bins per side.
const BINS: usize = 48;
/// Bins along the edge of a frame's square that count as one: densities change there with the root of the distance.
const EDGE: usize = 2;
/// Midpoints per side of a bin; the density error of one lies well below what 10⁶ draws resolve.
const SUB: usize = 12;
/// Draws per test.
const DRAWS: u64 = 1_000_000;

/// Asserts that `propose` of every (name, model, wo, frame) draws from `pdf`, all tests together at
/// [`SIGNIFICANCE`] by Šidák's correction.
pub fn assert_draws_follow_pdf(cases: &[(String, &dyn Bsdf, DVec3, Frame)]) {
    let least = sidak(SIGNIFICANCE, 2 * cases.len());
    for (name, bsdf, wo, frame) in cases {
        let coordinates = [(*frame, EDGE, "lobe"), (Frame::IDENTITY, EDGE, "disk")];
        let mut counts = [vec![0u64; BINS * BINS], vec![0u64; BINS * BINS]];
        let mut rng = Rng::new(&[0xc412]);
        for _ in 0..DRAWS {
            let wi = bsdf.propose(*wo, rng.pair()).expect("wo is above the horizon");
            for ((frame, edge, _), counts) in coordinates.iter().zip(&mut counts) {
                let s = frame.direction_to_square(wi.to_array());
                let [i, j] = s.map(|v| ((v * BINS as f64) as usize).min(BINS - 1));
                if [i, j].iter().all(|k| (*edge..BINS - edge).contains(k)) {
                    counts[j * BINS + i] += 1;
                }
            }
        }
        for ((frame, edge, label), counts) in coordinates.iter().zip(&counts) {
            // The disk does not resolve a lobe: only bins that its peak leaves alone can be integrated there.
            let mass: Vec<f64> = (0..BINS * BINS)
                .map(|k| {
                    let (i, j) = (k % BINS, k / BINS);
                    match [i, j].iter().all(|k| (*edge..BINS - edge).contains(k)) {
                        true => bin_mass(*bsdf, *wo, frame, [i, j]),
                        false => 0.0,
                    }
                })
                .collect();
            // What a bin cannot be integrated to, and the edge, is one more bin: the rest of all draws.
            let resolved = |k: usize, m: f64| *label == "lobe" || is_resolved(*bsdf, *wo, frame, k, m);
            let (mut expected, mut found) = (Vec::new(), Vec::new());
            for (k, (m, count)) in mass.into_iter().zip(counts).enumerate() {
                if m > 0.0 && resolved(k, m) {
                    expected.push(m * DRAWS as f64);
                    found.push(*count);
                }
            }
            expected.push((DRAWS as f64 - expected.iter().sum::<f64>()).max(0.0));
            found.push(DRAWS - found.iter().sum::<u64>());
            let p = chi_square(&expected, &found);
            if p < least {
                let evidence =
                    Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("chi2-{name}-{label}.csv"));
                let rows: String = expected
                    .iter()
                    .zip(&found)
                    .map(|(expected, found)| format!("{expected},{found}\n"))
                    .collect();
                std::fs::write(&evidence, rows).expect("target is writable");
                panic!(
                    "{name}, {label}: p {p:.1e}, at least {least:.1e} asked; expected,found per bin in {}",
                    evidence.display()
                );
            }
        }
    }
}

/// Probability of a bin of `frame`'s square by midpoints.
fn bin_mass(bsdf: &dyn Bsdf, wo: DVec3, frame: &Frame, bin: [usize; 2]) -> f64 {
    integrate(bsdf, wo, frame, bin, SUB)
}

/// Whether halving the steps of the quadrature leaves the mass of bin `k` where it was, within half of the standard
/// deviation of its count.
fn is_resolved(bsdf: &dyn Bsdf, wo: DVec3, frame: &Frame, k: usize, mass: f64) -> bool {
    let finer = integrate(bsdf, wo, frame, [k % BINS, k / BINS], 2 * SUB);
    (finer - mass).abs() * (DRAWS as f64).sqrt() < 0.2 * mass.max(0.0).sqrt()
}

fn integrate(bsdf: &dyn Bsdf, wo: DVec3, frame: &Frame, bin: [usize; 2], sub: usize) -> f64 {
    let mut sum = 0.0;
    for k in 0..sub * sub {
        let s = [
            (bin[0] as f64 + ((k % sub) as f64 + 0.5) / sub as f64) / BINS as f64,
            (bin[1] as f64 + ((k / sub) as f64 + 0.5) / sub as f64) / BINS as f64,
        ];
        let (wi, measure_cos) = frame.square_to_direction(s, [1.0 - s[0], 1.0 - s[1]]);
        sum += bsdf.pdf(wo, DVec3::from_array(wi)) * measure_cos / wi[2];
    }
    sum / (sub * sub * BINS * BINS) as f64
}
