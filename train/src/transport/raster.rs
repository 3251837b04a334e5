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
