//! The step of Muon: a momentum matrix made orthogonal by five steps of a quintic Newton–Schulz iteration.
//!
//! Source: Jordan et al. 2024, *Muon: An optimizer for hidden layers*. The iteration runs once a step on every
//! hidden matrix, so its products are held in registers a tile at a time, as wide as the processor allows.

use pulp::Arch;

/// Coefficients a, b, c of one iteration, X ← aX + (bA + cA²)X with A = XXᵀ.
const QUINTIC: [f32; 3] = [3.4445, -4.775, 2.0315];
/// Number of iterations.
const QUINTIC_STEPS: usize = 5;
/// Added to the norm, so that a matrix of zeros stays one.
const NORM_MIN: f64 = 1e-7;

/// Columns of a tile: one AVX-512 register, two of AVX2.
const LANES: usize = 16;
/// Rows of a tile: with [`LANES`] twelve accumulators of AVX2, which leaves four registers for the factors.
const ROWS: usize = 6;

/// A row-major matrix whose rows are padded with zeros to whole chunks.
#[derive(Clone, Debug)]
struct Matrix {
    rows: usize,
    columns: usize,
    /// Chunks of a row.
    chunks: usize,
    data: Vec<[f32; LANES]>,
}

impl Matrix {
    fn zeros(rows: usize, columns: usize) -> Matrix {
        let chunks = columns.div_ceil(LANES);
        Matrix {
            rows,
            columns,
            chunks,
            data: vec![[0.0; LANES]; rows * chunks],
        }
    }

    /// The `rows` × `columns` matrix of values `at(row, column)`.
    fn from_fn(rows: usize, columns: usize, at: impl Fn(usize, usize) -> f32) -> Matrix {
        let mut m = Matrix::zeros(rows, columns);
        for i in 0..rows {
            let row = m.data[i * m.chunks..(i + 1) * m.chunks].as_flattened_mut();
            row[..columns]
                .iter_mut()
                .enumerate()
                .for_each(|(j, v)| *v = at(i, j));
        }
        m
    }

    fn row(&self, i: usize) -> &[f32] {
        &self.data[i * self.chunks..(i + 1) * self.chunks].as_flattened()[..self.columns]
    }

    fn transposed(&self) -> Matrix {
        let values = self.data.as_flattened();
        let stride = self.chunks * LANES;
        Matrix::from_fn(self.columns, self.rows, |i, j| values[j * stride + i])
    }

    /// `self`·`other`. Every element is summed in the order of its terms, whatever the width of the registers.
    #[inline(always)]
    fn times(&self, other: &Matrix) -> Matrix {
        let mut product = Matrix::zeros(self.rows, other.columns);
        for chunk in 0..other.chunks {
            let mut i = 0;
            while i + ROWS <= self.rows {
                self.tile::<ROWS>(other, &mut product, i, chunk);
                i += ROWS;
            }
            while i < self.rows {
                self.tile::<1>(other, &mut product, i, chunk);
                i += 1;
            }
        }
        product
    }

    /// `R` rows from `i` on of one chunk of the product.
    #[inline(always)]
    fn tile<const R: usize>(&self, other: &Matrix, product: &mut Matrix, i: usize, chunk: usize) {
        let rows: [&[f32]; R] = std::array::from_fn(|r| self.row(i + r));
        let mut sums = [[0.0f32; LANES]; R];
        let panel = other.data[chunk..].iter().step_by(other.chunks);
        for (l, values) in panel.take(self.columns).enumerate() {
            for (sum, row) in sums.iter_mut().zip(&rows) {
                let factor = row[l];
                for (s, v) in sum.iter_mut().zip(values) {
                    *s = factor.mul_add(*v, *s);
                }
            }
        }
        for (r, sum) in sums.into_iter().enumerate() {
            product.data[(i + r) * product.chunks + chunk] = sum;
        }
    }

    /// One iteration.
    #[inline(always)]
    fn quintic(&self) -> Matrix {
        let [a, b, c] = QUINTIC;
        let mut mix = self.times(&self.transposed());
        let square = mix.times(&mix);
        for (m, s) in mix
            .data
            .as_flattened_mut()
            .iter_mut()
            .zip(square.data.as_flattened())
        {
            *m = b * *m + c * s;
        }
        let mut next = mix.times(self);
        for (n, x) in next
            .data
            .as_flattened_mut()
            .iter_mut()
            .zip(self.data.as_flattened())
        {
            *n += a * x;
        }
        next
    }
}

/// About the orthogonal matrix nearest to `momentum` (row-major, `rows` × `columns`): the same singular vectors,
/// with singular values near 1 where they were not far below the largest.
pub fn orthogonalised(momentum: &[f32], rows: usize, columns: usize) -> Vec<f32> {
    let square: f64 = momentum.iter().map(|&g| f64::from(g) * f64::from(g)).sum();
    let scale = (1.0 / (square.sqrt() + NORM_MIN)) as f32;
    // The short side is the side of the square products.
    let tall = rows > columns;
    let mut x = if tall {
        Matrix::from_fn(columns, rows, |i, j| scale * momentum[j * columns + i])
    } else {
        Matrix::from_fn(rows, columns, |i, j| scale * momentum[i * columns + j])
    };
    Arch::new().dispatch(|| {
        for _ in 0..QUINTIC_STEPS {
            x = x.quintic();
        }
    });
    if tall {
        x = x.transposed();
    }
    (0..rows).flat_map(|i| x.row(i)).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::Rng;

    /// Round-off of up to 40 products of numbers below 1, fused or not.
    const PRODUCT_TOL: f64 = 1e-5;

    #[test]
    fn tiles_multiply_like_the_definition() {
        let mut rng = Rng::new(&[41]);
        for (m, k, n) in [(1, 1, 1), (5, 3, 17), (6, 16, 16), (13, 40, 33)] {
            let a: Vec<f32> = (0..m * k).map(|_| rng.uniform() as f32 - 0.5).collect();
            let b: Vec<f32> = (0..k * n).map(|_| rng.uniform() as f32 - 0.5).collect();
            let left = Matrix::from_fn(m, k, |i, j| a[i * k + j]);
            let product = left.times(&Matrix::from_fn(n, k, |i, j| b[j * n + i]).transposed());
            for i in 0..m {
                for j in 0..n {
                    let expected: f64 = (0..k)
                        .map(|l| f64::from(a[i * k + l]) * f64::from(b[l * n + j]))
                        .sum();
                    assert!((f64::from(product.row(i)[j]) - expected).abs() < PRODUCT_TOL);
                }
            }
        }
    }

    #[test]
    fn a_matrix_of_zeros_stays_one() {
        assert_eq!(orthogonalised(&[0.0; 6], 2, 3), [0.0; 6]);
    }
}
