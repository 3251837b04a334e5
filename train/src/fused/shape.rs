//! Widths of a network, and where its numbers lie.

use crate::error::Result;
use bake_runtime::Error;

/// Nonlinearity of the hidden layers; the last layer has none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Nonlinearity {
    /// x·σ(x).
    Silu,
    /// max(x, 0), with slope 1 at 0, as in candle.
    Relu,
}

/// A multilayer perceptron without its weights.
///
/// Its parameters are one flat vector: layer by layer the weight `[out][in]`, row-major, then the bias `[out]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shape {
    widths: Vec<usize>,
    nonlinearity: Nonlinearity,
}

impl Shape {
    /// A network of the given `widths`: inputs, hidden layers, outputs.
    ///
    /// # Errors
    /// [`Error::Query`] for fewer than two widths, or one of 0.
    pub fn new(widths: Vec<usize>, nonlinearity: Nonlinearity) -> Result<Shape> {
        if widths.len() < 2 || widths.contains(&0) {
            let reason = format!("{widths:?}, but a network has inputs and outputs, and no layer is empty");
            return Err(Error::query("widths", reason).into());
        }
        Ok(Shape { widths, nonlinearity })
    }

    /// (inputs, outputs) of each layer.
    pub fn layers(&self) -> impl ExactSizeIterator<Item = (usize, usize)> + '_ {
        self.widths.windows(2).map(|w| (w[0], w[1]))
    }

    /// Width of the input.
    pub fn inputs(&self) -> usize {
        self.widths[0]
    }

    /// Width of the output.
    pub fn outputs(&self) -> usize {
        self.widths[self.widths.len() - 1]
    }

    /// Nonlinearity of the hidden layers.
    pub fn nonlinearity(&self) -> Nonlinearity {
        self.nonlinearity
    }

    /// Number of weights and biases.
    pub fn parameters(&self) -> usize {
        self.layers()
            .map(|(inputs, outputs)| (inputs + 1) * outputs)
            .sum()
    }

    /// Multiply-adds of one row through the network.
    pub fn macs(&self) -> usize {
        self.layers().map(|(inputs, outputs)| inputs * outputs).sum()
    }

    /// Multiply-adds of one row forward, backward and into the weight gradients: three times
    /// [`Shape::macs`], without the gradient by the inputs, which nobody needs.
    pub fn training_macs(&self) -> usize {
        3 * self.macs() - self.widths[0] * self.widths[1]
    }
}
