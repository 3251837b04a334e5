//! The step of Muon: a momentum matrix made orthogonal by five steps of a quintic Newton–Schulz iteration.
//!
//! Source: Jordan et al. 2024, *Muon: An optimizer for hidden layers*. The iteration runs once a step on every
//! hidden matrix, so its products are held in registers a tile at a time, as wide as the processor allows.

use pulp::{Arch, Simd, WithSimd};

/// Coefficients a, b, c of one iteration, X ← aX + (bA + cA²)X with A = XXᵀ.
const QUINTIC: [f32; 3] = [3.4445, -4.775, 2.0315];
/// Number of iterations.
const QUINTIC_STEPS: usize = 5;
/// Added to the norm, so that a matrix of zeros stays one.
const NORM_MIN: f64 = 1e-7;

/// Rows of a tile. With [`VECTORS`] this makes twelve accumulators, which leaves AVX2 four registers for the factors.
const ROWS: usize = 6;
/// Registers side by side in a row of a tile.
const VECTORS: usize = 2;
/// Rows are padded to multiples of this: [`VECTORS`] registers of AVX-512, the widest there are.
const PADDING: usize = 32;

/// A row-major matrix whose rows are padded with zeros.
#[derive(Clone, Debug)]
struct Matrix {
    rows: usize,
    columns: usize,
    /// Distance between rows.
    stride: usize,
    data: Vec<f32>,
}

impl Matrix {
    fn zeros(rows: usize, columns: usize) -> Matrix {
        let stride = columns.next_multiple_of(PADDING);
        Matrix {
            rows,
            columns,
            stride,
            data: vec![0.0; rows * stride],
        }
    }

    /// The `rows` × `columns` matrix of values `at(row, column)`.
    fn from_fn(rows: usize, columns: usize, at: impl Fn(usize, usize) -> f32) -> Matrix {
        let mut m = Matrix::zeros(rows, columns);
        for (i, row) in m.data.chunks_exact_mut(m.stride).enumerate() {
            let own = row[..columns].iter_mut().enumerate();
            own.for_each(|(j, v)| *v = at(i, j));
        }
        m
    }

    fn row(&self, i: usize) -> &[f32] {
        &self.data[i * self.stride..][..self.columns]
    }

    fn transposed(&self) -> Matrix {
        Matrix::from_fn(self.columns, self.rows, |i, j| self.data[j * self.stride + i])
    }

    /// `self`·`other`. Every element is summed in the order of its terms, whatever the width of the registers.
    #[inline(always)]
    fn times<S: Simd>(&self, other: &Matrix, simd: S) -> Matrix {
        let mut product = Matrix::zeros(self.rows, other.columns);
        for vector in (0..other.stride / S::F32_LANES).step_by(VECTORS) {
            let whole = self.rows - self.rows % ROWS;
            for i in (0..whole).step_by(ROWS) {
                self.tile::<S, ROWS>(other, &mut product, i, vector, simd);
            }
            for i in whole..self.rows {
                self.tile::<S, 1>(other, &mut product, i, vector, simd);
            }
        }
        product
    }

    /// `R` rows of the product from `i` on, [`VECTORS`] registers from the one numbered `vector` on.
    #[inline(always)]
    fn tile<S: Simd, const R: usize>(
        &self,
        other: &Matrix,
        product: &mut Matrix,
        i: usize,
        vector: usize,
        simd: S,
    ) {
        let rows: [&[f32]; R] = std::array::from_fn(|r| self.row(i + r));
        let stride = other.stride / S::F32_LANES;
        let (values, _) = S::as_simd_f32s(&other.data);
        let mut sums = [[simd.splat_f32s(0.0); VECTORS]; R];
        for l in 0..self.columns {
            let line = &values[l * stride + vector..][..VECTORS];
            for r in 0..R {
                let factor = simd.splat_f32s(rows[r][l]);
                for v in 0..VECTORS {
                    sums[r][v] = simd.mul_add_f32s(factor, line[v], sums[r][v]);
                }
            }
        }
        let (out, _) = S::as_mut_simd_f32s(&mut product.data);
        for (r, sum) in sums.iter().enumerate() {
            out[(i + r) * stride + vector..][..VECTORS].copy_from_slice(sum);
        }
    }

    /// One iteration.
    #[inline(always)]
    fn quintic<S: Simd>(&self, simd: S) -> Matrix {
        let [a, b, c] = QUINTIC;
        let mut mix = self.times(&self.transposed(), simd);
        let square = mix.times(&mix, simd);
        let pairs = mix.data.iter_mut().zip(&square.data);
        pairs.for_each(|(m, s)| *m = b * *m + c * s);
        let mut next = mix.times(self, simd);
        let pairs = next.data.iter_mut().zip(&self.data);
        pairs.for_each(|(n, x)| *n += a * x);
        next
    }
}

/// All iterations from a matrix on.
struct Iteration(Matrix);

impl WithSimd for Iteration {
    type Output = Matrix;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Matrix {
        let mut x = self.0;
        for _ in 0..QUINTIC_STEPS {
            x = x.quintic(simd);
        }
        x
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
    x = Arch::new().dispatch(Iteration(x));
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

    struct Product(Matrix, Matrix);

    impl WithSimd for Product {
        type Output = Matrix;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Matrix {
            self.0.times(&self.1, simd)
        }
    }

    #[test]
    fn tiles_multiply_like_the_definition() {
        let mut rng = Rng::new(&[41]);
        for (m, k, n) in [(1, 1, 1), (5, 3, 17), (6, 16, 16), (13, 40, 33)] {
            let a: Vec<f32> = (0..m * k).map(|_| rng.uniform() as f32 - 0.5).collect();
            let b: Vec<f32> = (0..k * n).map(|_| rng.uniform() as f32 - 0.5).collect();
            let left = Matrix::from_fn(m, k, |i, j| a[i * k + j]);
            let right = Matrix::from_fn(n, k, |i, j| b[j * n + i]).transposed();
            let product = Arch::new().dispatch(Product(left, right));
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
