//! Optimal transport from the uniform square to a density on the square: Newton's method on the
//! Monge–Ampère equation log det(I + D²φ) + log q(x + ∇φ) = c with Neumann boundary.
//!
//! The map x ↦ x + ∇φ carries every edge of the square onto itself and has an exact Jacobian.
//! Sources: Loeper and Rapetti 2005, *Numerical solution of the Monge–Ampère equation by a Newton's algorithm*;
//! Benamou, Froese and Oberman 2014 for the transport boundary condition, which on a square mapped to a square
//! is ∂φ/∂n = 0. For a normalised q the constant c is zero; on a coarse grid Newton can converge to a wrong
//! solution, and a c away from zero is what gives that away.

use super::banded::Banded;
use crate::spline::{EdgeSpline, Spline, cell_centre};

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
const COARSEST: usize = 16;
/// Newton steps allowed for a cold start on its coarsest grid, and for every warm start.
const COLD_STEPS: usize = 40;
const WARM_STEPS: usize = 14;
/// Shortest step the line search tries.
const SHORTEST_STEP: f64 = 1e-3;

/// A solved map.
#[derive(Clone, Debug)]
pub struct Transport {
    /// Cells per side.
    pub cells: usize,
    /// The potential φ at cell centres.
    pub potential: Vec<f64>,
    /// Image of every cell centre.
    pub map: Vec<[f64; 2]>,
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
    map: Vec<[f64; 2]>,
}

/// Second-order differences of a cell with mirrored neighbours.
struct Stencil {
    n: usize,
}

impl Stencil {
    fn index(&self, i: usize, j: usize, di: isize, dj: isize) -> usize {
        let shift = |k: usize, d: isize| (k as isize + d).clamp(0, self.n as isize - 1) as usize;
        shift(j, dj) * self.n + shift(i, di)
    }

    /// φx, φy, φxx, φyy, φxy at cell (i, j).
    fn derivatives(&self, phi: &[f64], i: usize, j: usize) -> [f64; 5] {
        let h = self.n as f64;
        let at = |di, dj| phi[self.index(i, j, di, dj)];
        let centre = at(0, 0);
        [
            0.5 * h * (at(1, 0) - at(-1, 0)),
            0.5 * h * (at(0, 1) - at(0, -1)),
            h * h * (at(1, 0) - 2.0 * centre + at(-1, 0)),
            h * h * (at(0, 1) - 2.0 * centre + at(0, -1)),
            0.25 * h * h * (at(1, 1) - at(-1, 1) - at(1, -1) + at(-1, -1)),
        ]
    }
}

/// Evaluates the equation; `None` where the map folds.
fn evaluate(log_q: &EdgeSpline, n: usize, phi: &[f64], constant: f64, temperature: f64) -> Option<Iterate> {
    let stencil = Stencil { n };
    let mut iterate = Iterate {
        residual: Vec::with_capacity(n * n),
        rms: 0.0,
        terms: Vec::with_capacity(n * n),
        map: Vec::with_capacity(n * n),
    };
    for k in 0..n * n {
        let [x, y, xx, yy, xy] = stencil.derivatives(phi, k % n, k / n);
        let (a, b) = (1.0 + xx, 1.0 + yy);
        let det = a * b - xy * xy;
        if !(det > 0.0 && a > 0.0) {
            return None;
        }
        let centre = cell_centre(k, n);
        let image = [centre[0] + x, centre[1] + y];
        let (value, gradient) = log_q.at(image);
        let residual = det.ln() + temperature * value - constant;
        iterate.rms += residual * residual;
        iterate.residual.push(residual);
        iterate.terms.push([
            a,
            b,
            xy,
            det,
            temperature * gradient[0],
            temperature * gradient[1],
        ]);
        iterate.map.push(image);
    }
    iterate.rms = (iterate.rms / (n * n) as f64).sqrt();
    iterate.rms.is_finite().then_some(iterate)
}

/// The Newton step (δφ, δc), or `None` where the system is singular.
///
/// φ is defined up to a constant: its last value stays fixed, and c takes the place of that unknown.
fn newton_step(iterate: &Iterate, n: usize) -> Option<(Vec<f64>, f64)> {
    let stencil = Stencil { n };
    let last = n * n - 1;
    let h = n as f64;
    let mut matrix = Banded::zeros(last, n + 1);
    let mut last_row: Vec<(usize, f64)> = Vec::new();
    for k in 0..=last {
        let (i, j) = (k % n, k / n);
        let [a, b, m, det, gx, gy] = iterate.terms[k];
        let (xx, yy, xy) = (b / det * h * h, a / det * h * h, -0.5 * m / det * h * h);
        let (x, y) = (0.5 * gx * h, 0.5 * gy * h);
        let entries = [
            (0, 0, -2.0 * (xx + yy)),
            (1, 0, xx + x),
            (-1, 0, xx - x),
            (0, 1, yy + y),
            (0, -1, yy - y),
            (1, 1, xy),
            (-1, -1, xy),
            (-1, 1, -xy),
            (1, -1, -xy),
        ];
        for (di, dj, value) in entries {
            let column = stencil.index(i, j, di, dj);
            if column == last {
                continue;
            }
            match k == last {
                true => last_row.push((column, value)),
                false => matrix.add(k, column, value),
            }
        }
    }
    let right: Vec<f64> = iterate.residual[..last].iter().map(|r| -r).collect();
    let mut columns = [right, vec![1.0; last]];
    if !matrix.solve(&mut columns) {
        return None;
    }
    let [base, per_constant] = columns;
    let dot = |v: &[f64]| last_row.iter().map(|&(k, w)| w * v[k]).sum::<f64>();
    let constant = (-iterate.residual[last] - dot(&base)) / (dot(&per_constant) - 1.0);
    let mut step: Vec<f64> = base
        .iter()
        .zip(&per_constant)
        .map(|(a, b)| a + constant * b)
        .collect();
    step.push(0.0);
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
                let Iterate { rms, map, .. } = iterate;
                return Some(Transport {
                    cells: n,
                    potential: phi,
                    map,
                    constant,
                    residual: rms,
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

/// Potential on a grid of twice the side, by the spline through the coarse one.
fn refine(coarse: &Transport) -> Vec<f64> {
    let n = 2 * coarse.cells;
    let spline = Spline::new(&coarse.potential, coarse.cells);
    (0..n * n).map(|k| spline.at(cell_centre(k, n)).0).collect()
}

/// Solves for the map onto exp(`log_q`), normalised, with `cells` per side (16·2^k).
///
/// `near`: potential of a neighbouring slice on the same grid, tried first. `None` where Newton's method
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
    while transport.cells < cells {
        let steps = transport.steps;
        transport = solve_on_grid(log_q, 2 * transport.cells, refine(&transport), 1.0, WARM_STEPS)?;
        transport.steps += steps;
    }
    Some(transport).filter(trusted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spline::edge_cell_centre;

    /// Second-order differences with 32 cells.
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
        for (k, image) in t.map.iter().enumerate() {
            let u = cell_centre(k, n);
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
