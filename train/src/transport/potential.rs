//! The potential of a map of the unit square onto itself: a bicubic B-spline φ whose gradient moves u to u + ∇φ(u).
//!
//! The spline is mirrored at the edges, so ∂φ/∂n = 0 there: every edge is carried onto itself, whatever the
//! coefficients. Map and determinant are those of one twice differentiable function, with no grid in between.

use crate::spline::{curvatures, mirror, prefilter, weights};

/// Coefficients added on each side so that lookups at the edge stay inside the array.
const PAD: usize = 2;

/// A potential by its B-spline coefficients.
#[derive(Clone, Debug, PartialEq)]
pub struct Potential {
    /// Cells per side.
    pub side: usize,
    padded: Vec<f64>,
}

/// What a potential does at one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Local {
    /// φ.
    pub value: f64,
    /// u + ∇φ, in the unit square wherever the map does not fold.
    pub image: [f64; 2],
    /// The derivative I + D²φ: its diagonal, and its other element.
    pub derivative: [f64; 3],
}

impl Local {
    /// Determinant of the derivative.
    pub fn determinant(&self) -> f64 {
        let [a, b, m] = self.derivative;
        a * b - m * m
    }
}

impl Potential {
    /// The potential with these coefficients (`side`², first coordinate fastest), one per cell centre.
    pub fn new(side: usize, coefficients: &[f64]) -> Potential {
        let wide = side + 2 * PAD;
        let node = |k: usize| mirror(k as isize - PAD as isize, side);
        let padded = (0..wide * wide)
            .map(|k| coefficients[node(k / wide) * side + node(k % wide)])
            .collect();
        Potential { side, padded }
    }

    /// Everything at `u`, clamped to the unit square.
    pub fn at(&self, u: [f64; 2]) -> Local {
        let n = self.side as f64;
        let wide = self.side + 2 * PAD;
        let u = u.map(|v| v.clamp(0.0, 1.0));
        let locate = |v: f64| {
            let x = v * n - 0.5;
            let i = x.floor().clamp(-1.0, n - 1.0);
            let (value, slope) = weights(x - i);
            ((i + 1.0) as usize, value, slope, curvatures(x - i))
        };
        let (i, wx, dx, sx) = locate(u[0]);
        let (j, wy, dy, sy) = locate(u[1]);
        let [mut value, mut x, mut y, mut xx, mut yy, mut xy] = [0.0; 6];
        for r in 0..4 {
            let row = &self.padded[(j + r) * wide + i..(j + r) * wide + i + 4];
            let dot = |w: &[f64; 4]| row.iter().zip(w).map(|(c, w)| c * w).sum::<f64>();
            let (line, slope, curvature) = (dot(&wx), dot(&dx), dot(&sx));
            value += wy[r] * line;
            x += wy[r] * slope;
            xx += wy[r] * curvature;
            y += dy[r] * line;
            xy += dy[r] * slope;
            yy += sy[r] * line;
        }
        Local {
            value,
            image: [u[0] + n * x, u[1] + n * y],
            derivative: [1.0 + n * n * xx, 1.0 + n * n * yy, n * n * xy],
        }
    }

    /// Coefficients of the same function on a grid of `side`.
    pub fn resampled(&self, side: usize) -> Vec<f64> {
        let mut values: Vec<f64> = (0..side * side)
            .map(|k| self.at(crate::spline::cell_centre(k, side)).value)
            .collect();
        prefilter(&mut values, side);
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Central differences with step 1e-5 of a function with derivatives of order 10.
    const DIFFERENCE_TOL: f64 = 1e-6;
    /// Round-off of positions at the edge.
    const EDGE_TOL: f64 = 1e-12;

    #[test]
    fn derivatives_belong_to_the_image_and_edges_stay_edges() {
        let n = 16;
        let wave = |k: usize| 0.002 * ((k % n) as f64 * 0.7).sin() * ((k / n) as f64 * 0.4).cos();
        let potential = Potential::new(n, &(0..n * n).map(wave).collect::<Vec<_>>());
        let h = 1e-5;
        for k in 0..400 {
            let u = bake_runtime::bsdf::shifted_r2(k, [0.0; 2]).map(|v| v.clamp(h, 1.0 - h));
            let here = potential.at(u);
            let step = |d: [f64; 2]| {
                let (a, b) = (
                    potential.at([u[0] + d[0], u[1] + d[1]]),
                    potential.at([u[0] - d[0], u[1] - d[1]]),
                );
                [0, 1].map(|c: usize| (a.image[c] - b.image[c]) / (2.0 * h))
            };
            let (x, y) = (step([h, 0.0]), step([0.0, h]));
            let [a, b, m] = here.derivative;
            for (found, expected) in [(x[0], a), (x[1], m), (y[0], m), (y[1], b)] {
                assert!(
                    (found - expected).abs() < DIFFERENCE_TOL,
                    "{found} {expected} at {u:?}"
                );
            }
            for (edge, c) in [
                ([0.0, u[1]], 0),
                ([1.0, u[1]], 0),
                ([u[0], 0.0], 1),
                ([u[0], 1.0], 1),
            ] {
                assert!((potential.at(edge).image[c] - edge[c]).abs() < EDGE_TOL);
            }
        }
    }
}
