//! Optimal transport from the uniform square to a density on the square: Newton's method on the
//! Monge–Ampère equation log det(I + D²φ) + log q(x + ∇φ) = c with Neumann boundary.
//!
//! φ is a bicubic spline and the equation holds at the cell centres (collocation), so the map x ↦ x + ∇φ is one smooth
//! function with an exact Jacobian, which carries every edge of the square onto itself.
//! Sources: Loeper and Rapetti 2005, *Numerical solution of the Monge–Ampère equation by a Newton's algorithm*;
//! Benamou, Froese and Oberman 2014 for the transport boundary condition, which on a square mapped to a square
//! is ∂φ/∂n = 0. How a solution is reached from nothing: see [`super::continuation`].

use super::dissection::{Dissection, Row};
use super::potential::Potential;
use crate::spline::{EdgeSpline, cell_centre, mirror};
use std::sync::OnceLock;

/// Newton steps allowed for one problem.
const STEPS: usize = 14;
/// Shortest step the line search tries.
const SHORTEST_STEP: f64 = 1e-2;

/// A potential that solves the equation for some density.
#[derive(Clone, Debug, PartialEq)]
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

impl Transport {
    /// A start from these coefficients, `side`².
    pub fn start(side: usize, potential: Vec<f64>) -> Transport {
        Transport {
            side,
            potential,
            constant: 0.0,
            residual: 0.0,
            steps: 0,
        }
    }
}

/// The density, and what its variation within cells adds to the equation at their centres.
#[derive(Clone, Copy)]
pub struct Problem<'a> {
    /// ln q.
    pub log_q: &'a EdgeSpline,
    /// Per cell, added to log det + log q; nothing where it is empty.
    pub correction: &'a [f64],
}

/// Gauss's two points on a cell, from its centre in cells; their weights are even.
const GAUSS: [f64; 2] = [-0.288_675_134_594_812_9, 0.288_675_134_594_812_9];

/// ln of the mean of det·q over every cell, less ln(det·q) at its centre: with this correction the image of every cell
/// holds its share of the mass, which is what counts where the density varies within a cell, next to the edges above all.
pub fn correction(log_q: &EdgeSpline, state: &Transport) -> Vec<f64> {
    let n = state.side;
    let map = Potential::new(n, &state.potential);
    let density = |u: [f64; 2]| {
        let local = map.at(u);
        local.determinant().max(0.0) * log_q.at(local.image).0.exp()
    };
    (0..n * n)
        .map(|k| {
            let centre = cell_centre(k, n);
            let mut mean = 0.0;
            for dx in GAUSS {
                for dy in GAUSS {
                    mean += 0.25 * density([centre[0] + dx / n as f64, centre[1] + dy / n as f64]);
                }
            }
            (mean / density(centre)).ln()
        })
        .collect()
}

/// State of one Newton iterate.
struct Iterate {
    residual: Vec<f64>,
    rms: f64,
    /// Per cell: 1+φxx, 1+φyy, φxy, det, and t·∇log q at the image.
    terms: Vec<[f64; 6]>,
}

impl Iterate {
    /// Takes the mean off the residual, which the constant takes up, and returns it.
    fn centre(&mut self) -> f64 {
        let cells = self.residual.len() as f64;
        let mean = self.residual.iter().sum::<f64>() / cells;
        self.residual.iter_mut().for_each(|r| *r -= mean);
        self.rms = (self.residual.iter().map(|r| r * r).sum::<f64>() / cells).sqrt();
        mean
    }
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
    [
        h * sums[0],
        h * sums[1],
        h * h * sums[2],
        h * h * sums[3],
        h * h * sums[4],
    ]
}

/// Evaluates the equation; `None` where the map folds.
fn evaluate(problem: &Problem, n: usize, phi: &[f64], constant: f64) -> Option<Iterate> {
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
        let (value, [gx, gy]) = problem.log_q.at([centre[0] + x, centre[1] + y]);
        let correction = problem.correction.get(k).copied().unwrap_or(0.0);
        let residual = det.ln() + value + correction - constant;
        iterate.rms += residual * residual;
        iterate.residual.push(residual);
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

/// Newton's method for one density from the potential in `state`, until the residual is at most `goal`, or `enough` when
/// no step makes it smaller.
pub fn newton(problem: &Problem, state: &Transport, goal: f64, enough: f64) -> Option<Transport> {
    let n = state.side;
    let (mut phi, mut constant) = (state.potential.clone(), state.constant);
    let mut iterate = evaluate(problem, n, &phi, constant)?;
    constant += iterate.centre();
    let mut steps = 0;
    while iterate.rms > goal && steps < STEPS {
        let Some((step, step_constant)) = newton_step(&iterate, n) else {
            break;
        };
        steps += 1;
        let mut length = 1.0;
        let next = loop {
            let trial: Vec<f64> = phi.iter().zip(&step).map(|(p, d)| p + length * d).collect();
            let trial_constant = constant + length * step_constant;
            match evaluate(problem, n, &trial, trial_constant) {
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
    (iterate.rms <= enough).then(|| Transport {
        side: n,
        potential: phi,
        constant,
        residual: iterate.rms,
        steps: state.steps + steps,
    })
}
