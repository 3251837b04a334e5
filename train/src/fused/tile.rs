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

/// Most rows of a tile, over all columns. Fewer load weights and their gradient more often for the same work;
/// more would push the buffers of wide networks out of the second-level cache (measured: 96 is 2 % slower, 288
/// no faster).
const TILE_ROWS: usize = 192;

/// Most queries of a tile with `columns` blocks of rows.
pub fn most_queries(columns: usize) -> usize {
    (TILE_ROWS / columns).max(1).next_multiple_of(ROWS)
}

/// The buffers of a tile.
pub struct Tile {
    nonlinearity: Nonlinearity,
    columns: usize,
    /// Features, then the outputs of each layer.
    rows: Vec<Aligned>,
    /// s' of each layer; empty for the last.
    slopes: Vec<Aligned>,
    /// s''·ż of each layer; empty for the last, and where there are no tangents or no s''.
    turns: Vec<Aligned>,
    /// s'' of the layer at hand.
    bend: Aligned,
    /// z̄ of the layer at hand and of the one below it.
    adjoints: [Aligned; 2],
    /// Outputs and their gradient, one plane per column and output.
    outputs: Aligned,
    gradient: Aligned,
}

impl Tile {
    /// Buffers for `layers`, of which there is at least one, with `columns` blocks of rows.
    pub fn new(layers: &[Layer], nonlinearity: Nonlinearity, columns: usize) -> Tile {
        let queries = most_queries(columns);
        let last = layers.len() - 1;
        let tangents = match nonlinearity {
            Nonlinearity::Silu => columns - 1,
            Nonlinearity::Relu => 0,
        };
        // Blocks of rows of each layer's outputs, and the same where the last layer needs none.
        let buffers = |blocks: usize, layers: &[Layer]| -> Vec<Aligned> {
            let widths = layers.iter().map(|layer| layer.output_width);
            widths
                .map(|width| Aligned::zeros(blocks * queries * width))
                .collect()
        };
        let hidden = |blocks: usize| -> Vec<Aligned> {
            let mut buffers = buffers(blocks, &layers[..last]);
            buffers.push(Aligned::default());
            buffers
        };
        let mut rows = vec![Aligned::zeros(columns * queries * layers[0].input_width)];
        rows.extend(buffers(columns, layers));
        let widest = layers.iter().map(|layer| layer.output_width).max().unwrap_or(0);
        Tile {
            nonlinearity,
            columns,
            rows,
            slopes: hidden(1),
            turns: hidden(tangents),
            bend: Aligned::zeros(tangents.min(1) * queries * widest),
            adjoints: [(); 2].map(|()| Aligned::zeros(columns * queries * widest)),
            outputs: Aligned::zeros(columns * queries * layers[last].outputs),
            gradient: Aligned::zeros(columns * queries * layers[last].outputs),
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
        loss.features(simd, queries.clone(), &mut self.features(&layers[0], count));
        self.forward(simd, layers, count);
        let outputs = layers[layers.len() - 1].outputs;
        let adjoint = &mut self.gradient[..self.columns * outputs * count];
        adjoint.fill(0.0);
        let planes = Outputs::new(&self.outputs, outputs, count);
        let value = loss.loss(
            simd,
            queries,
            &planes,
            &mut OutputsMut::new(adjoint, outputs, count),
        );
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
        fill(&mut self.features(&layers[0], count));
        self.forward(simd, layers, count);
        &self.outputs[..self.columns * layers[layers.len() - 1].outputs * count]
    }

    /// Rows of the `first` layer. Rows are whole blocks of queries; those without a query stay zeros.
    #[inline(always)]
    fn features(&mut self, first: &Layer, count: usize) -> Features<'_> {
        let block = count.next_multiple_of(ROWS);
        let rows = &mut self.rows[0][..self.columns * block * first.input_width];
        rows.fill(0.0);
        Features::new(rows, first.input_width, first.inputs, block)
    }

    /// From features to planes of outputs.
    #[inline(always)]
    fn forward<S: Simd>(&mut self, simd: S, layers: &[Layer], count: usize) {
        let last = layers.len() - 1;
        for (index, layer) in layers[..last].iter().enumerate() {
            match self.nonlinearity {
                Nonlinearity::Silu => self.layer::<S, Silu>(simd, layer, index, count),
                Nonlinearity::Relu => self.layer::<S, Relu>(simd, layer, index, count),
            }
        }
        self.layer::<S, Linear>(simd, &layers[last], last, count);
        scatter(&self.rows[last + 1], &layers[last], count, &mut self.outputs);
    }

    #[inline(always)]
    fn layer<S: Simd, A: Activation>(&mut self, simd: S, layer: &Layer, index: usize, count: usize) {
        let (below, above) = self.rows.split_at_mut(index + 1);
        simd.enter(Forward {
            simd,
            activation: PhantomData::<A>,
            queries: count.next_multiple_of(ROWS),
            columns: self.columns,
            left: Rows {
                numbers: &below[index],
                stride: layer.input_width,
            },
            weights: &layer.forward,
            bias: &layer.bias,
            out: &mut above[0],
            slope: &mut self.slopes[index],
            bend: &mut self.bend,
            turn: &mut self.turns[index],
        });
    }

    /// From planes of the outputs' gradient to `gradient`, to which that by the parameters is added.
    #[inline(always)]
    fn backward<S: Simd>(&mut self, simd: S, layers: &[Layer], count: usize, gradient: &mut [f32]) {
        let queries = count.next_multiple_of(ROWS);
        let columns = self.columns;
        let [above, below] = &mut self.adjoints;
        let (mut above, mut below) = (above, below);
        let last = &layers[layers.len() - 1];
        let mut end = gradient.len();
        gather(&self.gradient, last, columns, count, above);
        // The values' rows only: tangents know no bias.
        let bias = &mut gradient[end - last.output_width..];
        for row in above[..count * last.output_width].chunks_exact(last.output_width) {
            for (sum, part) in bias.iter_mut().zip(row) {
                *sum += part;
            }
        }
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

/// Copies `rows` of the `last` layer to planes of `count` queries, one per column and output.
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

/// Copies planes back to `rows` of the `last` layer, with zeros in what is padding.
#[inline(always)]
fn gather(planes: &[f32], last: &Layer, columns: usize, count: usize, rows: &mut [f32]) {
    let planes = planes.chunks_exact(count * last.outputs).take(columns);
    let blocks = rows.chunks_exact_mut(count.next_multiple_of(ROWS) * last.output_width);
    for (planes, block) in planes.zip(blocks) {
        block.fill(0.0);
        for (output, plane) in planes.chunks_exact(count).enumerate() {
            for (value, row) in plane.iter().zip(block.chunks_exact_mut(last.output_width)) {
                row[output] = *value;
            }
        }
    }
}
