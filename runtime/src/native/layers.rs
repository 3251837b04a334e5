//! Dense layers alone, without encodings, charts or heads: networks of one's own, and what benches hold against the
//! processor's peak.

use super::batch::{self, Tiles};
use super::program::stack;
use super::scratch::{self, Work};
use super::stack::Stack;
use super::tier::{Tier, TierJob};
use super::tile::{read, write};
use super::vector::Simd;
use crate::backend::check_lengths;
use crate::error::{Error, Result};
use crate::network::Dense;
use crate::spec::Activation;

/// Dense layers packed for a tier: hidden ones with an activation, and a last one without.
pub struct Layers {
    runner: Box<dyn Run>,
    inputs: usize,
    outputs: usize,
}

impl Layers {
    /// Packs `layers`.
    ///
    /// # Errors
    /// [`Error::Tier`] when the processor lacks `tier`; [`Error::Network`] when there is no layer, one has no input or output,
    /// its weights are not as many as these say, or it does not fit to the one before.
    pub fn new(layers: &[Dense], activation: Activation, tier: Tier) -> Result<Layers> {
        let refuse = |reason: String| Err(Error::network("the layers", reason));
        let (Some(first), Some(last)) = (layers.first(), layers.last()) else {
            return refuse("there are none".into());
        };
        for (i, layer) in layers.iter().enumerate() {
            let Dense { inputs, outputs, .. } = *layer;
            let whole =
                inputs.checked_mul(outputs) == Some(layer.weight.len()) && layer.bias.len() == outputs;
            let fits = i == 0 || layers[i - 1].outputs == inputs;
            if inputs == 0 || outputs == 0 || !whole || !fits {
                return refuse(format!(
                    "layer {i} of {inputs} inputs and {outputs} outputs has {} weights and {} biases, after one of {} outputs",
                    layer.weight.len(),
                    layer.bias.len(),
                    layers[i.saturating_sub(1)].outputs
                ));
            }
        }
        let packed = Packed {
            stack: stack(activation, layers),
            width: layers
                .iter()
                .flat_map(|l| [l.inputs, l.outputs])
                .max()
                .unwrap_or(0),
        };
        let runner = tier.with(packed)?;
        Ok(Layers {
            runner,
            inputs: first.inputs,
            outputs: last.outputs,
        })
    }

    /// Runs a batch: `inputs` and `outputs` are columns, one for each input and output, all of the same length.
    ///
    /// # Errors
    /// [`Error::BatchLength`] when their numbers or lengths do not fit.
    pub fn run(&self, inputs: &[&[f32]], outputs: &mut [&mut [f32]]) -> Result<()> {
        check_lengths(self.inputs, &[("inputs", inputs.len())])?;
        check_lengths(self.outputs, &[("outputs", outputs.len())])?;
        let count = inputs[0].len();
        for column in inputs {
            check_lengths(count, &[("inputs", column.len())])?;
        }
        for column in &*outputs {
            check_lengths(count, &[("outputs", column.len())])?;
        }
        self.runner.run(inputs, outputs);
        Ok(())
    }
}

trait Run: Send + Sync {
    fn run(&self, inputs: &[&[f32]], outputs: &mut [&mut [f32]]);
}

struct Packed {
    stack: Stack,
    /// Widest layer or input.
    width: usize,
}

impl TierJob for Packed {
    type Out = Box<dyn Run>;

    fn run<S: Simd, const N: usize>(self, simd: S) -> Box<dyn Run> {
        Box::new(Runner::<S, N> { simd, packed: self })
    }
}

struct Runner<S, const N: usize> {
    simd: S,
    packed: Packed,
}

impl<S: Simd, const N: usize> Run for Runner<S, N> {
    fn run(&self, inputs: &[&[f32]], outputs: &mut [&mut [f32]]) {
        let (simd, stack) = (self.simd, &self.packed.stack);
        scratch::with::<S::Vector, N>(self.packed.width, simd.splat(0.0), |scratch| {
            let job = &mut Forward {
                simd,
                stack,
                inputs,
                outputs,
            };
            batch::run(simd, scratch, job);
        });
    }
}

struct Forward<'a, 'b, S> {
    simd: S,
    stack: &'a Stack,
    inputs: &'a [&'a [f32]],
    outputs: &'a mut [&'b mut [f32]],
}

impl<S: Simd> Tiles<S::Vector> for Forward<'_, '_, S> {
    fn count(&self) -> usize {
        self.inputs[0].len()
    }

    #[inline(always)]
    fn tile<const N: usize>(&mut self, start: usize, live: usize, work: Work<S::Vector, N>) {
        for (row, column) in work.values.input().iter_mut().zip(self.inputs) {
            *row = read(self.simd, column, start);
        }
        let rows = work.values.run(self.simd, self.stack, live);
        for (row, column) in rows.iter().zip(&mut *self.outputs) {
            for (q, vector) in row.iter().enumerate() {
                write(*vector, column, start, q);
            }
        }
    }
}
