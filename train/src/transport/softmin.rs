//! The soft minimum of −|x − y_j|² + g_j over many targets for many queries: the one costly step of Sinkhorn's iteration,
//! truncated where it cannot matter and in single precision where that is enough.
//!
//! Sources: Feydy et al. 2019 for the log-domain form; Schmitzer 2019, *Stabilized Sparse Scaling Algorithms for Entropy
//! Regularized Transport Problems*, for truncation. Queries are taken in compact tiles. Over one tile, a target's exponent
//! relative to that of a reference target is an affine function of the query, known exactly from the tile's centre: so
//! whole targets are dropped by a rigorous bound, and what is left are differences small enough for single precision.

use pulp::Arch;
use rayon::prelude::*;

use super::cloud::{Cloud, Tile};

/// Terms below e^−this times the largest are dropped: with 10⁶ of them, 10⁻⁷ of the sum.
pub const TRUNCATION: f64 = 30.0;
/// Largest relative error of the powers of two, for exponents in [−126, 126].
pub const EXP2_ERROR: f32 = 3e-7;
/// Largest error of [`softmin`] over ε: single precision of exponents up to a few hundred within a tile.
pub const SOFTMIN_ERROR: f64 = 1e-4;
/// Lanes of the accumulators: two AVX-512 registers, four of AVX2.
const LANES: usize = 32;
/// Exponent of the padding: it stays zero whatever is added to it.
const NEVER: f32 = -1e30;

/// 2^`x` for `x` in [−126, 126]; below, 2^−126.
///
/// A polynomial of degree 6 on [−½, ½] (truncated series, whose next term is 10⁻⁷ of the sum) and an addition to the exponent.
#[inline(always)]
fn exp2_fast(x: f32) -> f32 {
    /// 1.5·2²³: adding it rounds to an integer, which is then in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    const C: [f32; 7] = [
        1.0,
        std::f32::consts::LN_2,
        0.240_226_5,
        0.055_504_11,
        0.009_618_129,
        0.001_333_355_8,
        0.000_154_035_3,
    ];
    let x = x.max(-126.0);
    let shifted = x + ROUND;
    let t = x - (shifted - ROUND);
    let p = C[0] + t * (C[1] + t * (C[2] + t * (C[3] + t * (C[4] + t * (C[5] + t * C[6])))));
    // The integer in the lowest bits, with the exponent's bias, moves up to the exponent; all above falls off.
    p * f32::from_bits(shifted.to_bits().wrapping_add(127) << 23)
}

/// The targets that matter to one tile, relative to a reference target, padded to whole lanes.
#[derive(Default)]
struct Near {
    /// Exponent at the centre of the tile, in powers of two.
    exponent: Vec<f32>,
    /// Offset from the reference target.
    dx: Vec<f32>,
    dy: Vec<f32>,
    /// Position and potential of the reference target.
    reference: [f64; 2],
    potential: f64,
}

impl Near {
    /// Targets of `targets` with `potential` (log-weights included) that matter at `epsilon` somewhere in `tile`.
    fn gather(
        &mut self,
        tile: &Tile,
        targets: &Cloud,
        potential: &[f64],
        epsilon: f64,
        values: &mut Vec<f64>,
    ) {
        let [cx, cy] = tile.centre;
        let [rx, ry] = tile.radius;
        values.clear();
        values.extend(
            (targets.points.iter().zip(potential)).map(|([x, y], g)| g - (cx - x).powi(2) - (cy - y).powi(2)),
        );
        let best = (0..values.len()).fold(0, |best, j| if values[j] > values[best] { j } else { best });
        (self.reference, self.potential) = (targets.points[best], potential[best]);
        let largest = values[best];
        for list in [&mut self.exponent, &mut self.dx, &mut self.dy] {
            list.clear();
        }
        let to_exponent = std::f64::consts::LOG2_E / epsilon;
        for ([x, y], value) in targets.points.iter().zip(&*values) {
            let (dx, dy) = (x - self.reference[0], y - self.reference[1]);
            let below = value - largest;
            // The most that moving from the centre to a corner can add.
            if below + 2.0 * (rx * dx.abs() + ry * dy.abs()) >= -TRUNCATION * epsilon {
                self.exponent.push((below * to_exponent) as f32);
                self.dx.push(dx as f32);
                self.dy.push(dy as f32);
            }
        }
        let padded = self.exponent.len().next_multiple_of(LANES);
        self.exponent.resize(padded, NEVER);
        self.dx.resize(padded, 0.0);
        self.dy.resize(padded, 0.0);
    }

    /// Largest exponent (power of two) at `slope` = 2 (x − centre) / ε · log₂ e from the centre.
    #[inline(always)]
    fn largest(&self, [a, b]: [f32; 2]) -> f32 {
        let mut largest = [f32::NEG_INFINITY; LANES];
        for ((e, dx), dy) in (self.exponent.chunks_exact(LANES))
            .zip(self.dx.chunks_exact(LANES))
            .zip(self.dy.chunks_exact(LANES))
        {
            for l in 0..LANES {
                largest[l] = largest[l].max(e[l] + (a * dx[l] + b * dy[l]));
            }
        }
        largest.into_iter().fold(f32::NEG_INFINITY, f32::max)
    }

    /// Sum of the terms relative to `largest`, and of the terms times the offsets when `MEANS`.
    #[inline(always)]
    fn sum<const MEANS: bool>(&self, [a, b]: [f32; 2], largest: f32) -> [f32; 3] {
        let mut sums = [[0.0; LANES]; 3];
        for ((e, dx), dy) in (self.exponent.chunks_exact(LANES))
            .zip(self.dx.chunks_exact(LANES))
            .zip(self.dy.chunks_exact(LANES))
        {
            for l in 0..LANES {
                let term = exp2_fast(e[l] + (a * dx[l] + b * dy[l]) - largest);
                sums[0][l] += term;
                if MEANS {
                    sums[1][l] += term * dx[l];
                    sums[2][l] += term * dy[l];
                }
            }
        }
        sums.map(|lanes| lanes.into_iter().sum())
    }

    /// (soft minimum, barycentre) at `p`; the barycentre is the reference when not `MEANS`.
    fn at<const MEANS: bool>(&self, p: [f64; 2], tile: &Tile, epsilon: f64) -> (f64, [f64; 2]) {
        let slope =
            [0, 1].map(|k| (2.0 * (p[k] - tile.centre[k]) / epsilon * std::f64::consts::LOG2_E) as f32);
        let (largest, [sum, x, y]) = Arch::new().dispatch(|| {
            let largest = self.largest(slope);
            (largest, self.sum::<MEANS>(slope, largest))
        });
        let [rx, ry] = self.reference;
        let distance = (p[0] - rx).powi(2) + (p[1] - ry).powi(2);
        let log = std::f64::consts::LN_2 * f64::from(largest) + f64::from(sum).ln();
        let offset = [f64::from(x / sum), f64::from(y / sum)];
        (
            distance - self.potential - epsilon * log,
            [rx + offset[0], ry + offset[1]],
        )
    }
}

/// Runs `at` for every query, tile by tile, and returns results in the order of the cloud.
fn map_tiles<const MEANS: bool>(
    queries: &Cloud,
    targets: &Cloud,
    potential: &[f64],
    epsilon: f64,
) -> impl Iterator<Item = (f64, [f64; 2])> {
    let weighted: Vec<f64> = (potential.iter().zip(&targets.log_weights))
        .map(|(g, log)| g + epsilon * log)
        .collect();
    let tiles: Vec<Vec<(f64, [f64; 2])>> = queries
        .tiles
        .par_iter()
        .map_init(
            || (Near::default(), Vec::new()),
            |(near, values), tile| {
                near.gather(tile, targets, &weighted, epsilon, values);
                let points = &queries.points[tile.range.clone()];
                points
                    .iter()
                    .map(|p| near.at::<MEANS>(*p, tile, epsilon))
                    .collect()
            },
        )
        .collect();
    tiles.into_iter().flatten()
}

/// −ε log Σ_j w_j exp((g_j − |x − y_j|²)/ε) for every x of `queries` over `targets` with weights w and potential g,
/// both in the order of their clouds. Off by at most [`SOFTMIN_ERROR`] ε.
pub fn softmin(queries: &Cloud, targets: &Cloud, potential: &[f64], epsilon: f64) -> Vec<f64> {
    map_tiles::<false>(queries, targets, potential, epsilon)
        .map(|(value, _)| value)
        .collect()
}

/// Mean of the targets under the weights of [`softmin`], for every query.
pub fn barycentres(queries: &Cloud, targets: &Cloud, potential: &[f64], epsilon: f64) -> Vec<[f64; 2]> {
    map_tiles::<true>(queries, targets, potential, epsilon)
        .map(|(_, mean)| mean)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::Rng;

    /// The error of weights, which are as far off as the soft minimum, on offsets of up to the scale of the targets.
    const BARYCENTRE_TOL: f64 = 1e-4;

    /// By definition, in double precision.
    fn oracle(x: [f64; 2], targets: &Cloud, potential: &[f64], epsilon: f64) -> (f64, [f64; 2]) {
        let exponents: Vec<f64> = (0..targets.points.len())
            .map(|j| {
                let [a, b] = targets.points[j];
                let cost = (x[0] - a).powi(2) + (x[1] - b).powi(2);
                targets.log_weights[j] + (potential[j] - cost) / epsilon
            })
            .collect();
        let largest = exponents.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let terms: Vec<f64> = exponents.iter().map(|e| (e - largest).exp()).collect();
        let sum: f64 = terms.iter().sum();
        let mean = |k: usize| {
            terms
                .iter()
                .zip(&targets.points)
                .map(|(t, p)| t * p[k])
                .sum::<f64>()
                / sum
        };
        (-epsilon * (largest + sum.ln()), [mean(0), mean(1)])
    }

    #[test]
    fn powers_of_two_are_as_exact_as_stated() {
        let mut worst = 0.0_f64;
        for k in 0..1_000_000 {
            let x = -126.0 + 252.0 * (k as f32 / 1e6);
            let exact = f64::from(x).exp2();
            worst = worst.max((f64::from(exp2_fast(x)) / exact - 1.0).abs());
        }

        assert!(worst <= f64::from(EXP2_ERROR), "{worst:e}");
        assert_eq!(exp2_fast(-1e30), exp2_fast(-126.0));
        assert_eq!(exp2_fast(0.0), 1.0);
    }

    #[test]
    fn soft_minima_and_barycentres_are_those_of_the_definition() {
        let mut rng = Rng::new(&[61]);
        let mut cloud = |n: usize, scale: f64| {
            let points: Vec<[f64; 2]> = (0..n)
                .map(|_| [0, 1].map(|_| scale * (2.0 * rng.uniform() - 1.0)))
                .collect();
            Cloud::new(&points)
        };
        for (scale, epsilons) in [(1.0, [8.0, 0.1, 1e-3]), (0.01, [0.1, 1e-3, 1e-5])] {
            let (queries, targets) = (cloud(500, 1.0), cloud(700, scale));
            for targets in [&targets, &targets.coarse()] {
                for epsilon in epsilons {
                    // The potential of a map onto all of the targets keeps many of them in play.
                    let potential: Vec<f64> = targets
                        .points
                        .iter()
                        .map(|[x, y]| (1.0 - 1.0 / scale) * (x * x + y * y))
                        .collect();
                    let values = softmin(&queries, targets, &potential, epsilon);
                    let means = barycentres(&queries, targets, &potential, epsilon);
                    for ((p, value), mean) in queries.points.iter().zip(values).zip(means) {
                        let (exact, centre) = oracle(*p, targets, &potential, epsilon);
                        assert!(
                            (value - exact).abs() <= SOFTMIN_ERROR * epsilon,
                            "{value} against {exact} at ε = {epsilon}"
                        );
                        for k in 0..2 {
                            assert!((mean[k] - centre[k]).abs() <= BARYCENTRE_TOL * scale);
                        }
                    }
                }
            }
        }
    }
}
