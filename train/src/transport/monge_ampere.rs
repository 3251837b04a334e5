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
use crate::spline::{EdgeSpline, cell_centre, edge_cell_weight, mirror};
use std::sync::OnceLock;

/// A solve whose |c| exceeds this is rejected.
pub const CONSTANT_MAX: f64 = 0.05;
/// Root mean square residual at which Newton's method has converged on the target density.
const CONVERGED: f64 = 1e-5;
/// Residual that is still accepted when the line search stalls: 0.1 % of the density.
const ACCEPTED: f64 = 1e-3;
/// Residual at which a problem on the way is left for the next one.
const PASSED: f64 = 1e-2;
/// Grid side of a cold start; doubled until the asked-for side is reached.
pub const COARSEST: usize = 16;
/// Blur of the density on a coarse grid, in cells of that grid: what a cell cannot see must not pull at it.
const BLUR: f64 = 0.7;
/// First share of the way from one density to the next on a coarse grid's first problem, where nothing is known yet.
const FIRST_SHARE: f64 = 0.25;
/// Smallest share of that way worth trying.
const SMALLEST_SHARE: f64 = 1.0 / 64.0;
/// Newton steps allowed for one problem.
const STEPS: usize = 14;
/// Shortest step the line search tries.
const SHORTEST_STEP: f64 = 1e-2;

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
fn evaluate(log_q: &EdgeSpline, n: usize, phi: &[f64], constant: f64) -> Option<Iterate> {
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
        let (value, [gx, gy]) = log_q.at([centre[0] + x, centre[1] + y]);
        let residual = det.ln() + value - constant;
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
fn newton(log_q: &EdgeSpline, state: &Transport, goal: f64, enough: f64) -> Option<Transport> {
    let n = state.side;
    let (mut phi, mut constant) = (state.potential.clone(), state.constant);
    let mut iterate = evaluate(log_q, n, &phi, constant)?;
    constant += iterate.residual.iter().sum::<f64>() / (n * n) as f64;
    iterate = evaluate(log_q, n, &phi, constant)?;
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
            match evaluate(log_q, n, &trial, trial_constant) {
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

/// A potential and the density that it belongs to: logarithms on `cells`² crowded cells.
struct Path {
    state: Transport,
    log_q: Vec<f64>,
    cells: usize,
}

impl Path {
    /// Follows the solution to the density `to`, by shares of the way that grow while Newton's method follows and shrink
    /// when it does not. `false` where it stops short; what it reached stays.
    fn follow(&mut self, to: &[f64], first: f64, [goal, enough]: [f64; 2]) -> bool {
        let from = self.log_q.clone();
        let (mut share, mut advance) = (0.0, first);
        loop {
            let next = f64::min(share + advance, 1.0);
            let blend: Vec<f64> = from.iter().zip(to).map(|(a, b)| a + next * (b - a)).collect();
            let (goal, enough) = match next >= 1.0 {
                true => (goal, enough),
                false => (PASSED, PASSED),
            };
            match newton(&EdgeSpline::new(&blend, self.cells), &self.state, goal, enough) {
                Some(solved) => {
                    (self.state, self.log_q, share) = (solved, blend, next);
                    advance *= 2.0;
                    if next >= 1.0 {
                        return true;
                    }
                }
                None => {
                    advance *= 0.5;
                    if advance < SMALLEST_SHARE {
                        return false;
                    }
                }
            }
        }
    }

    /// Takes the potential to a grid of twice the side.
    fn refine(&mut self) {
        let state = &mut self.state;
        let side = 2 * state.side;
        state.potential = Potential::new(state.side, &state.potential).resampled(side);
        state.side = side;
    }
}

/// Solves for the map onto exp(`log_q`), normalised, on `cells` per side (16·2^k); `log_q` holds one value per crowded
/// cell, `cells`².
///
/// `near`: coefficients of a neighbouring slice's potential on the same grid, tried first. `None` where Newton's method
/// fails or ends on a solution whose constant betrays it.
pub fn solve(log_q: &[f64], cells: usize, near: Option<&[f64]>) -> Option<Transport> {
    let trusted = |t: &Transport| t.constant.abs() <= CONSTANT_MAX;
    let start = |side: usize, potential: Vec<f64>| Transport {
        side,
        potential,
        constant: 0.0,
        residual: 0.0,
        steps: 0,
    };
    let target = EdgeSpline::new(log_q, cells);
    let warm = near.and_then(|phi| newton(&target, &start(cells, phi.to_vec()), CONVERGED, ACCEPTED));
    if let Some(transport) = warm.filter(trusted) {
        return Some(transport);
    }
    let mut path = Path {
        state: start(COARSEST, vec![0.0; COARSEST * COARSEST]),
        log_q: vec![0.0; cells * cells],
        cells,
    };
    let kappa: f64 = std::env::var("KAPPA").map_or(1.0, |v| v.parse().unwrap());
    let last: f64 = std::env::var("LAST").map_or(2.0, |v| v.parse().unwrap());
    let mut first = FIRST_SHARE;
    loop {
        // What a coarse grid cannot follow to the end, the next one does.
        let sigma = BLUR * cells as f64 / path.state.side as f64;
        let target = soften(&blur(log_q, cells, sigma), cells, kappa * path.state.side as f64);
        let arrived = path.follow(&target, first, [PASSED; 2]);
        if std::env::var("TRACE").is_ok() { eprintln!("side {} arrived {arrived} steps {}", path.state.side, path.state.steps); }
        first = if arrived { 1.0 } else { FIRST_SHARE };
        if path.state.side == cells {
            break;
        }
        path.refine();
    }
    let soft = soften(log_q, cells, last * cells as f64);
    if std::env::var("TRACE").is_ok() {
        let area: Vec<f64> = (0..cells * cells).map(|k| edge_cell_weight(k, cells)).collect();
        let moved: f64 = (0..cells*cells).map(|k| area[k] * (soft[k].exp() - log_q[k].exp()).abs()).sum::<f64>() / (cells*cells) as f64;
        eprintln!("softened {moved}");
    }
    let arrived = path.follow(&soft, first, [CONVERGED, ACCEPTED]);
        if std::env::var("TRACE").is_ok() { eprintln!("side {} arrived {arrived} steps {} c {}", path.state.side, path.state.steps, path.state.constant); }
    Some(path.state).filter(|state| arrived && trusted(state))
}

/// Raises the density exp(`log_q`) where it falls faster than a grid of images can follow: with r = q^(−1/2), which is
/// the distance between images in cells, |∇r| ≤ `limit`/2. Normalised again.
fn soften(log_q: &[f64], cells: usize, limit: f64) -> Vec<f64> {
    let place: Vec<f64> = (0..cells).map(|i| crate::spline::edge_cell_centre(i, cells)[0]).collect();
    let mut r: Vec<f64> = log_q.iter().map(|l| (-0.5 * l).exp()).collect();
    let slope = 0.5 * limit;
    let sweep = |r: &mut Vec<f64>, backward: bool| {
        let d: isize = if backward { 1 } else { -1 };
        for step in 0..cells * cells {
            let k = if backward { cells * cells - 1 - step } else { step };
            let (i, j) = (k % cells, k / cells);
            for (di, dj) in [(d, 0), (0, d), (d, d), (-d, d)] {
                let (x, y) = (i as isize + di, j as isize + dj);
                if !(0..cells as isize).contains(&x) || !(0..cells as isize).contains(&y) { continue; }
                let (x, y) = (x as usize, y as usize);
                let distance = (place[i] - place[x]).hypot(place[j] - place[y]);
                r[k] = r[k].min(r[y * cells + x] + slope * distance);
            }
        }
    };
    for _ in 0..2 {
        sweep(&mut r, false);
        sweep(&mut r, true);
    }
    let area: Vec<f64> = (0..cells * cells).map(|k| edge_cell_weight(k, cells)).collect();
    let mean = r.iter().zip(&area).map(|(r, a)| a / (r * r)).sum::<f64>() / (cells * cells) as f64;
    let mean0 = log_q.iter().zip(&area).map(|(l, a)| a * l.exp()).sum::<f64>() / (cells * cells) as f64;
    r.iter().map(|r| -2.0 * r.ln() - (mean / mean0).ln()).collect()
}

/// Logarithm of the density exp(`log_q`) blurred by a Gaussian of standard deviation `sigma` cells of the crowded grid,
/// mirrored at the edges; masses of cells count, so nothing is lost.
fn blur(log_q: &[f64], cells: usize, sigma: f64) -> Vec<f64> {
    let reach = (3.0 * sigma).ceil() as isize;
    let kernel: Vec<f64> = (-reach..=reach)
        .map(|d| (-0.5 * (d as f64 / sigma).powi(2)).exp())
        .collect();
    let along = |values: &[f64], start: usize, stride: usize, out: &mut [f64]| {
        for i in 0..cells {
            out[start + i * stride] = (-reach..=reach)
                .zip(&kernel)
                .map(|(d, w)| w * values[start + mirror(i as isize + d, cells) * stride])
                .sum();
        }
    };
    let pass = |values: &[f64]| {
        let (mut rows, mut columns) = (vec![0.0; values.len()], vec![0.0; values.len()]);
        (0..cells).for_each(|j| along(values, j * cells, 1, &mut rows));
        (0..cells).for_each(|i| along(&rows, i, cells, &mut columns));
        columns
    };
    let area: Vec<f64> = (0..cells * cells).map(|k| edge_cell_weight(k, cells)).collect();
    let mass: Vec<f64> = log_q.iter().zip(&area).map(|(l, a)| l.exp() * a).collect();
    let ratio = pass(&mass).into_iter().zip(pass(&area)).map(|(m, a)| (m / a).ln());
    ratio.collect()
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
        let log_q: Vec<f64> = (0..n * n)
            .map(|k| edge_cell_centre(k, n))
            .map(|s| ((1.0 + s[0]) * (2.0 - s[1]) / 2.25).ln())
            .collect();
        let t = solve(&log_q, n, None).expect("a smooth density");
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
        let warm = solve(&log_q, n, Some(&t.potential)).expect("its own solution");
        assert!(warm.steps <= 1);
    }
}
