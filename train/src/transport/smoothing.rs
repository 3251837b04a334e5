//! Densities that a grid of images can follow: blurred, or with their falls made gentle.
//!
//! A density here is its logarithm on the crowded grid of [`crate::spline::EdgeSpline`].

use crate::spline::{edge_cell_centre, edge_cell_weight, mirror};

/// Standard deviations after which a Gaussian is cut.
const REACH: f64 = 3.0;

/// Passes of the distance sweep in both directions; a bent front needs more than one.
const SWEEPS: usize = 2;

fn areas(cells: usize) -> Vec<f64> {
    (0..cells * cells).map(|k| edge_cell_weight(k, cells)).collect()
}

/// Logarithm of the density blurred by a Gaussian of standard deviation `sigma` cells, mirrored at the edges; masses of
/// cells count, so nothing is lost.
pub fn blur(log_q: &[f64], cells: usize, sigma: f64) -> Vec<f64> {
    let reach = (REACH * sigma).ceil() as isize;
    let kernel: Vec<f64> = (-reach..=reach)
        .map(|d| (-0.5 * (d as f64 / sigma).powi(2)).exp())
        .collect();
    let along = |values: &[f64], start: usize, stride: usize, out: &mut [f64]| {
        for i in 0..cells {
            let taps = (-reach..=reach).zip(&kernel);
            let sum = taps.map(|(d, w)| w * values[start + mirror(i as isize + d, cells) * stride]);
            out[start + i * stride] = sum.sum();
        }
    };
    let pass = |values: &[f64]| {
        let (mut rows, mut columns) = (vec![0.0; values.len()], vec![0.0; values.len()]);
        (0..cells).for_each(|j| along(values, j * cells, 1, &mut rows));
        (0..cells).for_each(|i| along(&rows, i, cells, &mut columns));
        columns
    };
    let area = areas(cells);
    let mass: Vec<f64> = log_q.iter().zip(&area).map(|(l, a)| l.exp() * a).collect();
    let ratio = pass(&mass)
        .into_iter()
        .zip(pass(&area))
        .map(|(m, a)| (m / a).ln());
    ratio.collect()
}

/// Raises the density where it falls faster than images can follow, and normalises it again.
///
/// r = q^(−1/2) is the distance between neighbouring images, in cells of u; the result has |∇r| ≤ `limit`/2, with
/// `limit` = κ·n on n cells per side: the logarithm then changes by at most κ from one image to the next.
pub fn soften(log_q: &[f64], cells: usize, limit: f64) -> Vec<f64> {
    let place: Vec<f64> = (0..cells).map(|i| edge_cell_centre(i, cells)[0]).collect();
    let mut r: Vec<f64> = log_q.iter().map(|l| (-0.5 * l).exp()).collect();
    let n = cells as isize;
    let mut lower = |k: usize, d: isize| {
        let (i, j) = (k as isize % n, k as isize / n);
        for (di, dj) in [(d, 0), (0, d), (d, d), (-d, d)] {
            let (x, y) = (i + di, j + dj);
            if (0..n).contains(&x) && (0..n).contains(&y) {
                let [dx, dy] = [[i, x], [j, y]].map(|[a, b]| place[a as usize] - place[b as usize]);
                r[k] = r[k].min(r[(y * n + x) as usize] + 0.5 * limit * dx.hypot(dy));
            }
        }
    };
    for _ in 0..SWEEPS {
        (0..cells * cells).for_each(|k| lower(k, -1));
        (0..cells * cells).rev().for_each(|k| lower(k, 1));
    }
    let raised: Vec<f64> = r.iter().map(|r| -2.0 * r.ln()).collect();
    let scale = (mass(&raised, cells) / mass(log_q, cells)).ln();
    raised.iter().map(|l| l - scale).collect()
}

/// Integral of the density over the square.
pub fn mass(log_q: &[f64], cells: usize) -> f64 {
    let sum: f64 = log_q.iter().zip(areas(cells)).map(|(l, a)| l.exp() * a).sum();
    sum / (cells * cells) as f64
}

/// Mass that must move to make one density of the other: half the integral of |a − b|.
pub fn moved(a: &[f64], b: &[f64], cells: usize) -> f64 {
    let pairs = a.iter().zip(b).zip(areas(cells));
    let sum: f64 = pairs.map(|((a, b), w)| w * (a.exp() - b.exp()).abs()).sum();
    0.5 * sum / (cells * cells) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Round-off, and what the cut of the kernel takes from both sums alike.
    const MASS_TOL: f64 = 1e-12;
    /// Distances by sweeps over eight neighbours are at most this factor too long.
    const SWEEP_FACTOR: f64 = 1.09;

    fn cliff(cells: usize) -> Vec<f64> {
        (0..cells * cells)
            .map(|k| {
                if edge_cell_centre(k, cells)[0] > 0.6 {
                    -4.0
                } else {
                    0.5
                }
            })
            .collect()
    }

    #[test]
    fn blur_keeps_constants_and_smooths_cliffs() {
        let n = 32;
        assert!(
            blur(&vec![0.3; n * n], n, 1.7)
                .iter()
                .all(|l| (l - 0.3).abs() < MASS_TOL)
        );
        let blurred = blur(&cliff(n), n, 2.0);
        let steepest = |l: &[f64]| (1..n).map(|i| (l[i] - l[i - 1]).abs()).fold(0.0, f64::max);
        assert!(steepest(&blurred) < 0.5 * steepest(&cliff(n)));
    }

    #[test]
    fn softened_densities_fall_no_faster_than_asked() {
        let n = 64;
        let limit = 16.0;
        let soft = soften(&cliff(n), n, limit);
        assert!((mass(&soft, n) / mass(&cliff(n), n) - 1.0).abs() < MASS_TOL);
        let r = |k: usize| (-0.5 * soft[k]).exp();
        let scale = r(0) / (-0.25f64).exp();
        for k in (0..n * n).filter(|k| k % n > 0) {
            let distance = edge_cell_centre(k, n)[0] - edge_cell_centre(k - 1, n)[0];
            let slope = (r(k) - r(k - 1)).abs() / distance / scale;
            assert!(slope < 0.5 * limit * SWEEP_FACTOR, "{slope}");
        }
        assert!(moved(&cliff(n), &soft, n) > 0.0);
        let gentle = vec![0.1; n * n];
        assert!(moved(&gentle, &soften(&gentle, n, limit), n) < MASS_TOL);
    }
}
