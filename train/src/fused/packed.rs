//! A network's weights as the products read them, and its gradient as they write it.

use super::aligned::Aligned;
use super::product::{padded, panel};
use super::shape::Shape;

/// One layer, packed for a tier.
pub struct Layer {
    /// Width of its input.
    pub inputs: usize,
    /// Width of its output.
    pub outputs: usize,
    /// Inputs, padded.
    pub input_width: usize,
    /// Outputs, padded.
    pub output_width: usize,
    /// Wᵀ: panels over outputs, in each one row per input.
    pub forward: Aligned,
    /// W: panels over inputs, in each one row per output.
    pub backward: Aligned,
    /// Bias, padded.
    pub bias: Aligned,
}

impl Layer {
    fn zeros(inputs: usize, outputs: usize, lanes: usize) -> Layer {
        let (input_width, output_width) = (padded(inputs, lanes), padded(outputs, lanes));
        Layer {
            inputs,
            outputs,
            input_width,
            output_width,
            forward: Aligned::zeros(inputs * output_width),
            backward: Aligned::zeros(outputs * input_width),
            bias: Aligned::zeros(output_width),
        }
    }

    /// Length of the gradient: weights, rows padded and even in number, then the bias, padded.
    pub fn gradient(&self) -> usize {
        self.outputs.next_multiple_of(2) * self.input_width + self.output_width
    }
}

/// Layers of zeros for vectors of `lanes`, to be filled by [`fill`].
pub fn zeros(shape: &Shape, lanes: usize) -> Vec<Layer> {
    shape
        .layers()
        .map(|(inputs, outputs)| Layer::zeros(inputs, outputs, lanes))
        .collect()
}

/// Packs `parameters`, flat as [`Shape`] orders them, for vectors of `lanes`.
pub fn fill(layers: &mut [Layer], lanes: usize, parameters: &[f32]) {
    let mut rest = parameters;
    for layer in layers {
        let (weights, after) = rest.split_at(layer.inputs * layer.outputs);
        let (bias, after) = after.split_at(layer.outputs);
        rest = after;
        layer.bias[..layer.outputs].copy_from_slice(bias);
        let unit = panel(lanes) * lanes;
        for (output, row) in weights.chunks_exact(layer.inputs).enumerate() {
            // A panel's rows are as wide as what is left for it.
            let start = output / unit * unit;
            let width = unit.min(layer.output_width - start);
            let target = &mut layer.forward[start * layer.inputs + output - start..];
            for (target, weight) in target.iter_mut().step_by(width).zip(row) {
                *target = *weight;
            }
            for (i, row) in row.chunks(unit).enumerate() {
                let start = i * unit;
                let width = unit.min(layer.input_width - start);
                let target = start * layer.outputs + output * width;
                layer.backward[target..target + row.len()].copy_from_slice(row);
            }
        }
    }
}

/// Adds `scale`·`gradient`, padded as [`Layer::gradient`] says, to `sum`, flat as [`Shape`] orders it.
pub fn add_gradient(layers: &[Layer], gradient: &[f32], scale: f32, sum: &mut [f32]) {
    let add = |sum: &mut [f32], part: &[f32]| {
        for (sum, part) in sum.iter_mut().zip(part) {
            *sum += scale * part;
        }
    };
    let (mut gradient, mut sum) = (gradient, sum);
    for layer in layers {
        let (part, rest) = gradient.split_at(layer.gradient());
        gradient = rest;
        let (weights, rest) = sum.split_at_mut(layer.inputs * layer.outputs);
        let (bias, rest) = rest.split_at_mut(layer.outputs);
        sum = rest;
        let rows = weights.chunks_exact_mut(layer.inputs);
        for (sum, part) in rows.zip(part.chunks_exact(layer.input_width)) {
            add(sum, part);
        }
        add(bias, &part[part.len() - layer.output_width..]);
    }
}
