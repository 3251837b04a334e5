//! Direct solver for the banded linear systems of Newton's method on a grid.
//!
//! Source: Golub and Van Loan 2013, *Matrix Computations*, Alg. 4.3.1. No pivoting: the linearised
//! Monge–Ampère operator is elliptic with its advection well resolved; the caller's line search
//! rejects the step should a system ever be worse than that.

/// A square matrix whose entries lie within `bandwidth` of the diagonal.
#[derive(Clone, Debug)]
pub struct Banded {
    size: usize,
    bandwidth: usize,
    /// Row i holds columns `i − bandwidth ..= i + bandwidth`.
    rows: Vec<f64>,
}

impl Banded {
    /// The zero matrix.
    pub fn zeros(size: usize, bandwidth: usize) -> Banded {
        Banded {
            size,
            bandwidth,
            rows: vec![0.0; size * (2 * bandwidth + 1)],
        }
    }

    /// Adds `value` at (`row`, `column`), which must lie in the band.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        let width = 2 * self.bandwidth + 1;
        self.rows[row * width + column + self.bandwidth - row] += value;
    }

    /// Solves for every right-hand side in place, destroying the matrix. `false` on a vanishing pivot.
    #[must_use]
    pub fn solve<const R: usize>(mut self, right: &mut [Vec<f64>; R]) -> bool {
        let (n, w) = (self.size, self.bandwidth);
        let width = 2 * w + 1;
        for k in 0..n {
            let pivot = self.rows[k * width + w];
            if !pivot.is_finite() || pivot == 0.0 {
                return false;
            }
            let last = (k + w).min(n - 1);
            let (head, tail) = self.rows.split_at_mut((k + 1) * width);
            let pivot_row = &head[k * width + w + 1..k * width + w + 1 + (last - k)];
            for i in k + 1..=last {
                let row = &mut tail[(i - k - 1) * width..(i - k) * width];
                let first = k + w - i;
                let factor = row[first] / pivot;
                if factor == 0.0 {
                    continue;
                }
                for (a, p) in row[first + 1..first + 1 + pivot_row.len()]
                    .iter_mut()
                    .zip(pivot_row)
                {
                    *a -= factor * p;
                }
                for column in right.iter_mut() {
                    column[i] -= factor * column[k];
                }
            }
        }
        for i in (0..n).rev() {
            let row = &self.rows[i * width..(i + 1) * width];
            let count = w.min(n - 1 - i);
            for column in right.iter_mut() {
                let known: f64 = row[w + 1..w + 1 + count]
                    .iter()
                    .zip(&column[i + 1..])
                    .map(|(a, x)| a * x)
                    .sum();
                column[i] = (column[i] - known) / row[w];
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::Rng;

    /// Round-off of a diagonally dominant system of 60 unknowns.
    const RESIDUAL_TOL: f64 = 1e-12;

    #[test]
    fn solves_a_random_dominant_system() {
        let (n, w) = (60, 7);
        let mut rng = Rng::new(&[5]);
        let mut matrix = Banded::zeros(n, w);
        let mut dense = vec![0.0; n * n];
        for i in 0..n {
            for j in i.saturating_sub(w)..(i + w + 1).min(n) {
                let value = rng.uniform() - 0.5 + if i == j { 8.0 } else { 0.0 };
                matrix.add(i, j, value);
                dense[i * n + j] = value;
            }
        }
        let x: Vec<f64> = (0..n).map(|_| rng.uniform()).collect();
        let b: Vec<f64> = (0..n)
            .map(|i| (0..n).map(|j| dense[i * n + j] * x[j]).sum())
            .collect();
        let mut right = [b];
        assert!(matrix.solve(&mut right));
        assert!(right[0].iter().zip(&x).all(|(a, b)| (a - b).abs() < RESIDUAL_TOL));
        assert!(!Banded::zeros(3, 1).solve(&mut [vec![1.0; 3]]));
    }
}
