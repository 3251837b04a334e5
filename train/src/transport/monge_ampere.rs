//! Optimal transport from the uniform square to a density on the square: Newton's method on the
//! Monge–Ampère equation log det(I + D²φ) + log q(x + ∇φ) = c with Neumann boundary.
//!
//! φ is a bicubic spline and the equation holds at the cell centres (collocation), so the map x ↦ x + ∇φ is one smooth
//! function with an exact Jacobian, which carries every edge of the square onto itself.
//! Sources: Loeper and Rapetti 2005, *Numerical solution of the Monge–Ampère equation by a Newton's algorithm*;
//! Benamou, Froese and Oberman 2014 for the transport boundary condition, which on a square mapped to a square
//! is ∂φ/∂n = 0. For a normalised q the constant c is zero; on a coarse grid Newton can converge to a wrong
//! solution, and a c away from zero is what gives that away.

use super::dissection::{Dissection, Row};
use super::potential::Potential;
use crate::spline::{EdgeSpline, cell_centre, mirror};
use std::sync::OnceLock;

/// A solve whose |c| exceeds this is rejected.
pub const CONSTANT_MAX: f64 = 0.05;
/// Root mean square residual at which Newton's method has converged on the target density.
const CONVERGED: f64 = 1e-5;
/// Residual that is still accepted when the line search stalls: 0.1 % of the density.
const ACCEPTED: f64 = 1e-3;
/// Residual at which a tempered problem is left for the next one.
const TEMPERED: f64 = 1e-2;
/// Exponent of the density that a cold start begins with.
const FIRST_TEMPERATURE: f64 = 0.25;
/// Grid side of a cold start; doubled until the asked-for side is reached.
pub const COARSEST: usize = 16;
/// Newton steps allowed for a cold start on its coarsest grid, and for every warm start.
const COLD_STEPS: usize = 40;
const WARM_STEPS: usize = 14;
/// Shortest step the line search tries.
const SHORTEST_STEP: f64 = 1e-3;

/// A solved map.
#[derive(Clone, Debug)]
pub struct Transport {
    /// Cells per side.
    pub side: usize,
    /// B-spline coefficients of the potential.
    pub potential: Vec<f64>,
    /// The constant c.
    pub constant: f64,
    /// Root mean square residual.
    pub residual: f64,
    /// Newton steps taken, over all grids.
    pub steps: usize,
}

/// State of one Newton iterate.
struct Iterate {
    residual: Vec<f64>,
    rms: f64,
    /// Per cell: 1+φxx, 1+φyy, φxy, det, and t·∇log q at the image.
    terms: Vec<[f64; 6]>,
}

/// Index of the neighbour `slot` (row-major, 0..9) of cell `k`, mirrored at the edges.
fn neighbour(n: usize, k: usize, slot: usize) -> usize {
    let shift = |v: usize, d: usize| mirror(v as isize + d as isize - 1, n);
    shift(k / n, slot / 3) * n + shift(k % n, slot % 3)
}

/// Weights of a cubic spline's value, slope and curvature at a node, on its three coefficients, per cell.
const VALUE: [f64; 3] = [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0];
const SLOPE: [f64; 3] = [-0.5, 0.0, 0.5];
const CURVATURE: [f64; 3] = [1.0, -2.0, 1.0];

/// φx, φy, φxx, φyy, φxy at the centre of every cell.
fn derivatives(coefficients: &[f64], n: usize, k: usize) -> [f64; 5] {
    let h = n as f64;
    let (i, j) = (k % n, k / n);
    let inside = i > 0 && j > 0 && i + 1 < n && j + 1 < n;
    let at = |slot: usize| match inside {
        true => coefficients[k + slot / 3 * n + slot % 3 - n - 1],
        false => coefficients[neighbour(n, k, slot)],
    };
    let mut sums = [0.0; 5];
    for slot in 0..9 {
        let (x, y) = (slot % 3, slot / 3);
        let c = at(slot);
        sums[0] += SLOPE[x] * VALUE[y] * c;
        sums[1] += VALUE[x] * SLOPE[y] * c;
        sums[2] += CURVATURE[x] * VALUE[y] * c;
        sums[3] += VALUE[x] * CURVATURE[y] * c;
        sums[4] += SLOPE[x] * SLOPE[y] * c;
    }
    [h * sums[0], h * sums[1], h * h * sums[2], h * h * sums[3], h * h * sums[4]]
}

/// Evaluates the equation; `None` where the map folds.
fn evaluate(log_q: &EdgeSpline, n: usize, phi: &[f64], constant: f64, temperature: f64) -> Option<Iterate> {
    let mut iterate = Iterate {
        residual: Vec::with_capacity(n * n),
        rms: 0.0,
        terms: Vec::with_capacity(n * n),
    };
    for k in 0..n * n {
        let [x, y, xx, yy, xy] = derivatives(phi, n, k);
        let (a, b) = (1.0 + xx, 1.0 + yy);
        let det = a * b - xy * xy;
        if !(det > 0.0 && a > 0.0) {
            return None;
        }
        let centre = cell_centre(k, n);
        let (value, gradient) = log_q.at([centre[0] + x, centre[1] + y]);
        let residual = det.ln() + temperature * value - constant;
        iterate.rms += residual * residual;
        iterate.residual.push(residual);
        let [gx, gy] = gradient.map(|g| temperature * g);
        iterate.terms.push([a, b, xy, det, gx, gy]);
    }
    iterate.rms = (iterate.rms / (n * n) as f64).sqrt();
    iterate.rms.is_finite().then_some(iterate)
}

/// The elimination orders of the grids in use, 16·2^k.
fn dissection(n: usize) -> &'static Dissection {
    static ORDERS: [OnceLock<Dissection>; 16] = [const { OnceLock::new() }; 16];
    ORDERS[n.ilog2() as usize].get_or_init(|| Dissection::new(n))
}

/// The Newton step (δφ, δc), or `None` where the system is singular.
///
/// φ is defined up to a constant: its last coefficient stays fixed, and c takes the place of that unknown.
fn newton_step(iterate: &Iterate, n: usize) -> Option<(Vec<f64>, f64)> {
    let last = n * n - 1;
    let h = n as f64;
    let coefficients = |k: usize| -> Row {
        let [a, b, m, det, gx, gy] = iterate.terms[k];
        let (xx, yy, xy) = (b / det * h * h, a / det * h * h, -2.0 * m / det * h * h);
        std::array::from_fn(|slot| {
            let (x, y) = (slot % 3, slot / 3);
            xx * CURVATURE[x] * VALUE[y]
                + yy * VALUE[x] * CURVATURE[y]
                + xy * SLOPE[x] * SLOPE[y]
                + h * (gx * SLOPE[x] * VALUE[y] + gy * VALUE[x] * SLOPE[y])
        })
    };
    let mut rows: Vec<Row> = (0..=last).map(coefficients).collect();
    // Coefficients beyond the edge are those of the mirrored neighbour.
    for (k, row) in rows.iter_mut().enumerate() {
        let (i, j) = (k % n, k / n);
        if i > 0 && j > 0 && i + 1 < n && j + 1 < n {
            continue;
        }
        let mut folded = [0.0; 9];
        for (slot, value) in row.iter().enumerate() {
            let target = neighbour(n, k, slot);
            let (x, y) = (target % n + 1 - i, target / n + 1 - j);
            folded[3 * y + x] += value;
        }
        *row = folded;
    }
    // The last unknown is taken out: its row is kept apart, its column dropped.
    let last_row: Vec<(usize, f64)> = (0..9)
        .filter(|slot| *slot != 4 && rows[last][*slot] != 0.0)
        .map(|slot| (neighbour(n, last, slot), rows[last][slot]))
        .collect();
    rows[last] = std::array::from_fn(|slot| f64::from(slot == 4));
    for slot in [0, 1, 3] {
        let k = neighbour(n, last, slot);
        rows[k][8 - slot] = 0.0;
    }
    let mut right: Vec<f64> = iterate.residual.iter().map(|r| -r).collect();
    right[last] = 0.0;
    let mut ones = vec![1.0; n * n];
    ones[last] = 0.0;
    let mut columns = [right, ones];
    if !dissection(n).solve(&rows, &mut columns) {
        return None;
    }
    let [base, per_constant] = columns;
    let dot = |v: &[f64]| last_row.iter().map(|&(k, w)| w * v[k]).sum::<f64>();
    let constant = (-iterate.residual[last] - dot(&base)) / (dot(&per_constant) - 1.0);
    let step: Vec<f64> = base
        .iter()
        .zip(&per_constant)
        .map(|(a, b)| a + constant * b)
        .collect();
    (constant.is_finite() && step.iter().all(|v| v.is_finite())).then_some((step, constant))
}

/// Newton's method on one grid from `phi`, tempering the density from `first` to 1.
fn solve_on_grid(
    log_q: &EdgeSpline,
    n: usize,
    phi: Vec<f64>,
    first: f64,
    steps_max: usize,
) -> Option<Transport> {
    let (mut phi, mut constant, mut temperature, mut advance) = (phi, 0.0, first, FIRST_TEMPERATURE);
    let mut reached = phi.clone();
    let mut steps = 0;
    loop {
        let mut iterate = evaluate(log_q, n, &phi, constant, temperature)?;
        let mean = iterate.residual.iter().sum::<f64>() / (n * n) as f64;
        constant += mean;
        iterate = evaluate(log_q, n, &phi, constant, temperature)?;
        let goal = if temperature >= 1.0 { CONVERGED } else { TEMPERED };
        while iterate.rms > goal && steps < steps_max {
            let Some((step, step_constant)) = newton_step(&iterate, n) else {
                break;
            };
            steps += 1;
            let mut length = 1.0;
            let next = loop {
                let trial: Vec<f64> = phi.iter().zip(&step).map(|(p, d)| p + length * d).collect();
                let trial_constant = constant + length * step_constant;
                match evaluate(log_q, n, &trial, trial_constant, temperature) {
                    Some(e) if e.rms < (1.0 - 0.1 * length) * iterate.rms => {
                        break Some((trial, trial_constant, e));
                    }
                    _ => length *= 0.5,
                }
                if length < SHORTEST_STEP {
                    break None;
                }
            };
            let Some((trial, trial_constant, e)) = next else {
                break;
            };
            (phi, constant, iterate) = (trial, trial_constant, e);
        }
        let enough = if temperature >= 1.0 { ACCEPTED } else { TEMPERED };
        if iterate.rms <= enough {
            if temperature >= 1.0 {
                return Some(Transport {
                    side: n,
                    potential: phi,
                    constant,
                    residual: iterate.rms,
                    steps,
                });
            }
            reached.clone_from(&phi);
            temperature = (temperature + advance).min(1.0);
            advance *= 1.5;
        } else {
            // Too bold: fall back to the last temperature reached and advance by less.
            if steps >= steps_max || advance < 0.01 || temperature <= first {
                return None;
            }
            temperature = (temperature - 0.6 * advance / 1.5).max(first);
            advance *= 0.25;
            phi.clone_from(&reached);
        }
    }
}

/// Solves for the map onto exp(`log_q`), normalised, with `cells` per side (16·2^k).
///
/// `near`: coefficients of a neighbouring slice's potential on the same grid, tried first. `None` where Newton's method
/// fails or ends on a solution whose constant betrays it.
pub fn solve(log_q: &EdgeSpline, cells: usize, near: Option<&[f64]>) -> Option<Transport> {
    let trusted = |t: &Transport| t.constant.abs() <= CONSTANT_MAX;
    let warm = near.and_then(|phi| solve_on_grid(log_q, cells, phi.to_vec(), 1.0, WARM_STEPS));
    if let Some(transport) = warm.filter(trusted) {
        return Some(transport);
    }
    let mut transport = solve_on_grid(
        log_q,
        COARSEST,
        vec![0.0; COARSEST * COARSEST],
        FIRST_TEMPERATURE,
        COLD_STEPS,
    )?;
    while transport.side < cells {
        let steps = transport.steps;
        let side = 2 * transport.side;
        let start = Potential::new(transport.side, &transport.potential).resampled(side);
        transport = solve_on_grid(log_q, side, start, 1.0, WARM_STEPS)?;
        transport.steps += steps;
    }
    Some(transport).filter(trusted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spline::edge_cell_centre;

    /// Second-order collocation with 32 cells.
    const CLOSED_FORM_TOL: f64 = 2e-3;

    /// A separable density has the product of one-dimensional inversions as its optimal map.
    #[test]
    fn separable_density_gives_the_inversion_of_each_axis() {
        let n = 32;
        // q(x) = (1 + x)/1.5 has cdf (x + x²/2)/1.5; its inverse at u is √(1 + 3u) − 1.
        let log_q: Vec<f64> = (0..64 * 64)
            .map(|k| edge_cell_centre(k, 64))
            .map(|s| ((1.0 + s[0]) * (2.0 - s[1]) / 2.25).ln())
            .collect();
        let t = solve(&EdgeSpline::new(&log_q, 64), n, None).expect("a smooth density");
        assert!(t.constant.abs() < CLOSED_FORM_TOL);
        let map = Potential::new(n, &t.potential);
        for k in 0..n * n {
            let u = cell_centre(k, n);
            let image = map.at(u).image;
            let x = (1.0 + 3.0 * u[0]).sqrt() - 1.0;
            let y = 2.0 - (4.0 - 3.0 * u[1]).sqrt();
            assert!(
                (image[0] - x).abs() < CLOSED_FORM_TOL && (image[1] - y).abs() < CLOSED_FORM_TOL,
                "{image:?} {x} {y}"
            );
        }
        let warm = solve(&EdgeSpline::new(&log_q, 64), n, Some(&t.potential)).expect("its own solution");
        assert!(warm.steps <= 1);
    }
}
