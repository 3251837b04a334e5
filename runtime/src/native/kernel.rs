//! Dense layers on tiles of queries. Lanes are queries; a block of output rows × query columns stays in
//! registers while it runs over the inputs, so every weight is loaded once per block and every activation is
//! applied before the block leaves its registers.

use super::math::sigmoid;
use super::tile::each;
use super::vector::{Simd, Task, Vector};
use crate::network::Dense;
use crate::spec::Activation;

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
    fn run<V: Vector, C: Columns<V, N>, A: Activate, const N: usize>(
        &self,
        inputs: &[[V; N]],
        out: &mut [[V; N]],
    ) {
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
                *row = C::finish::<A>(*row);
            }
        }
    }
}

/// What the columns of a block are: where the bias goes and what an activation does to them.
pub trait Columns<V: Vector, const N: usize> {
    /// What the bias adds to each column.
    fn bias(bias: V) -> [V; N];

    /// `A` on a row.
    fn finish<A: Activate>(sum: [V; N]) -> [V; N];
}

/// `N` independent queries per lane.
pub struct Values;

/// One query per lane: its value and two tangents.
pub struct Tangents;

impl<V: Vector, const N: usize> Columns<V, N> for Values {
    #[inline(always)]
    fn bias(bias: V) -> [V; N] {
        [bias; N]
    }

    #[inline(always)]
    fn finish<A: Activate>(mut sum: [V; N]) -> [V; N] {
        for value in &mut sum {
            *value = A::value(*value);
        }
        sum
    }
}

impl<V: Vector> Columns<V, TANGENT_COLUMNS> for Tangents {
    #[inline(always)]
    fn bias(bias: V) -> [V; TANGENT_COLUMNS] {
        [bias, bias.splat(0.0), bias.splat(0.0)]
    }

    #[inline(always)]
    fn finish<A: Activate>(sum: [V; TANGENT_COLUMNS]) -> [V; TANGENT_COLUMNS] {
        A::tangents(sum)
    }
}

/// A nonlinearity, or none.
pub trait Activate {
    /// On a value.
    fn value<V: Vector>(x: V) -> V;

    /// On a value and its two tangents.
    fn tangents<V: Vector>(row: [V; TANGENT_COLUMNS]) -> [V; TANGENT_COLUMNS];
}

/// x·σ(x).
pub struct Silu;

/// max(x, 0).
pub struct Relu;

/// Nothing: last layers.
pub struct Linear;

impl Activate for Silu {
    #[inline(always)]
    fn value<V: Vector>(x: V) -> V {
        x * sigmoid(x)
    }

    #[inline(always)]
    fn tangents<V: Vector>([x, dx, dy]: [V; TANGENT_COLUMNS]) -> [V; TANGENT_COLUMNS] {
        let sigma = sigmoid(x);
        let value = x * sigma;
        // d(x·σ)/dx = σ + x·σ·(1 − σ).
        let slope = value.mul_add(x.splat(1.0) - sigma, sigma);
        [value, slope * dx, slope * dy]
    }
}

impl Activate for Relu {
    #[inline(always)]
    fn value<V: Vector>(x: V) -> V {
        x.max(x.splat(0.0))
    }

    #[inline(always)]
    fn tangents<V: Vector>(row: [V; TANGENT_COLUMNS]) -> [V; TANGENT_COLUMNS] {
        let zero = row[0].splat(0.0);
        let on = zero.less(row[0]);
        each(row, |v| V::select(on, v, zero))
    }
}

impl Activate for Linear {
    #[inline(always)]
    fn value<V: Vector>(x: V) -> V {
        x
    }

    #[inline(always)]
    fn tangents<V: Vector>(row: [V; TANGENT_COLUMNS]) -> [V; TANGENT_COLUMNS] {
        row
    }
}

/// One dense layer, packed in groups of four rows, then two, then one.
pub struct Layer {
    quads: Rows<4>,
    pairs: Rows<2>,
    singles: Rows<1>,
    inputs: usize,
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
            inputs: dense.inputs,
            outputs,
        }
    }

    /// Writes its rows to `out` from `inputs`, as many as it takes.
    #[inline(always)]
    pub fn run<V: Vector, C: Columns<V, N>, A: Activate, const N: usize>(
        &self,
        inputs: &[[V; N]],
        out: &mut [[V; N]],
    ) {
        let (quads, rest) = out.split_at_mut(4 * self.quads.bias.len());
        let (pairs, singles) = rest.split_at_mut(2 * self.pairs.bias.len());
        self.quads.run::<V, C, A, N>(inputs, quads);
        self.pairs.run::<V, C, A, N>(inputs, pairs);
        self.singles.run::<V, C, A, N>(inputs, singles);
    }
}

/// Layers that follow each other: hidden ones with an activation, and a last one without.
pub struct Stack {
    /// Nonlinearity of the hidden layers.
    pub activation: Activation,
    /// Number of rows that enter.
    pub inputs: usize,
    /// Hidden layers.
    pub hidden: Vec<Layer>,
    /// The last layer; without it the rows of the layer before stand.
    pub last: Option<Layer>,
}

/// Two buffers that layers write alternately.
pub struct Buffers<V, const N: usize> {
    rows: [Vec<[V; N]>; 2],
}

impl<V: Vector, const N: usize> Buffers<V, N> {
    /// Buffers for layers of up to `width` rows, filled with `zero`.
    pub fn new(width: usize, zero: V) -> Self {
        Buffers {
            rows: [vec![[zero; N]; width], vec![[zero; N]; width]],
        }
    }

    /// The buffer whose rows [`Buffers::run`] takes as input.
    #[inline(always)]
    pub fn input(&mut self) -> &mut [[V; N]] {
        &mut self.rows[0]
    }

    /// Runs `stack` on the first rows of [`Buffers::input`], as many as it takes; the rows of its last layer.
    #[inline(always)]
    pub fn run<S: Simd<Vector = V>>(&mut self, simd: S, stack: &Stack) -> &[[V; N]] {
        let rows = &mut self.rows;
        simd.enter(Forward { rows, stack });
        self.output(stack)
    }

    /// Runs `layer` alone on the first rows of [`Buffers::input`], as many as it takes; its rows.
    #[inline(always)]
    pub fn sums<C: Columns<V, N>>(&mut self, layer: &Layer) -> &[[V; N]] {
        let [first, second] = &mut self.rows;
        let out = &mut second[..layer.outputs];
        layer.run::<V, C, Linear, N>(&first[..layer.inputs], out);
        out
    }

    /// [`Buffers::run`] for other columns, compiled into its caller, with the hidden layers' activation as a type.
    #[inline(always)]
    pub fn layers<C: Columns<V, N>, A: Activate>(&mut self, stack: &Stack) -> &[[V; N]] {
        run_layers::<V, C, A, N>(&mut self.rows, stack);
        self.output(stack)
    }

    /// Where `stack` leaves its result.
    #[inline(always)]
    fn output(&self, stack: &Stack) -> &[[V; N]] {
        let layers = stack.hidden.len() + usize::from(stack.last.is_some());
        let width = match (&stack.last, stack.hidden.last()) {
            (Some(last), _) | (None, Some(last)) => last.outputs,
            (None, None) => stack.inputs,
        };
        &self.rows[layers % 2][..width]
    }
}

/// Runs all layers of `stack`, from the first buffer on.
#[inline(always)]
fn run_layers<V: Vector, C: Columns<V, N>, A: Activate, const N: usize>(
    rows: &mut [Vec<[V; N]>; 2],
    stack: &Stack,
) {
    let [first, second] = rows;
    let (mut from, mut to) = (&mut first[..], &mut second[..]);
    let mut width = stack.inputs;
    for layer in &stack.hidden {
        layer.run::<V, C, A, N>(&from[..width], &mut to[..layer.outputs]);
        width = layer.outputs;
        std::mem::swap(&mut from, &mut to);
    }
    if let Some(last) = &stack.last {
        last.run::<V, C, Linear, N>(&from[..width], &mut to[..last.outputs]);
    }
}

/// [`Buffers::run`]: a task of its own, so that all queries share one copy of its code.
struct Forward<'a, V, const N: usize> {
    rows: &'a mut [Vec<[V; N]>; 2],
    stack: &'a Stack,
}

impl<V: Vector, const N: usize> Task for Forward<'_, V, N> {
    #[inline(always)]
    fn run(self) {
        match self.stack.activation {
            Activation::Silu => run_layers::<V, Values, Silu, N>(self.rows, self.stack),
            Activation::Relu => run_layers::<V, Values, Relu, N>(self.rows, self.stack),
        }
    }
}
