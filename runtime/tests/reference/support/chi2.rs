//! The χ² test of drawn directions against the density that they claim.
//!
//! Bins lie where the lobe is: in the square of a lobe frame placed on it, and on the disk. Both tests see each
//! direction once. Evidence of a failure is written under `target/`.

use bake_runtime::frame::Frame;
use bake_runtime::{Bsdf, Rng};
use glam::DVec3;
use std::path::Path;

/// Probability with which a right sampler fails one call of [`assert_draws_follow_pdf`]'s whole family of tests.
pub const SIGNIFICANCE: f64 = 0.01;
/// Bins per side.
const BINS: usize = 48;
/// Bins along the edge of a frame's square that count as one: densities change there with the root of the distance.
const EDGE: usize = 2;
/// Midpoints per side of a bin; the density error of one lies well below what 10⁶ draws resolve.
const SUB: usize = 12;
/// Bins with fewer expected draws are merged, as the distribution of χ² asks.
const EXPECTED_MIN: f64 = 20.0;
/// Draws per test.
const DRAWS: u64 = 1_000_000;

/// Standard normal deviate that χ² with `dof` degrees of freedom corresponds to (Wilson and Hilferty 1931); its error
/// is below 0.01 for the hundreds of degrees of freedom here.
fn deviate(chi2: f64, dof: f64) -> f64 {
    let spread = 2.0 / (9.0 * dof);
    ((chi2 / dof).cbrt() - (1.0 - spread)) / spread.sqrt()
}

/// Deviate that a standard normal number exceeds with probability `tail` (Abramowitz and Stegun 1964, 26.2.23; error
/// below 4.5e-4).
fn upper_deviate(tail: f64) -> f64 {
    let t = (-2.0 * tail.ln()).sqrt();
    t - (2.515517 + t * (0.802853 + t * 0.010328)) / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308)))
}

/// χ² deviate of `counts` of `draws` against the probabilities `mass`; what lies in neither is one more bin.
fn test(mass: &[f64], counts: &[u64], draws: u64) -> f64 {
    let n = draws as f64;
    let (mut chi2, mut bins) = (0.0, 0.0);
    let (mut merged_expected, mut merged_found) = (n, n);
    for (m, c) in mass.iter().zip(counts) {
        let (expected, found) = (m * n, *c as f64);
        if expected >= EXPECTED_MIN {
            chi2 += (found - expected).powi(2) / expected;
            bins += 1.0;
            merged_expected -= expected;
            merged_found -= found;
        }
    }
    if merged_expected >= EXPECTED_MIN {
        chi2 += (merged_found - merged_expected).powi(2) / merged_expected;
        bins += 1.0;
    } else if merged_found > 2.0 * EXPECTED_MIN {
        return f64::INFINITY;
    }
    deviate(chi2, (bins - 1.0_f64).max(1.0))
}

/// Asserts that `propose` of every (name, model, wo, frame) draws from `pdf`, all tests together at
/// [`SIGNIFICANCE`] by Šidák's correction.
pub fn assert_draws_follow_pdf(cases: &[(String, &dyn Bsdf, DVec3, Frame)]) {
    let tests = 2.0 * cases.len() as f64;
    let limit = upper_deviate(1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / tests));
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
            let smooth: Vec<f64> = match *label {
                "disk" => mass
                    .iter()
                    .enumerate()
                    .map(|(k, m)| {
                        if is_resolved(*bsdf, *wo, frame, k, *m) {
                            *m
                        } else {
                            0.0
                        }
                    })
                    .collect(),
                _ => mass,
            };
            let found = test(&smooth, counts, DRAWS);
            if found > limit {
                let evidence =
                    Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("chi2-{name}-{label}.csv"));
                let rows: String = smooth
                    .iter()
                    .zip(counts)
                    .map(|(m, c)| format!("{},{c}\n", m * DRAWS as f64))
                    .collect();
                std::fs::write(&evidence, rows).expect("target is writable");
                panic!(
                    "{name}, {label}: {found:.1} standard deviations, at most {limit:.1} allowed; expected,found per bin in {}",
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_test_itself_passes_and_fails() {
        let n = 100_000u64;
        let mass = vec![1.0 / 64.0; 64];
        let draw = |skew: f64| {
            let mut counts = vec![0u64; 64];
            let mut rng = Rng::new(&[0xbad]);
            for _ in 0..n {
                counts[((rng.uniform().powf(1.0 + skew)) * 64.0) as usize] += 1;
            }
            counts
        };
        let limit = upper_deviate(SIGNIFICANCE);
        assert!(test(&mass, &draw(0.0), n) < limit);
        assert!(test(&mass, &draw(0.03), n) > limit);
    }
}
