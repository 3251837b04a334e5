//! Biases, and whether chance explains them.

use bake_runtime::Estimate;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Probability that a stratum of an unbiased estimator is blamed for its worst bias.
pub const SIGNIFICANCE: f64 = 0.01;
/// A mean bias up to this is accepted whatever its standard error.
pub const MEAN_BIAS_MAX: f64 = 5e-4;
/// Standard errors that a mean bias may have otherwise.
pub const MEAN_SIGMAS: f64 = 3.0;
/// Relative error that f32 outputs of networks may have without being biased.
const ROUND_OFF: f64 = 1e-6;

/// A bias with its uncertainty, over the directions and channels of a stratum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Bias {
    /// Mean over directions and channels of mean weight / albedo − 1.
    pub mean: f64,
    /// The value of a single direction and channel that is farthest from 0.
    pub worst: f64,
    /// Standard error of `mean`.
    pub se: f64,
    /// Mean per channel.
    pub mean_rgb: [f64; 3],
    /// Whether `mean` is within [`MEAN_BIAS_MAX`], or else within [`MEAN_SIGMAS`] standard errors.
    pub mean_within: bool,
    /// Largest bias of a single direction and channel in its own standard errors.
    pub worst_sigmas: f64,
    /// What that may be for so many of them: see [`allowed_sigmas`].
    pub worst_allowed_sigmas: f64,
    /// Whether it is.
    pub worst_within: bool,
}

impl Bias {
    /// Of the relative biases of single directions, RGB, each with its standard error; at least one.
    pub fn of(rows: &[Estimate]) -> Bias {
        let n = rows.len() as f64;
        let mean_rgb = rows.iter().map(|r| r.mean).sum::<DVec3>() / n;
        let se = rows.iter().map(|r| r.se * r.se).sum::<DVec3>().map(f64::sqrt) / n;
        let single = || {
            let pairs = rows.iter().map(|r| (r.mean.to_array(), r.se.to_array()));
            pairs.flat_map(|(mean, se)| mean.into_iter().zip(se))
        };
        let mean = mean_rgb.element_sum() / 3.0;
        // Channels share their samples, so their errors add up rather than average out.
        let se = se.element_sum() / 3.0;
        let farther = |a: f64, b: f64| if b.abs() > a.abs() { b } else { a };
        let worst_sigmas = single()
            .map(|(b, se)| b.abs() / se.hypot(ROUND_OFF))
            .fold(0.0, f64::max);
        let worst_allowed_sigmas = allowed_sigmas(SIGNIFICANCE, 3 * rows.len());
        Bias {
            mean,
            worst: single().map(|(b, _)| b).fold(0.0, farther),
            se,
            mean_rgb: mean_rgb.to_array(),
            mean_within: mean.abs() <= MEAN_BIAS_MAX.max(MEAN_SIGMAS * se),
            worst_sigmas,
            worst_allowed_sigmas,
            worst_within: worst_sigmas <= worst_allowed_sigmas,
        }
    }
}

/// Relative bias of `found` against `truth`, with the standard error of both; 0 in a channel that is black.
pub fn relative(found: Estimate, truth: Estimate) -> Estimate {
    let per_channel = |f: &dyn Fn(usize) -> f64| {
        DVec3::from_array([0, 1, 2].map(|c| {
            if truth.mean[c] > 0.0 {
                f(c) / truth.mean[c]
            } else {
                0.0
            }
        }))
    };
    Estimate {
        mean: per_channel(&|c| found.mean[c] - truth.mean[c]),
        se: per_channel(&|c| found.se[c].hypot(truth.se[c])),
    }
}

/// Standard errors that the largest of `tests` normal deviations exceeds with probability `significance`.
///
/// Two-sided, with the correction of Šidák 1967, *Rectangular Confidence Regions for the Means of Multivariate Normal
/// Distributions*, which holds for deviations that depend on each other, too, as those of channels do.
pub fn allowed_sigmas(significance: f64, tests: usize) -> f64 {
    let single = -f64::exp_m1(f64::ln_1p(-significance) / tests as f64);
    upper_quantile(0.5 * single)
}

/// The standard normal deviation that is exceeded with probability `p` in (0, ½], within 4.5e-4.
///
/// Hastings 1955, *Approximations for Digital Computers*, as Abramowitz and Stegun 1964, 26.2.23.
fn upper_quantile(p: f64) -> f64 {
    let t = (-2.0 * p.ln()).sqrt();
    let numerator = 2.515517 + t * (0.802853 + t * 0.010328);
    let denominator = 1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308));
    t - numerator / denominator
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stated error of the approximation, and the digits of the table.
    const QUANTILE_TOL: f64 = 5e-4;

    #[test]
    fn quantiles_are_those_of_tables() {
        // Two-sided deviations of the standard normal distribution, as any table of it has them.
        for (p, z) in [
            (0.5, 0.674490),
            (0.1, 1.644854),
            (0.05, 1.959964),
            (0.01, 2.575829),
            (0.001, 3.290527),
            (1e-4, 3.890592),
            (1e-6, 4.891638),
        ] {
            assert!((upper_quantile(0.5 * p) - z).abs() < QUANTILE_TOL, "{p}");
            assert!((allowed_sigmas(p, 1) - z).abs() < QUANTILE_TOL, "{p}");
        }
        // The same at 1 − (1 − s)^(1/n), to sixteen digits by algorithm AS 241 (Wichura 1988).
        for (significance, tests, z) in [
            (0.05, 2, 2.236477),
            (0.05, 3, 2.387738),
            (0.05, 10, 2.799625),
            (0.05, 20, 3.015995),
            (0.01, 2, 2.806225),
            (0.01, 10, 3.289255),
            (0.01, 20, 3.479479),
            (0.01, 96, 3.879467),
        ] {
            let found = allowed_sigmas(significance, tests);
            assert!(
                (found - z).abs() < QUANTILE_TOL,
                "{significance} {tests}: {found}"
            );
        }
    }

    fn estimates(biases: &[[f64; 3]], se: f64) -> Vec<Estimate> {
        let estimate = |b: &[f64; 3]| Estimate {
            mean: DVec3::from_array(*b),
            se: DVec3::splat(se),
        };
        biases.iter().map(estimate).collect()
    }

    #[test]
    fn chance_is_told_from_bias() {
        let small = Bias::of(&estimates(&[[1e-3, -1e-3, 0.0], [2e-3, 0.0, -3e-3]], 1e-3));
        assert!(small.mean_within && small.worst_within && small.worst == -3e-3);
        assert!((small.worst_sigmas - 3.0).abs() < 1e-3 && (small.worst_allowed_sigmas - 3.143).abs() < 2e-3);
        assert!((small.se - 1e-3 / 2f64.sqrt()).abs() < 1e-12 && small.mean_rgb[0] == 1.5e-3);
        // The same everywhere is more than chance, and so is one that stands out.
        let shifted = Bias::of(&estimates(&[[2.5e-3; 3]; 32], 1e-3));
        assert!(!shifted.mean_within && shifted.worst_within);
        let mut rows = vec![[0.0; 3]; 32];
        rows[7][1] = -5e-3;
        let standing = Bias::of(&estimates(&rows, 1e-3));
        assert!(standing.mean_within && !standing.worst_within && standing.worst == -5e-3);
        // What f32 cannot tell is no bias.
        assert!(Bias::of(&estimates(&[[2e-6; 3]], 0.0)).worst_within);
    }

    #[test]
    fn black_channels_have_no_bias() {
        let truth = Estimate {
            mean: DVec3::new(0.5, 0.0, 0.2),
            se: DVec3::splat(3e-3),
        };
        let found = Estimate {
            mean: DVec3::new(0.55, 0.0, 0.2),
            se: DVec3::splat(4e-3),
        };
        let bias = relative(found, truth);
        assert!((bias.mean - DVec3::new(0.1, 0.0, 0.0)).length() < 1e-12);
        assert!((bias.se - DVec3::new(0.01, 0.0, 0.025)).length() < 1e-12);
    }
}
