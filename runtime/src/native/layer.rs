//! Dense layers as the kernels read them: rows in panels, the weights of one input next to each other.
//!
//! The same weights serve lanes that are queries, which take some rows of a panel at a time, and lanes that are rows,
//! which load it whole. What runs of a layer is a view: some of its inputs, its first rows, another bias.

use crate::network::Dense;
use std::ops::Range;
use std::sync::Arc;

/// Rows of a panel: the lanes of the widest tier.
pub const PANEL: usize = 16;

/// The weights of [`PANEL`] rows for one input; zeros beyond the last row. One line of the cache.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub struct Panel(pub [f32; PANEL]);

/// A view of a dense layer. Views of one layer share its weights.
#[derive(Clone)]
pub struct Layer {
    /// Per panel, per input.
    weights: Arc<[Panel]>,
    /// Per row; zeros up to whole panels.
    bias: Vec<f32>,
    /// The inputs that take part.
    live: Vec<Range<usize>>,
    inputs: usize,
    outputs: usize,
}

impl Layer {
    /// Packs `dense`.
    pub fn new(dense: &Dense) -> Layer {
        let Dense { inputs, outputs, .. } = *dense;
        let panels = outputs.div_ceil(PANEL);
        let mut weights = vec![Panel([0.0; PANEL]); panels * inputs];
        for (row, values) in dense.weight.chunks_exact(inputs).enumerate() {
            let panel = &mut weights[row / PANEL * inputs..];
            for (panel, &value) in panel.iter_mut().zip(values) {
                panel.0[row % PANEL] = value;
            }
        }
        let mut bias = dense.bias.clone();
        bias.resize(panels * PANEL, 0.0);
        Layer {
            weights: weights.into(),
            bias,
            live: std::iter::once(0..inputs).collect(),
            inputs,
            outputs,
        }
    }

    /// Its first `outputs` rows.
    pub fn first_rows(&self, outputs: usize) -> Layer {
        Layer {
            bias: self.bias[..outputs.div_ceil(PANEL) * PANEL].to_vec(),
            outputs,
            ..self.clone()
        }
    }

    /// What the inputs `live` alone add up to, and the bias.
    pub fn of_inputs(&self, live: Vec<Range<usize>>) -> Layer {
        Layer { live, ..self.clone() }
    }

    /// The same without a bias.
    pub fn without_bias(&self) -> Layer {
        Layer {
            bias: vec![0.0; self.bias.len()],
            ..self.clone()
        }
    }

    /// The same with the inputs that are `known`, by their positions and values, folded into the bias.
    pub fn folded(&self, known: &[(usize, f64)]) -> Layer {
        let mut folded = self.clone();
        for (row, bias) in folded.bias.iter_mut().enumerate() {
            let panel = row / PANEL * self.inputs;
            let weight = |input: usize| f64::from(self.weights[panel + input].0[row % PANEL]);
            let sum: f64 = known.iter().map(|&(input, value)| weight(input) * value).sum();
            *bias = (f64::from(*bias) + sum) as f32;
        }
        let is_known = |input: &usize| known.iter().any(|(position, _)| position == input);
        let inputs = self.live.iter().cloned().flatten();
        folded.live = ranges(inputs.filter(|input| !is_known(input)));
        folded
    }

    /// Number of its inputs, those that take no part among them.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Number of its rows.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// The inputs that take part.
    #[inline(always)]
    pub fn live(&self) -> &[Range<usize>] {
        &self.live
    }

    /// Weights of panel `p`, per input.
    #[inline(always)]
    pub fn panel(&self, p: usize) -> &[Panel] {
        &self.weights[p * self.inputs..(p + 1) * self.inputs]
    }

    /// Per row; zeros up to whole panels.
    #[inline(always)]
    pub fn bias(&self) -> &[f32] {
        &self.bias
    }

    /// The weight of `row` for `input`.
    pub fn weight(&self, row: usize, input: usize) -> f32 {
        self.panel(row / PANEL)[input].0[row % PANEL]
    }
}

/// `positions`, which ascend, as ranges.
pub fn ranges(positions: impl Iterator<Item = usize>) -> Vec<Range<usize>> {
    let mut ranges: Vec<Range<usize>> = Vec::new();
    for position in positions {
        match ranges.last_mut() {
            Some(last) if last.end == position => last.end += 1,
            _ => ranges.push(position..position + 1),
        }
    }
    ranges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_lie_in_panels_and_known_inputs_in_the_bias() {
        let (inputs, outputs) = (3, 18);
        let dense = Dense {
            weight: (0..inputs * outputs).map(|i| i as f32).collect(),
            bias: (0..outputs).map(|row| 100.0 * row as f32).collect(),
            inputs,
            outputs,
        };
        let layer = Layer::new(&dense);
        assert_eq!((layer.bias().len(), layer.panel(1).len()), (32, 3));
        for row in 0..outputs {
            for input in 0..inputs {
                assert_eq!(layer.weight(row, input), dense.weight[row * inputs + input]);
            }
        }
        assert_eq!(layer.panel(1)[0].0[2..], [0.0; 14]);
        let folded = layer.folded(&[(1, 2.0)]);
        assert_eq!(folded.live(), [0..1, 2..3]);
        assert_eq!(folded.bias()[17], 1700.0 + 2.0 * 52.0);
        assert_eq!(folded.bias()[18..], [0.0; 14]);
        assert_eq!(layer.first_rows(2).bias(), &layer.bias()[..16]);
    }

    #[test]
    fn neighbours_join_into_ranges() {
        assert_eq!(ranges([0, 1, 4, 6, 7, 8].into_iter()), [0..2, 4..5, 6..9]);
        assert!(ranges(std::iter::empty()).is_empty());
    }
}
