//! The three matrix products of training, as functions compiled for a tier.
//!
//! All have the form C[m, ·] = Σ_k A(m, k)·B[k, ·]: lanes run over the columns of C, a block of rows × vectors
//! of sums stays in registers while k runs, scalars of A are broadcast and rows of B are read in order. What
//! follows a product is done to each block while it is at hand: bias and activation going forward, the chain
//! rule through the activation going back, the sum over tiles for the weights.

use super::activation::Activation;
use bake_runtime::simd::{Simd, Task, Vector};
use std::marker::PhantomData;

/// Rows of a block of [`panel`] vectors: its sums, a row of B and a scalar of A fill the registers.
const WIDE_ROWS: usize = 6;

/// Rows of narrower blocks; rows of a tile's column are a multiple of it.
pub const ROWS: usize = 2 * WIDE_ROWS;

/// Steps of k between two looks at the bounds; depths are padded to a multiple of it, and [`ROWS`] is one.
pub const STEPS: usize = 4;

/// Widths are padded to a multiple of this, or of the lanes if they are more: blocks of up to [`ROWS`] columns
/// that begin before a width's end, at an even place, then end within the padding.
const PAD: usize = 8;

/// Vectors of a block: AVX-512 has 32 registers, the others have 16.
pub const fn panel(lanes: usize) -> usize {
    if lanes >= 16 { 4 } else { 2 }
}

/// `width` rounded up to what a row of it takes.
pub const fn padded(width: usize, lanes: usize) -> usize {
    width.next_multiple_of(if lanes > PAD { lanes } else { PAD })
}

/// Calls `$self.$method::<R, N>($at)` for each panel of `$width` vectors, where N is the panel's width, R the
/// rows of its blocks and `$at` its first vector.
macro_rules! for_panels {
    ($vector:ty, $width:expr, $self:ident . $method:ident) => {
        let width: usize = $width;
        for at in (0..width).step_by(panel(<$vector>::LANES)) {
            match (panel(<$vector>::LANES), width - at) {
                (4, 4..) => $self.$method::<WIDE_ROWS, 4>(at),
                (4, 3) => $self.$method::<WIDE_ROWS, 3>(at),
                (4, 2) => $self.$method::<ROWS, 2>(at),
                (2, 2..) => $self.$method::<WIDE_ROWS, 2>(at),
                _ => $self.$method::<ROWS, 1>(at),
            }
        }
    };
}

/// Adds (R scalars)ᵀ·(N vectors) to `sums`.
#[inline(always)]
fn add_product<V: Vector, const R: usize, const N: usize>(
    sums: &mut [[V; N]; R],
    zero: V,
    left: impl Fn(usize) -> f32,
    right: &[V::Array; N],
) {
    let mut vectors = [zero; N];
    for (vector, right) in vectors.iter_mut().zip(right) {
        *vector = zero.load(right);
    }
    for (r, sums) in sums.iter_mut().enumerate() {
        let left = zero.splat(left(r));
        for (sum, vector) in sums.iter_mut().zip(&vectors) {
            *sum = left.mul_add(*vector, *sum);
        }
    }
}

/// The product of R rows of `left` from row `at` and of the rows of `right`, added to `first` in every row.
#[inline(always)]
fn block_of_rows<V: Vector, const R: usize, const N: usize>(
    zero: V,
    first: [V; N],
    left: Rows,
    at: usize,
    right: &[V::Array],
) -> [[V; N]; R] {
    let right = right.as_chunks::<N>().0.as_chunks::<STEPS>().0;
    let mut rows: [&[[f32; STEPS]]; R] = [&[]; R];
    for (r, row) in rows.iter_mut().enumerate() {
        *row = &left.numbers[(at + r) * left.stride..].as_chunks().0[..right.len()];
    }
    let mut sums = [first; R];
    for (k, right) in right.iter().enumerate() {
        for (step, right) in right.iter().enumerate() {
            add_product(&mut sums, zero, |r| rows[r][k][step], right);
        }
    }
    sums
}

/// Rows of numbers, `stride` apart.
#[derive(Clone, Copy)]
pub struct Rows<'a> {
    /// All of them.
    pub numbers: &'a [f32],
    /// From the start of one to the start of the next.
    pub stride: usize,
}

/// A layer going forward: z = W·x (+ b for values), then y = s(z), ẏ = s'(z)·ż.
///
/// Rows are `columns` blocks of `queries`: values, then one block per tangent.
pub struct Forward<'a, S: Simd, A> {
    pub simd: S,
    pub activation: PhantomData<A>,
    pub queries: usize,
    pub columns: usize,
    /// Rows of x.
    pub left: Rows<'a>,
    /// Wᵀ in panels.
    pub weights: &'a [f32],
    /// One per padded output.
    pub bias: &'a [f32],
    /// Rows of y, as wide as `bias`.
    pub out: &'a mut [f32],
    /// s'(z) for each query.
    pub slope: &'a mut [f32],
    /// s''(z) for each query: only needed in here.
    pub bend: &'a mut [f32],
    /// s''(z)·ż for each query and tangent.
    pub turn: &'a mut [f32],
}

impl<S: Simd, A: Activation> Forward<'_, S, A> {
    #[inline(always)]
    fn panel<const R: usize, const N: usize>(&mut self, at: usize) {
        let zero = self.simd.splat(0.0);
        let width = self.bias.len() / S::Vector::LANES;
        let depth = self.weights.len() / self.bias.len();
        let weights = &S::Vector::arrays(self.weights)[at * depth..(at + N) * depth];
        let bias = &S::Vector::arrays(self.bias)[at..at + N];
        let out = S::Vector::arrays_mut(self.out);
        let slope = S::Vector::arrays_mut(self.slope);
        let bend = S::Vector::arrays_mut(self.bend);
        let turn = S::Vector::arrays_mut(self.turn);
        for column in 0..self.columns {
            for query in (0..self.queries).step_by(R) {
                let first = column * self.queries + query;
                let mut start = [zero; N];
                if column == 0 {
                    for (start, bias) in start.iter_mut().zip(bias) {
                        *start = zero.load(bias);
                    }
                }
                let sums: [[S::Vector; N]; R] = block_of_rows(zero, start, self.left, first, weights);
                for (r, sums) in sums.into_iter().enumerate() {
                    let out = &mut out[(first + r) * width + at..][..N];
                    let place = (query + r) * width + at;
                    if column == 0 {
                        for i in 0..N {
                            let [value, first, second] = A::at(sums[i]);
                            value.write(&mut out[i]);
                            if A::HIDDEN {
                                first.write(&mut slope[place + i]);
                            }
                            if A::CURVED && self.columns > 1 {
                                second.write(&mut bend[place + i]);
                            }
                        }
                    } else {
                        let offset = (column - 1) * self.queries * width + place;
                        for i in 0..N {
                            let z = sums[i];
                            if A::HIDDEN {
                                (z * zero.load(&slope[place + i])).write(&mut out[i]);
                            } else {
                                z.write(&mut out[i]);
                            }
                            if A::CURVED {
                                (z * zero.load(&bend[place + i])).write(&mut turn[offset + i]);
                            }
                        }
                    }
                }
            }
        }
    }
}

impl<S: Simd, A: Activation> Task for Forward<'_, S, A> {
    #[inline(always)]
    fn run(mut self) {
        for_panels!(S::Vector, self.bias.len() / S::Vector::LANES, self.panel);
    }
}

/// A layer going back: ȳ = Wᵀ·z̄ of the layer above, then the activation below it:
/// z̄ = ȳ·s' + Σ_t ȳ_t·s''·ż_t for values, z̄_t = ȳ_t·s' for tangents.
pub struct Backward<'a, S: Simd> {
    pub simd: S,
    pub queries: usize,
    pub columns: usize,
    /// Rows of z̄ above.
    pub left: Rows<'a>,
    /// W in panels.
    pub weights: &'a [f32],
    /// s'(z) for each query.
    pub slope: &'a [f32],
    /// s''(z)·ż for each query and tangent; empty where s'' = 0.
    pub turn: &'a [f32],
    /// Rows of z̄, as wide as `bias`.
    pub out: &'a mut [f32],
    /// To which z̄ of the values is added: the gradient by the bias.
    pub bias: &'a mut [f32],
}

impl<S: Simd> Backward<'_, S> {
    #[inline(always)]
    fn panel<const R: usize, const N: usize>(&mut self, at: usize) {
        let zero = self.simd.splat(0.0);
        let width = self.bias.len() / S::Vector::LANES;
        let depth = self.weights.len() / self.bias.len();
        let weights = &S::Vector::arrays(self.weights)[at * depth..(at + N) * depth];
        let slope = S::Vector::arrays(self.slope);
        let turn = S::Vector::arrays(self.turn);
        let out = S::Vector::arrays_mut(self.out);
        let bias = &mut S::Vector::arrays_mut(self.bias)[at..at + N];
        let curved = self.columns > 1 && !turn.is_empty();
        // The values come last: they gather what the tangents leave in their place.
        for column in (0..self.columns).rev() {
            for query in (0..self.queries).step_by(R) {
                let first = column * self.queries + query;
                let sums: [[S::Vector; N]; R] =
                    block_of_rows(zero, [zero; N], self.left, first, weights);
                let mut total = [zero; N];
                for (r, sums) in sums.into_iter().enumerate() {
                    let place = (query + r) * width + at;
                    let slope = &slope[place..place + N];
                    if column > 0 {
                        if curved {
                            let offset = (column - 1) * self.queries * width + place;
                            for i in 0..N {
                                let turned = sums[i] * zero.load(&turn[offset + i]);
                                let turned = match column + 1 == self.columns {
                                    true => turned,
                                    false => turned + zero.load(&out[place + i]),
                                };
                                turned.write(&mut out[place + i]);
                            }
                        }
                        let out = &mut out[(first + r) * width + at..][..N];
                        for i in 0..N {
                            (sums[i] * zero.load(&slope[i])).write(&mut out[i]);
                        }
                    } else {
                        let out = &mut out[place..place + N];
                        for i in 0..N {
                            let mut value = sums[i] * zero.load(&slope[i]);
                            if curved {
                                value = value + zero.load(&out[i]);
                            }
                            value.write(&mut out[i]);
                            total[i] = total[i] + value;
                        }
                    }
                }
                if column == 0 {
                    for (bias, total) in bias.iter_mut().zip(total) {
                        (zero.load(bias) + total).write(bias);
                    }
                }
            }
        }
    }
}

impl<S: Simd> Task for Backward<'_, S> {
    #[inline(always)]
    fn run(mut self) {
        for_panels!(S::Vector, self.bias.len() / S::Vector::LANES, self.panel);
    }
}

/// The gradient by the weights: W̄[o, i] += Σ over rows of z̄[o]·x[i].
pub struct Weights<'a, S: Simd> {
    pub simd: S,
    pub outputs: usize,
    /// Rows of z̄.
    pub left: Rows<'a>,
    /// Rows of x, padded.
    pub right: Rows<'a>,
    /// W̄, rows of outputs as wide as those of x; their number is even.
    pub gradient: &'a mut [f32],
}

impl<S: Simd> Weights<'_, S> {
    #[inline(always)]
    fn panel<const R: usize, const N: usize>(&mut self, at: usize) {
        let mut output = 0;
        while output + R <= self.outputs {
            self.rows::<R, N>(output, at);
            output += R;
        }
        while output < self.outputs {
            match self.outputs - output {
                5.. => self.rows::<6, N>(output, at),
                3 | 4 => self.rows::<4, N>(output, at),
                _ => self.rows::<2, N>(output, at),
            }
            output += 6;
        }
    }

    #[inline(always)]
    fn rows<const R: usize, const N: usize>(&mut self, output: usize, at: usize) {
        let zero = self.simd.splat(0.0);
        let width = self.right.stride / S::Vector::LANES;
        let gradient = S::Vector::arrays_mut(self.gradient);
        let mut sums = [[zero; N]; R];
        for (r, sums) in sums.iter_mut().enumerate() {
            let gradient = &gradient[(output + r) * width + at..][..N];
            for (sum, gradient) in sums.iter_mut().zip(gradient) {
                *sum = zero.load(gradient);
            }
        }
        let stride = self.left.stride;
        let left = self.left.numbers.chunks_exact(STEPS * stride);
        let right = S::Vector::arrays(self.right.numbers).chunks_exact(STEPS * width);
        for (left, right) in left.zip(right) {
            for step in 0..STEPS {
                let left = left[step * stride + output..].first_chunk::<R>();
                let right = right[step * width + at..].first_chunk::<N>();
                if let (Some(left), Some(right)) = (left, right) {
                    add_product(&mut sums, zero, |r| left[r], right);
                }
            }
        }
        for (r, sums) in sums.into_iter().enumerate() {
            let gradient = &mut gradient[(output + r) * width + at..][..N];
            for (sum, gradient) in sums.into_iter().zip(gradient) {
                sum.write(gradient);
            }
        }
    }
}

impl<S: Simd> Task for Weights<'_, S> {
    #[inline(always)]
    fn run(mut self) {
        for_panels!(S::Vector, self.right.stride / S::Vector::LANES, self.panel);
    }
}
