//! One tile: some queries through all layers and back, in buffers that stay in the second-level cache.

use super::activation::{Activation, Linear, Relu, Silu};
use super::aligned::Aligned;
use super::loss::{Features, Outputs, OutputsMut, TileLoss};
use super::packed::Layer;
use super::product::{Backward, Forward, ROWS, Rows, Weights};
use super::shape::Nonlinearity;
use bake_runtime::simd::Simd;
use std::marker::PhantomData;
use std::ops::Range;

/// Rows of a tile, over all columns: enough that a weight gradient is worth loading, few enough that a layer's
/// rows stay in the first-level cache.
const TILE_ROWS: usize = 192;

/// Queries of a tile with `columns` blocks of rows.
pub fn queries(columns: usize) -> usize {
    (TILE_ROWS / columns).next_multiple_of(ROWS)
}

/// The buffers of a tile.
pub struct Tile {
    nonlinearity: Nonlinearity,
    columns: usize,
    /// x of each layer: features, then activations.
    rows: Vec<Aligned>,
    /// Rows of the last layer.
    last: Aligned,
    /// s' of each hidden layer.
    slopes: Vec<Aligned>,
    /// s''·ż of each hidden layer.
    turns: Vec<Aligned>,
    /// s'' of the layer at hand.
    bend: Aligned,
    /// z̄ of the layer at hand and of the one below it.
    adjoints: [Aligned; 2],
    /// Outputs and their gradient, one plane per output and column.
    outputs: Aligned,
    gradient: Aligned,
}

impl Tile {
    /// Buffers for `layers` with `columns` blocks of rows.
    pub fn new(layers: &[Layer], nonlinearity: Nonlinearity, columns: usize) -> Tile {
        let queries = queries(columns);
        let widest = layers.iter().map(|layer| layer.output_width).max().unwrap_or(0);
        let outputs = layers.last().map_or(0, |layer| layer.outputs);
        let last = layers.last().map_or(0, |layer| layer.output_width);
        let hidden = &layers[..layers.len().saturating_sub(1)];
        let curved = columns > 1 && nonlinearity == Nonlinearity::Silu;
        let turns = if curved { columns - 1 } else { 0 };
        let zeros = |rows: usize, width: usize| Aligned::zeros(rows * width);
        Tile {
            nonlinearity,
            columns,
            rows: layers
                .iter()
                .map(|layer| zeros(columns * queries, layer.input_width))
                .collect(),
            last: zeros(columns * queries, last),
            slopes: hidden
                .iter()
                .map(|layer| zeros(queries, layer.output_width))
                .collect(),
            turns: hidden
                .iter()
                .map(|layer| zeros(turns * queries, layer.output_width))
                .collect(),
            bend: zeros(if curved { queries } else { 0 }, widest),
            adjoints: [(); 2].map(|()| zeros(columns * queries, widest)),
            outputs: zeros(columns * queries, outputs),
            gradient: zeros(columns * queries, outputs),
        }
    }

    /// Adds the gradient of the losses of `queries` to `gradient`, padded layer by layer, and returns their sum.
    #[inline(always)]
    pub fn train<S: Simd, L: TileLoss>(
        &mut self,
        simd: S,
        layers: &[Layer],
        loss: &L,
        queries: Range<usize>,
        gradient: &mut [f32],
    ) -> f64 {
        let count = queries.len();
        self.features(simd, layers, count, |rows| {
            loss.features(simd, queries.clone(), rows);
        });
        self.forward(simd, layers, count);
        let Some(last) = layers.last() else { return 0.0 };
        let planes = self.columns * last.outputs * count;
        self.gradient[..planes].fill(0.0);
        scatter(&self.last, last, count, &mut self.outputs[..planes]);
        let outputs = Outputs::new(&self.outputs[..planes], last.outputs, count);
        let mut adjoint = OutputsMut::new(&mut self.gradient[..planes], last.outputs, count);
        let value = loss.loss(simd, queries, &outputs, &mut adjoint);
        self.backward(simd, layers, count, gradient);
        value
    }

    /// The outputs of `count` queries, plane after plane, whose features `fill` writes.
    #[inline(always)]
    pub fn evaluate<S: Simd>(
        &mut self,
        simd: S,
        layers: &[Layer],
        count: usize,
        fill: impl FnOnce(&mut Features),
    ) -> &[f32] {
        self.features(simd, layers, count, fill);
        self.forward(simd, layers, count);
        let Some(last) = layers.last() else { return &[] };
        let planes = &mut self.outputs[..self.columns * last.outputs * count];
        scatter(&self.last, last, count, planes);
        planes
    }

    /// Rows of the first layer. Rows are whole blocks of queries; those without a query are zeros.
    #[inline(always)]
    fn features<S: Simd>(
        &mut self,
        _simd: S,
        layers: &[Layer],
        count: usize,
        fill: impl FnOnce(&mut Features),
    ) {
        let (Some(rows), Some(first)) = (self.rows.first_mut(), layers.first()) else {
            return;
        };
        let block = count.next_multiple_of(ROWS);
        let rows = &mut rows[..self.columns * block * first.input_width];
        rows.fill(0.0);
        fill(&mut Features::new(rows, first.input_width, first.inputs, block));
    }

    #[inline(always)]
    fn forward<S: Simd>(&mut self, simd: S, layers: &[Layer], count: usize) {
        let hidden = layers.len() - 1;
        for layer in 0..hidden {
            match self.nonlinearity {
                Nonlinearity::Silu => self.layer::<S, Silu>(simd, layers, layer, count),
                Nonlinearity::Relu => self.layer::<S, Relu>(simd, layers, layer, count),
            }
        }
        self.layer::<S, Linear>(simd, layers, hidden, count);
    }

    #[inline(always)]
    fn layer<S: Simd, A: Activation>(&mut self, simd: S, layers: &[Layer], index: usize, count: usize) {
        let layer = &layers[index];
        let (inputs, above) = self.rows.split_at_mut(index + 1);
        let mut nothing = [];
        simd.enter(Forward {
            simd,
            activation: PhantomData::<A>,
            queries: count.next_multiple_of(ROWS),
            columns: self.columns,
            left: Rows {
                numbers: &inputs[index],
                stride: layer.input_width,
            },
            weights: &layer.forward,
            bias: &layer.bias,
            out: above.first_mut().unwrap_or(&mut self.last),
            slope: self.slopes.get_mut(index).map_or(&mut nothing[..0], |s| s),
            bend: &mut self.bend,
            turn: match self.turns.get_mut(index) {
                Some(turn) => turn,
                None => &mut [],
            },
        });
    }

    #[inline(always)]
    fn backward<S: Simd>(&mut self, simd: S, layers: &[Layer], count: usize, gradient: &mut [f32]) {
        let queries = count.next_multiple_of(ROWS);
        let columns = self.columns;
        let [above, below] = &mut self.adjoints;
        let (mut above, mut below) = (above, below);
        let last = &layers[layers.len() - 1];
        let end = gradient.len();
        let planes = &self.gradient[..columns * last.outputs * count];
        gather(planes, last, count, above);
        // The values' rows only: tangents know no bias.
        let bias = &mut gradient[end - last.output_width..];
        for row in above[..count * last.output_width].chunks_exact(last.output_width) {
            for (sum, part) in bias.iter_mut().zip(row) {
                *sum += part;
            }
        }
        let mut end = gradient.len();
        for (index, layer) in layers.iter().enumerate().rev() {
            let start = end - layer.gradient();
            simd.enter(Weights {
                simd,
                outputs: layer.outputs,
                left: Rows {
                    numbers: &above[..columns * queries * layer.output_width],
                    stride: layer.output_width,
                },
                right: Rows {
                    numbers: &self.rows[index][..columns * queries * layer.input_width],
                    stride: layer.input_width,
                },
                gradient: &mut gradient[start..end - layer.output_width],
            });
            if index > 0 {
                simd.enter(Backward {
                    simd,
                    queries,
                    columns,
                    left: Rows {
                        numbers: above,
                        stride: layer.output_width,
                    },
                    weights: &layer.backward,
                    slope: &self.slopes[index - 1],
                    turn: &self.turns[index - 1],
                    out: below,
                    bias: &mut gradient[start - layer.input_width..start],
                });
                std::mem::swap(&mut above, &mut below);
            }
            end = start;
        }
    }
}

/// Copies the rows of the `last` layer to planes of `count` queries, one per column and output.
#[inline(always)]
fn scatter(rows: &[f32], last: &Layer, count: usize, planes: &mut [f32]) {
    let columns = planes.chunks_exact_mut(count * last.outputs);
    let blocks = rows.chunks_exact(count.next_multiple_of(ROWS) * last.output_width);
    for (planes, block) in columns.zip(blocks) {
        for (output, plane) in planes.chunks_exact_mut(count).enumerate() {
            for (value, row) in plane.iter_mut().zip(block.chunks_exact(last.output_width)) {
                *value = row[output];
            }
        }
    }
}

/// Copies planes back to rows of the `last` layer, with zeros in what is padding.
#[inline(always)]
fn gather(planes: &[f32], last: &Layer, count: usize, rows: &mut [f32]) {
    let columns = planes.chunks_exact(count * last.outputs);
    let blocks = rows.chunks_exact_mut(count.next_multiple_of(ROWS) * last.output_width);
    for (planes, block) in columns.zip(blocks) {
        block.fill(0.0);
        for (output, plane) in planes.chunks_exact(count).enumerate() {
            for (value, row) in plane.iter().zip(block.chunks_exact_mut(last.output_width)) {
                row[output] = *value;
            }
        }
    }
}
