//! From nothing, or from a neighbour, to the map onto a density: coarse to fine, from blurred to sharp.
//!
//! Newton's method follows only where the density changes little between neighbouring images. So a cold start solves a
//! 16 × 16 grid for a blurred density first, doubles the grid as the blur shrinks, and passes from each density to the next
//! along blends of their logarithms, by shares that grow and shrink as Newton's method follows or not (numerical
//! continuation; Allgower and Georg 1990). For a normalised density the constant c is zero; on a coarse grid Newton can
//! converge to a wrong solution, and a c away from zero is what gives that away.

use super::monge_ampere::{Problem, Transport, correction, newton};
use super::potential::Potential;
use super::smoothing::{blur, moved, soften};
use crate::spline::{EdgeSpline, cell_centre};

/// A solve whose |c| exceeds this is rejected.
pub const CONSTANT_MAX: f64 = 0.05;
/// A solve that folds on more than this share of the square is rejected.
pub const FOLDS_MAX: f64 = 1e-4;
/// A solve that leaves or doubles more than this share of the square is rejected; midpoints see up to a thousandth where
/// nothing is wrong.
const UNCOVERED_MAX: f64 = 1e-2;
/// Densities that would have to be softened by more mass than this are left to the marginal map, which bins better then.
const SOFTENED_MAX: f64 = 0.02;
/// Places per cell and side at which folds are looked for.
const FOLD_SUB: usize = 4;
/// Root mean square residual at which Newton's method has converged on the target density.
const CONVERGED: f64 = 1e-5;
/// The same before the solution is corrected for what the density does within cells.
const CORRECTABLE: f64 = 1e-3;
/// Corrections: each one takes about a tenth of the error of the last.
const CORRECTIONS: usize = 2;
/// Residual that is still accepted when the line search stalls: 0.1 % of the density.
const ACCEPTED: f64 = 1e-3;
/// Residual at which a problem on the way is left for the next one.
const PASSED: f64 = 1e-2;
/// Grid side of a cold start; doubled until the asked-for side is reached.
pub const COARSEST: usize = 16;
/// Blur of the density on a coarse grid, in cells of that grid: what a cell cannot see must not pull at it.
const BLUR: f64 = 0.7;
/// Steepest fall of a density on its way, per image: see [`soften`].
const FALL: f64 = 1.0;
/// First share of the way from one density to the next where nothing is known yet.
const FIRST_SHARE: f64 = 0.25;
/// Smallest share of that way worth trying.
const SMALLEST_SHARE: f64 = 1.0 / 64.0;

/// A map that passed all guards.
#[derive(Clone, Debug, PartialEq)]
pub struct Solved {
    /// The potential.
    pub transport: Transport,
    /// Mass that the density had to be softened by for Newton's method to follow; 0 as a rule.
    pub softened: f64,
    /// Share of the square that folds.
    pub folds: f64,
    /// Share of the target square that is not covered: 1 less the mean determinant.
    pub uncovered: f64,
}

/// A potential and the density that it belongs to: logarithms on `cells`² crowded cells.
#[derive(Clone)]
struct Path {
    state: Transport,
    log_q: Vec<f64>,
    cells: usize,
}

impl Path {
    /// Follows the solution to the density `to`, the first step being the share `first` of the way. `false` where it stops
    /// short; what it reached stays.
    fn follow(&mut self, to: &[f64], first: f64, [goal, enough]: [f64; 2]) -> bool {
        let from = self.log_q.clone();
        let (mut share, mut advance) = (0.0, first);
        while share < 1.0 {
            let next = f64::min(share + advance, 1.0);
            let blend: Vec<f64> = from.iter().zip(to).map(|(a, b)| a + next * (b - a)).collect();
            let (goal, enough) = match next >= 1.0 {
                true => (goal, enough),
                false => (PASSED, PASSED),
            };
            let log_q = EdgeSpline::new([&blend], self.cells);
            match newton(&uncorrected(&log_q), &self.state, goal, enough) {
                Some(solved) => {
                    (self.state, self.log_q, share) = (solved, blend, next);
                    advance *= 2.0;
                }
                None => {
                    advance *= 0.5;
                    if advance < SMALLEST_SHARE {
                        return false;
                    }
                }
            }
        }
        true
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
/// `near`: coefficients of a neighbouring slice's potential on the same grid, tried first. Where Newton's method does not
/// follow to the density itself, the density is softened, and says by how much; `None` where that fails, too, or a guard
/// rejects the result.
pub fn solve(log_q: &[f64], cells: usize, near: Option<&[f64]>) -> Option<Solved> {
    let target = EdgeSpline::new([log_q], cells);
    let warm = near.and_then(|phi| {
        let start = Transport::start(cells, phi.to_vec());
        let solved = newton(&uncorrected(&target), &start, CORRECTABLE, ACCEPTED)?;
        guarded(corrected(&target, solved)?, 0.0)
    });
    if warm.is_some() {
        return warm;
    }
    let mut path = Path {
        state: Transport::start(COARSEST, vec![0.0; COARSEST * COARSEST]),
        log_q: vec![0.0; cells * cells],
        cells,
    };
    let mut first = FIRST_SHARE;
    loop {
        let side = path.state.side as f64;
        let coarse = soften(
            &blur(log_q, cells, BLUR * cells as f64 / side),
            cells,
            FALL * side,
        );
        // What a coarse grid cannot follow to the end, the next one does.
        let arrived = path.follow(&coarse, first, [PASSED; 2]);
        first = if arrived { 1.0 } else { FIRST_SHARE };
        if path.state.side == cells {
            break;
        }
        path.refine();
    }
    let softer = soften(log_q, cells, FALL * cells as f64);
    [log_q, &softer].into_iter().find_map(|density| {
        let softened = moved(log_q, density, cells);
        let mut end = path.clone();
        if softened > SOFTENED_MAX || !end.follow(density, first, [CORRECTABLE, ACCEPTED]) {
            return None;
        }
        guarded(
            corrected(&EdgeSpline::new([density], cells), end.state)?,
            softened,
        )
    })
}

fn uncorrected(log_q: &EdgeSpline) -> Problem<'_> {
    Problem {
        log_q,
        correction: &[],
    }
}

/// Solves again with what the density does within cells, by deferred correction: the correction is that of the last
/// solution, and changes little from one to the next.
fn corrected(log_q: &EdgeSpline, mut state: Transport) -> Option<Transport> {
    for _ in 0..CORRECTIONS {
        let correction = correction(log_q, &state);
        let problem = Problem {
            log_q,
            correction: &correction,
        };
        state = newton(&problem, &state, CONVERGED, ACCEPTED)?;
    }
    Some(state)
}

/// What all guards let through.
fn guarded(transport: Transport, softened: f64) -> Option<Solved> {
    let map = Potential::new(transport.side, &transport.potential);
    let fine = FOLD_SUB * transport.side;
    let (mut folded, mut covered) = (0, 0.0);
    for k in 0..fine * fine {
        let determinant = map.at(cell_centre(k, fine)).determinant();
        folded += usize::from(determinant <= 0.0);
        covered += determinant;
    }
    let places = (fine * fine) as f64;
    let solved = Solved {
        folds: folded as f64 / places,
        uncovered: 1.0 - covered / places,
        transport,
        softened,
    };
    let passes = solved.transport.constant.abs() <= CONSTANT_MAX
        && solved.folds <= FOLDS_MAX
        && solved.uncovered.abs() <= UNCOVERED_MAX;
    passes.then_some(solved)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spline::edge_cell_centre;

    /// Second-order collocation with 32 cells.
    const CLOSED_FORM_TOL: f64 = 2e-3;
    /// Midpoints of a determinant that varies by a factor of three.
    const COVERED_TOL: f64 = 1e-3;

    /// A separable density has the product of one-dimensional inversions as its optimal map.
    #[test]
    fn separable_density_gives_the_inversion_of_each_axis() {
        let n = 32;
        // q(x) = (1 + x)/1.5 has cdf (x + x²/2)/1.5; its inverse at u is √(1 + 3u) − 1.
        let log_q: Vec<f64> = (0..n * n)
            .map(|k| edge_cell_centre(k, n))
            .map(|s| ((1.0 + s[0]) * (2.0 - s[1]) / 2.25).ln())
            .collect();
        let solved = solve(&log_q, n, None).expect("a smooth density");
        assert_eq!((solved.softened, solved.folds), (0.0, 0.0));
        assert!(solved.transport.constant.abs() < CLOSED_FORM_TOL && solved.uncovered.abs() < COVERED_TOL);
        let map = Potential::new(n, &solved.transport.potential);
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
        let warm = solve(&log_q, n, Some(&solved.transport.potential)).expect("its own solution");
        assert!(warm.transport.steps <= 1 + CORRECTIONS);
    }

    #[test]
    fn the_uniform_density_gives_the_identity() {
        let solved = solve(&[0.0; 32 * 32], 32, None).expect("nothing to do");
        assert!(solved.transport.potential.iter().all(|c| *c == 0.0));
    }

    /// A ridge fifty times brighter than one side of its surroundings, bent, with a cliff between the two sides.
    #[test]
    fn cliffs_and_bent_ridges_are_followed() {
        let n = 64;
        let log_q: Vec<f64> = (0..n * n)
            .map(|k| edge_cell_centre(k, n))
            .map(|s| {
                let r = (s[0] - 0.1).hypot(s[1] - 0.2);
                let ridge = (-((r - 0.5) / 0.1).powi(2)).exp();
                let floor = if r > 0.7 { 0.05 } else { 0.2 };
                (floor + 2.5 * ridge).ln()
            })
            .collect();
        let area = |k: usize| crate::spline::edge_cell_weight(k, n) / (n * n) as f64;
        let total: f64 = log_q.iter().enumerate().map(|(k, l)| l.exp() * area(k)).sum();
        let log_q: Vec<f64> = log_q.iter().map(|l| l - total.ln()).collect();
        let solved = solve(&log_q, n, None).expect("continuation follows");
        assert!(solved.folds <= FOLDS_MAX && solved.transport.constant.abs() <= CONSTANT_MAX);
    }
}
