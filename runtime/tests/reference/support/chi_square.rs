//! χ² of counts against expected counts, and the significance of one test among several.

use std::f64::consts::TAU;

/// Probability that a right program fails one family of statistical tests, all its cases together.
pub const SIGNIFICANCE: f64 = 0.01;

/// Least expected count for which a bin's count is nearly normal; emptier bins are pooled.
const EXPECTED_MIN: f64 = 10.0;

/// Largest probability that one of `tests` independent tests may report by chance, so that all of them together
/// fail with probability `significance` (Šidák 1967).
pub fn sidak(significance: f64, tests: usize) -> f64 {
    1.0 - (1.0 - significance).powf(1.0 / tests as f64)
}

/// Probability that counts of these expectations are at least as far from them as `counts` (Pearson 1900).
///
/// The sum of the counts is taken as given, which costs one degree of freedom.
pub fn chi_square(expected: &[f64], counts: &[u64]) -> f64 {
    assert_eq!(expected.len(), counts.len());
    let (mut chi2, mut bins) = (0.0, 0.0);
    let mut add = |expected: f64, count: f64| {
        chi2 += (count - expected).powi(2) / expected;
        bins += 1.0;
    };
    let mut pool = (0.0, 0.0);
    for (&expected, &count) in expected.iter().zip(counts) {
        match expected < EXPECTED_MIN {
            true => pool = (pool.0 + expected, pool.1 + count as f64),
            false => add(expected, count as f64),
        }
    }
    // A pool that is too small to be tested alone still must not hide counts that nothing explains.
    if pool.0 > 0.0 || pool.1 > 0.0 {
        add(pool.0.max(1.0), pool.1);
    }
    chi_square_tail(chi2, bins - 1.0)
}

/// Probability that χ² of `dof` degrees of freedom exceeds `chi2`, by the cube root that is nearly normal (Wilson
/// and Hilferty 1931), good to a few percent of itself from ten degrees up.
pub fn chi_square_tail(chi2: f64, dof: f64) -> f64 {
    let spread = 2.0 / (9.0 * dof);
    normal_tail(((chi2 / dof).cbrt() - (1.0 - spread)) / spread.sqrt())
}

/// Probability that a standard normal variate exceeds `z`.
pub fn normal_tail(z: f64) -> f64 {
    // Midpoints up to where nothing is left of the density.
    let (steps, end) = (20_000, 12.0);
    let step = (end - z.clamp(-end, end)) / f64::from(steps);
    let density = |t: f64| (-0.5 * t * t).exp() / TAU.sqrt();
    (0..steps)
        .map(|k| density(end - (f64::from(k) + 0.5) * step) * step)
        .sum()
}

#[test]
fn tails_are_those_of_tables() {
    /// Of the quantiles, which are printed to six digits, and of the approximation.
    const TAIL_TOL: f64 = 0.03;
    // Quantiles of χ² with 100 degrees of freedom (Abramowitz and Stegun 1964, Table 26.8).
    for (chi2, p) in [(99.3341, 0.5), (118.498, 0.1), (135.807, 0.01), (149.449, 0.001)] {
        let found = chi_square_tail(chi2, 100.0);
        assert!(
            (found / p - 1.0).abs() < TAIL_TOL,
            "{found} at {chi2}, expected {p}"
        );
    }
    for (z, p) in [
        (-1.0, 0.841_345),
        (0.0, 0.5),
        (2.326_348, 0.01),
        (3.090_232, 0.001),
    ] {
        let found = normal_tail(z);
        assert!((found / p - 1.0).abs() < TAIL_TOL, "{found} at {z}, expected {p}");
    }
}

#[test]
fn a_wrong_density_is_found() {
    const PLAUSIBLE: f64 = 0.5;
    const IMPOSSIBLE: f64 = 1e-6;
    let expected = vec![1000.0; 100];
    // Both sum to what is expected; the first deviates by less than a standard deviation, the second by up to three.
    let right: Vec<u64> = (0..100).map(|i| if i % 2 == 0 { 975 } else { 1025 }).collect();
    let wrong: Vec<u64> = (0..100).map(|i| 901 + 2 * i).collect();
    assert!(chi_square(&expected, &right) > PLAUSIBLE);
    assert!(chi_square(&expected, &wrong) < IMPOSSIBLE);
}
