//! The shift g of a warp, or the position on the disk, with its derivatives by u: the part of a sampling network that u
//! goes through, on a value and two tangents side by side.

use super::encode::{Feature, encode_tangents};
use super::kernel::{Activate, Buffers, Layer, Linear, Relu, Silu, Stack, TANGENT_COLUMNS, Tangents};
use super::program::Program;
use super::tile::Column;
use super::vector::{Simd, Task, Vector};
use crate::encoding::{Encoding, Quantity};
use crate::network::{Dense, Network};
use crate::spec::{Activation, Input, NetworkSpec};
use std::ops::Range;

/// Outputs of a sampling network that make the position.
const COORDINATES: usize = 2;

/// A value and its derivatives by u₀ and u₁.
pub type Slopes<V> = [V; TANGENT_COLUMNS];

/// See the top of the file.
pub struct Shift<V> {
    /// The first layer.
    pub first: Layer,
    /// The first layer without what u adds to it.
    pub others: Layer,
    /// The inputs of that.
    pub other_inputs: Vec<Feature>,
    /// What u adds to the first layer.
    own: Layer,
    /// How u enters.
    encodings: Vec<Encoding>,
    /// The tangents of the first layer, where they do not depend on u.
    constant: Option<Vec<[f32; 2]>>,
    /// What follows the first layer.
    rest: Stack,
    entry: Buffers<V, TANGENT_COLUMNS>,
    buffers: Buffers<V, TANGENT_COLUMNS>,
}

impl<V: Vector> Shift<V> {
    /// Packs the sampling network `network`, which `program` has checked; `zero` makes the buffers.
    pub fn new(network: &Network, program: &Program, zero: V) -> Self {
        let mut layers = network.net.clone();
        // The weight needs no tangents.
        let last = layers.last_mut().expect("a checked network has layers");
        last.outputs = COORDINATES;
        last.weight.truncate(COORDINATES * last.inputs);
        last.bias.truncate(COORDINATES);
        let (first, rest) = layers.split_first().expect("a checked network has layers");
        let is_u = |input: &Input| input.quantity == Quantity::U;
        let inputs = &network.spec.inputs;
        let encodings: Vec<Encoding> = inputs.iter().filter(|i| is_u(i)).map(|i| i.encoding).collect();
        let mut own = columns(first, ranges(&network.spec, is_u));
        own.bias.fill(0.0);
        let constant = encodings
            .iter()
            .all(|e| matches!(e, Encoding::Centred | Encoding::Identity))
            .then(|| constant_slopes(&own, &encodings));
        let (last, hidden) = match rest.split_last() {
            Some((last, hidden)) => (Some(Layer::new(last)), hidden),
            None => (None, rest),
        };
        Shift {
            others: Layer::new(&columns(first, ranges(&network.spec, |i| !is_u(i)))),
            other_inputs: inputs.iter().filter(|i| !is_u(i)).map(Feature::new).collect(),
            own: Layer::new(&own),
            encodings,
            constant,
            rest: Stack {
                activation: network.spec.activation,
                inputs: first.outputs,
                hidden: hidden.iter().map(Layer::new).collect(),
                last,
            },
            first: Layer::new(first),
            entry: Buffers::new(program.width.max(1), zero),
            buffers: Buffers::new(program.width, zero),
        }
    }

    /// Both coordinates for vector `q` of the first layer's `sums`, which `u` has entered.
    #[inline(always)]
    pub fn after<S: Simd<Vector = V>, const N: usize>(
        &mut self,
        simd: S,
        sums: &[Column<V, N>],
        q: usize,
        u: [V; 2],
    ) -> [Slopes<V>; COORDINATES] {
        self.run(simd, sums, q, u, true)
    }

    /// Both coordinates for vector `q` of the sums of [`Shift::others`], and for `u`.
    #[inline(always)]
    pub fn at<S: Simd<Vector = V>, const N: usize>(
        &mut self,
        simd: S,
        sums: &[Column<V, N>],
        q: usize,
        u: [V; 2],
    ) -> [Slopes<V>; COORDINATES] {
        self.run(simd, sums, q, u, false)
    }

    #[inline(always)]
    fn run<S: Simd<Vector = V>, const N: usize>(
        &mut self,
        simd: S,
        sums: &[Column<V, N>],
        q: usize,
        u: [V; 2],
        entered: bool,
    ) -> [Slopes<V>; COORDINATES] {
        let mut out = [[simd.splat(0.0); TANGENT_COLUMNS]; COORDINATES];
        simd.enter(Enter {
            shift: self,
            sums,
            q,
            u,
            entered,
            out: &mut out,
        });
        out
    }
}

/// Both ways to run a shift: a task of its own, so that they share one copy of its code.
struct Enter<'a, V, const N: usize> {
    shift: &'a mut Shift<V>,
    sums: &'a [Column<V, N>],
    q: usize,
    u: [V; 2],
    /// Whether u is in the sums.
    entered: bool,
    out: &'a mut [Slopes<V>; COORDINATES],
}

impl<V: Vector, const N: usize> Task for Enter<'_, V, N> {
    #[inline(always)]
    fn run(self) {
        match (&self.shift.rest.last, self.shift.rest.activation) {
            (None, _) => self.activate::<Linear>(),
            (Some(_), Activation::Silu) => self.activate::<Silu>(),
            (Some(_), Activation::Relu) => self.activate::<Relu>(),
        }
    }
}

impl<V: Vector, const N: usize> Enter<'_, V, N> {
    #[inline(always)]
    fn activate<A: Activate>(self) {
        let Enter { shift, sums, q, .. } = self;
        let entered = sums.iter().zip(shift.buffers.input());
        match &shift.constant {
            Some(slopes) if self.entered => {
                for ((sum, row), &[dx, dy]) in entered.zip(slopes) {
                    let x = sum[q];
                    *row = A::tangents([x, x.splat(dx), x.splat(dy)]);
                }
            }
            _ => {
                encode_tangents(&shift.encodings, self.u, shift.entry.input());
                let own = shift.entry.sums::<Tangents>(&shift.own);
                for ((sum, row), &[x, dx, dy]) in entered.zip(own) {
                    let x = if self.entered { sum[q] } else { sum[q] + x };
                    *row = A::tangents([x, dx, dy]);
                }
            }
        }
        let rows = shift.buffers.layers::<Tangents, A>(&shift.rest);
        *self.out = [rows[0], rows[1]];
    }
}

/// Where the features of those inputs stand that `which` accepts.
fn ranges(spec: &NetworkSpec, which: impl Fn(&Input) -> bool) -> Vec<Range<usize>> {
    let mut start = 0;
    let mut ranges = Vec::new();
    for input in &spec.inputs {
        let range = start..start + input.features();
        start = range.end;
        if which(input) {
            ranges.push(range);
        }
    }
    ranges
}

/// `layer` with these inputs alone; a layer without any gets one of weight 0, because kernels need one.
fn columns(layer: &Dense, ranges: Vec<Range<usize>>) -> Dense {
    let inputs: usize = ranges.iter().map(Range::len).sum();
    let mut weight = Vec::with_capacity(inputs.max(1) * layer.outputs);
    for row in layer.weight.chunks_exact(layer.inputs) {
        match inputs {
            0 => weight.push(0.0),
            _ => ranges
                .iter()
                .for_each(|range| weight.extend_from_slice(&row[range.clone()])),
        }
    }
    Dense {
        weight,
        bias: layer.bias.clone(),
        inputs: inputs.max(1),
        outputs: layer.outputs,
    }
}

/// ∂(first layer)/∂u per row, from what u alone adds to it.
fn constant_slopes(own: &Dense, encodings: &[Encoding]) -> Vec<[f32; 2]> {
    let slope = |encoding: &Encoding| match encoding {
        Encoding::Centred => 2.0,
        _ => 1.0,
    };
    let row_slopes = |row: &[f32]| {
        let mut slopes = [0.0; 2];
        for (pair, encoding) in row.as_chunks::<2>().0.iter().zip(encodings) {
            slopes[0] += slope(encoding) * pair[0];
            slopes[1] += slope(encoding) * pair[1];
        }
        slopes
    };
    own.weight.chunks_exact(own.inputs).map(row_slopes).collect()
}
