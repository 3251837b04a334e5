//! Dense layers on tiles of queries. Lanes are queries; a block of output rows × query columns stays in
//! registers while it runs over the inputs, so every weight is loaded once per block and every activation is
//! applied before the block leaves its registers.

use super::math::sigmoid;
use super::vector::Vector;
use crate::network::Dense;
use std::marker::PhantomData;

/// Columns of a block with tangents: the value and its derivatives along two inputs.
pub const TANGENT_COLUMNS: usize = 3;

/// Output rows in groups of `R`.
struct Rows<const R: usize> {
    /// Per group, per input: the weights of the group's rows.
    weights: Vec<[f32; R]>,
    /// Per group.
    bias: Vec<[f32; R]>,
}

impl<const R: usize> Rows<R> {
    /// Packs the whole groups among `rows` of `dense`, and returns them with the rows left over.
    fn pack(dense: &Dense, rows: std::ops::Range<usize>) -> (Rows<R>, std::ops::Range<usize>) {
        let mut packed = Rows {
            weights: Vec::new(),
            bias: Vec::new(),
        };
        let mut start = rows.start;
        while start + R <= rows.end {
            packed.bias.push(std::array::from_fn(|r| dense.bias[start + r]));
            let at = |r: usize, input: usize| dense.weight[(start + r) * dense.inputs + input];
            packed
                .weights
                .extend((0..dense.inputs).map(|input| std::array::from_fn(|r| at(r, input))));
            start += R;
        }
        (packed, start..rows.end)
    }

    /// One block per group: sums over `inputs`, then the activation; `out` holds the groups' rows in order.
    #[inline(always)]
    fn run<V: Vector, C: Columns<V, N>, const N: usize>(&self, inputs: &[[V; N]], out: &mut [[V; N]]) {
        let groups = self.weights.chunks_exact(inputs.len()).zip(&self.bias);
        for ((weights, bias), out) in groups.zip(out.as_chunks_mut::<R>().0) {
            let zero = inputs[0][0].splat(0.0);
            let mut sums = [[zero; N]; R];
            for (weight, input) in weights.iter().zip(inputs) {
                for (sum, &weight) in sums.iter_mut().zip(weight) {
                    let weight = zero.splat(weight);
                    for (sum, &input) in sum.iter_mut().zip(input) {
                        *sum = weight.mul_add(input, *sum);
                    }
                }
            }
            // The bias comes last, as in other engines' matrix products: the same order of the same roundings leaves
            // the fewest differences from them.
            for (sum, &bias) in sums.iter_mut().zip(bias) {
                for (sum, bias) in sum.iter_mut().zip(C::bias(zero.splat(bias))) {
                    *sum = *sum + bias;
                }
            }
            // Whole first: a loop that picks rows out of `sums` would keep them in memory throughout.
            *out = sums;
            for row in out {
                *row = C::finish(*row);
            }
        }
    }
}

/// What the columns of a block are: where the bias goes and what the activation does to them.
pub trait Columns<V: Vector, const N: usize> {
    /// What the bias adds to each column.
    fn bias(bias: V) -> [V; N];

    /// The activation.
    fn finish(sum: [V; N]) -> [V; N];
}

/// Hidden layer: SiLU.
pub struct Silu<C>(PhantomData<C>);

/// Last layer: no activation.
pub struct Linear<C>(PhantomData<C>);

/// `N` independent queries per lane.
pub struct Values;

/// One query per lane: its value and two tangents.
pub struct Tangents;

impl<V: Vector, const N: usize> Columns<V, N> for Linear<Values> {
    #[inline(always)]
    fn bias(bias: V) -> [V; N] {
        [bias; N]
    }

    #[inline(always)]
    fn finish(sum: [V; N]) -> [V; N] {
        sum
    }
}

impl<V: Vector, const N: usize> Columns<V, N> for Silu<Values> {
    #[inline(always)]
    fn bias(bias: V) -> [V; N] {
        [bias; N]
    }

    #[inline(always)]
    fn finish(mut sum: [V; N]) -> [V; N] {
        for value in &mut sum {
            *value = *value * sigmoid(*value);
        }
        sum
    }
}

impl<V: Vector> Columns<V, TANGENT_COLUMNS> for Linear<Tangents> {
    #[inline(always)]
    fn bias(bias: V) -> [V; TANGENT_COLUMNS] {
        [bias, bias.splat(0.0), bias.splat(0.0)]
    }

    #[inline(always)]
    fn finish(sum: [V; TANGENT_COLUMNS]) -> [V; TANGENT_COLUMNS] {
        sum
    }
}

impl<V: Vector> Columns<V, TANGENT_COLUMNS> for Silu<Tangents> {
    #[inline(always)]
    fn bias(bias: V) -> [V; TANGENT_COLUMNS] {
        Linear::<Tangents>::bias(bias)
    }

    #[inline(always)]
    fn finish([x, dx, dy]: [V; TANGENT_COLUMNS]) -> [V; TANGENT_COLUMNS] {
        let sigma = sigmoid(x);
        let value = x * sigma;
        // d(x·σ)/dx = σ + x·σ·(1 − σ).
        let slope = value.mul_add(x.splat(1.0) - sigma, sigma);
        [value, slope * dx, slope * dy]
    }
}

/// One dense layer, packed in groups of four rows, then two, then one.
pub struct Layer {
    quads: Rows<4>,
    pairs: Rows<2>,
    singles: Rows<1>,
    outputs: usize,
}

impl Layer {
    /// Packs all rows of `dense`.
    pub fn new(dense: &Dense) -> Layer {
        Layer::first_rows(dense, dense.outputs)
    }

    /// Packs the first `outputs` rows of `dense`.
    pub fn first_rows(dense: &Dense, outputs: usize) -> Layer {
        let (quads, rest) = Rows::pack(dense, 0..outputs);
        let (pairs, rest) = Rows::pack(dense, rest);
        let (singles, _) = Rows::pack(dense, rest);
        Layer {
            quads,
            pairs,
            singles,
            outputs,
        }
    }

    /// Number of rows.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Writes [`Layer::outputs`] rows from `inputs`, as many as the layer has.
    #[inline(always)]
    pub fn run<V: Vector, C: Columns<V, N>, const N: usize>(&self, inputs: &[[V; N]], out: &mut [[V; N]]) {
        let (quads, rest) = out.split_at_mut(4 * self.quads.bias.len());
        let (pairs, singles) = rest.split_at_mut(2 * self.pairs.bias.len());
        self.quads.run::<V, C, N>(inputs, quads);
        self.pairs.run::<V, C, N>(inputs, pairs);
        self.singles.run::<V, C, N>(inputs, singles);
    }
}

/// Two buffers that layers write alternately.
pub struct Buffers<V, const N: usize> {
    first: Vec<[V; N]>,
    second: Vec<[V; N]>,
}

impl<V: Vector, const N: usize> Buffers<V, N> {
    /// Buffers for layers of up to `width` rows, filled with `zero`.
    pub fn new(width: usize, zero: V) -> Self {
        Buffers {
            first: vec![[zero; N]; width],
            second: vec![[zero; N]; width],
        }
    }

    /// The buffer whose rows [`Buffers::run`] takes as input.
    #[inline(always)]
    pub fn input(&mut self) -> &mut [[V; N]] {
        &mut self.first
    }

    /// Runs `hidden` and then `last` on the first `inputs` rows of [`Buffers::input`]; the rows of `last`.
    #[inline(always)]
    pub fn run<H: Columns<V, N>, L: Columns<V, N>>(
        &mut self,
        inputs: usize,
        hidden: &[Layer],
        last: &Layer,
    ) -> &[[V; N]] {
        let (mut from, mut to) = (&mut self.first[..], &mut self.second[..]);
        let mut width = inputs;
        for layer in hidden {
            layer.run::<V, H, N>(&from[..width], &mut to[..layer.outputs]);
            width = layer.outputs;
            std::mem::swap(&mut from, &mut to);
        }
        last.run::<V, L, N>(&from[..width], &mut to[..last.outputs]);
        &to[..last.outputs]
    }
}
