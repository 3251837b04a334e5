//! The three matrix products of training, as functions compiled for a tier.
//!
//! All have the form C[m, ·] = Σ_k A(m, k)·B[k, ·]: lanes run over the columns of C, a block of rows × vectors
//! of sums stays in registers while k runs, scalars of A are broadcast and rows of B are read in order. What
//! follows a product is done to each block while it is at hand: bias and activation going forward, the chain
//! rule through the activation going back, the sum over tiles for the weights.

use super::activation::Activation;
use bake_runtime::simd::{Several, Simd, Task, Vector};
use std::marker::PhantomData;

/// Rows of a block of [`panel`] vectors: its sums, a row of B and a scalar of A fill the registers.
const WIDE_ROWS: usize = 6;

/// Rows of narrower blocks; rows of a tile's column are a multiple of it.
pub const ROWS: usize = 2 * WIDE_ROWS;

/// Widths are padded to a multiple of this, or of the lanes if they are more: an even number of columns of A
/// may then be one more than there are.
const PAD: usize = 8;

/// Vectors of a block: AVX-512 has 32 registers, the others have 16.
pub const fn panel(lanes: usize) -> usize {
    if lanes >= 16 { 4 } else { 2 }
}

/// `width` rounded up to what a row of it takes.
pub const fn padded(width: usize, lanes: usize) -> usize {
    width.next_multiple_of(if lanes > PAD { lanes } else { PAD })
}

/// A row of a block.
type Wide<S, const N: usize> = Several<<S as Simd>::Vector, N>;

/// Calls `$self.$method::<R, N>($at)` for each panel of `$width` numbers, where N is the panel's width in
/// vectors, R the rows of its blocks and `$at` its first number.
macro_rules! for_panels {
    ($vector:ty, $width:expr, $self:ident . $method:ident) => {
        let lanes = <$vector>::LANES;
        let width: usize = $width;
        for at in (0..width).step_by(panel(lanes) * lanes) {
            match (panel(lanes), (width - at) / lanes) {
                (4, 4..) => $self.$method::<WIDE_ROWS, 4>(at),
                (4, 3) => $self.$method::<WIDE_ROWS, 3>(at),
                (4, 2) => $self.$method::<ROWS, 2>(at),
                (2, 2..) => $self.$method::<WIDE_ROWS, 2>(at),
                _ => $self.$method::<ROWS, 1>(at),
            }
        }
    };
}

/// The vector's numbers from `start`.
#[inline(always)]
fn piece<V: Vector>(numbers: &[f32], start: usize) -> &V::Array {
    &V::arrays(&numbers[start..])[0]
}

/// The same to be written.
#[inline(always)]
fn piece_mut<V: Vector>(numbers: &mut [f32], start: usize) -> &mut V::Array {
    &mut V::arrays_mut(&mut numbers[start..])[0]
}

/// Adds R scalars times the vector `right` to `sums`.
#[inline(always)]
fn add_product<V: Vector, const R: usize>(sums: &mut [V; R], left: impl Fn(usize) -> f32, right: V) {
    for (r, sum) in sums.iter_mut().enumerate() {
        *sum = right.splat(left(r)).mul_add(right, *sum);
    }
}

/// The product of R rows of `left` from row `at` and of the rows of `right`, added to `first` in every row.
#[inline(always)]
fn block_of_rows<V: Vector, const R: usize>(first: V, left: Rows, at: usize, right: &[V::Array]) -> [V; R] {
    // All of one length, so that no index needs a look at the bounds.
    let mut rows: [&[f32]; R] = [&[]; R];
    for (r, row) in rows.iter_mut().enumerate() {
        *row = &left.numbers[(at + r) * left.stride..][..right.len()];
    }
    let mut sums = [first; R];
    for (k, right) in right.iter().enumerate() {
        add_product(&mut sums, |r| rows[r][k], first.load(right));
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
        let zero = Wide::<S, N>::repeat(self.simd.splat(0.0));
        let width = self.bias.len();
        let depth = self.weights.len() / width;
        let weights = &Wide::<S, N>::arrays(&self.weights[at * depth..])[..depth];
        let bent = A::CURVED && self.columns > 1;
        for column in 0..self.columns {
            for query in (0..self.queries).step_by(R) {
                let start = match column {
                    0 => zero.load(piece::<Wide<S, N>>(self.bias, at)),
                    _ => zero,
                };
                let first = column * self.queries + query;
                let sums: [_; R] = block_of_rows(start, self.left, first, weights);
                for (r, &z) in sums.iter().enumerate() {
                    let out = piece_mut::<Wide<S, N>>(self.out, (first + r) * width + at);
                    let place = (query + r) * width + at;
                    if !A::HIDDEN {
                        z.write(out);
                    } else if column > 0 {
                        (z * zero.load(piece::<Wide<S, N>>(self.slope, place))).write(out);
                        if bent {
                            let bend = zero.load(piece::<Wide<S, N>>(self.bend, place));
                            let place = (column - 1) * self.queries * width + place;
                            (z * bend).write(piece_mut::<Wide<S, N>>(self.turn, place));
                        }
                    } else {
                        let [value, slope, bend] = A::at(z);
                        value.write(out);
                        slope.write(piece_mut::<Wide<S, N>>(self.slope, place));
                        if bent {
                            bend.write(piece_mut::<Wide<S, N>>(self.bend, place));
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
        for_panels!(S::Vector, self.bias.len(), self.panel);
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
        let zero = Wide::<S, N>::repeat(self.simd.splat(0.0));
        let width = self.bias.len();
        let depth = self.weights.len() / width;
        let weights = &Wide::<S, N>::arrays(&self.weights[at * depth..])[..depth];
        let curved = self.columns > 1 && !self.turn.is_empty();
        // The values come last: they gather what the tangents leave in their place.
        for column in (0..self.columns).rev() {
            for query in (0..self.queries).step_by(R) {
                let first = column * self.queries + query;
                let sums: [_; R] = block_of_rows(zero, self.left, first, weights);
                let mut total = zero;
                for (r, &adjoint) in sums.iter().enumerate() {
                    let place = (query + r) * width + at;
                    let slope = zero.load(piece::<Wide<S, N>>(self.slope, place));
                    let mut gathered = zero;
                    if curved && column + 1 < self.columns {
                        gathered = zero.load(piece::<Wide<S, N>>(self.out, place));
                    }
                    if column == 0 {
                        let value = adjoint.mul_add(slope, gathered);
                        value.write(piece_mut::<Wide<S, N>>(self.out, place));
                        total = total + value;
                        continue;
                    }
                    if curved {
                        let turn = (column - 1) * self.queries * width + place;
                        let turn = zero.load(piece::<Wide<S, N>>(self.turn, turn));
                        let gathered = adjoint.mul_add(turn, gathered);
                        gathered.write(piece_mut::<Wide<S, N>>(self.out, place));
                    }
                    let out = piece_mut::<Wide<S, N>>(self.out, (first + r) * width + at);
                    (adjoint * slope).write(out);
                }
                if column == 0 {
                    let bias = piece_mut::<Wide<S, N>>(self.bias, at);
                    (zero.load(bias) + total).write(bias);
                }
            }
        }
    }
}

impl<S: Simd> Task for Backward<'_, S> {
    #[inline(always)]
    fn run(mut self) {
        for_panels!(S::Vector, self.bias.len(), self.panel);
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
        let zero = Wide::<S, N>::repeat(self.simd.splat(0.0));
        let width = self.right.stride;
        let mut sums = [zero; R];
        for (r, sum) in sums.iter_mut().enumerate() {
            let place = (output + r) * width + at;
            *sum = zero.load(piece::<Wide<S, N>>(self.gradient, place));
        }
        let left = self.left.numbers.chunks_exact(self.left.stride);
        for (left, right) in left.zip(self.right.numbers.chunks_exact(width)) {
            if let Some(left) = left[output..].first_chunk::<R>() {
                let right = zero.load(piece::<Wide<S, N>>(right, at));
                add_product(&mut sums, |r| left[r], right);
            }
        }
        for (r, sum) in sums.iter().enumerate() {
            let place = (output + r) * width + at;
            sum.write(piece_mut::<Wide<S, N>>(self.gradient, place));
        }
    }
}

impl<S: Simd> Task for Weights<'_, S> {
    #[inline(always)]
    fn run(mut self) {
        for_panels!(S::Vector, self.right.stride, self.panel);
    }
}
