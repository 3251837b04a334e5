//! A density on [−1, 1]² in even pixels: what the solvers of the paper start from.

use crate::error::{Error, Result};

/// Probability mass per pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster {
    /// Pixels per side.
    pub side: usize,
    /// Masses, `side`², x fastest, y upwards from −1; their sum is 1.
    pub mass: Vec<f64>,
}

impl Raster {
    /// Normalises `values` (≥ 0, `side`², x fastest).
    ///
    /// # Errors
    /// [`Error::Density`] when there are not `side`² values, one is negative or not finite, or all are zero.
    pub fn new(side: usize, values: &[f64]) -> Result<Raster> {
        let refuse = |reason: String| Err(Error::Density { reason });
        if side == 0 || values.len() != side * side {
            return refuse(format!("{} values for {side} × {side} pixels", values.len()));
        }
        if let Some(k) = values.iter().position(|v| !v.is_finite() || *v < 0.0) {
            let (x, y) = (k % side, k / side);
            return refuse(format!(
                "the value at column {x}, row {y} is {}; all must be finite and not negative",
                values[k]
            ));
        }
        let sum: f64 = values.iter().sum();
        if sum <= 0.0 || !sum.is_finite() {
            return refuse("it is zero everywhere, so there is nothing to sample".into());
        }
        Ok(Raster {
            side,
            mass: values.iter().map(|v| v / sum).collect(),
        })
    }
}

/// Sums of values in pixels below and left of every point of the unit square.
pub struct Sums {
    side: usize,
    /// At the corners of pixels, `(side + 1)`².
    corners: Vec<f64>,
}

impl Sums {
    /// Of `values`, `side`², x fastest.
    pub fn new(values: &[f64], side: usize) -> Sums {
        let wide = side + 1;
        let mut corners = vec![0.0; wide * wide];
        for j in 0..side {
            let mut row = 0.0;
            for i in 0..side {
                row += values[j * side + i];
                corners[(j + 1) * wide + i + 1] = corners[j * wide + i + 1] + row;
            }
        }
        Sums { side, corners }
    }

    /// The sum up to corner (i, j).
    pub fn corner(&self, i: usize, j: usize) -> f64 {
        self.corners[j * (self.side + 1) + i]
    }

    /// The sum up to `(x, y)`: bilinear between corners, as values are constant in pixels.
    fn at(&self, x: f64, y: f64) -> f64 {
        let locate = |v: f64| {
            let v = v * self.side as f64;
            let i = (v as usize).min(self.side - 1);
            (i, v - i as f64)
        };
        let ((i, s), (j, t)) = (locate(x), locate(y));
        (1.0 - t) * ((1.0 - s) * self.corner(i, j) + s * self.corner(i + 1, j))
            + t * ((1.0 - s) * self.corner(i, j + 1) + s * self.corner(i + 1, j + 1))
    }

    /// Mean value over a rectangle of the unit square, to round-off of the whole sum.
    pub fn mean(&self, [left, right]: [f64; 2], [bottom, top]: [f64; 2]) -> f64 {
        let sum = self.at(right, top) - self.at(left, top) - self.at(right, bottom) + self.at(left, bottom);
        sum / ((right - left) * (top - bottom) * (self.side * self.side) as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Round-off of sums of a few thousand values.
    const ROUND_OFF: f64 = 1e-9;

    #[test]
    fn sums_are_means_of_pixels() {
        let values: Vec<f64> = (0..16).map(|k| 1.0 + k as f64).collect();
        let sums = Sums::new(&values, 4);
        assert!((sums.mean([0.25, 0.5], [0.5, 0.75]) - 10.0).abs() < ROUND_OFF);
        assert!((sums.mean([0.0, 1.0], [0.0, 1.0]) - 8.5).abs() < ROUND_OFF);
        assert!((sums.mean([0.125, 0.375], [0.0, 0.25]) - 1.5).abs() < ROUND_OFF);
    }
}
