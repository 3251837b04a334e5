//! Dense layers: on a value, and on a value with its two tangents along u.
//!
//! Value and tangents stay apart, `[N, k]` and `[2, N, k]`: both are matrix products with the same weights,
//! nothing is copied to stack them, and the tangents skip the bias. Into the first layer only the rows of features
//! that depend on u carry tangents; where those are constants, onnxruntime folds the product away.

use crate::features::Features;
use crate::graph::{Graph, Value};
use bake_runtime::Dense;
use bake_runtime::spec::Activation;
use std::ops::Range;

/// A value with its derivatives along the two components of u.
#[derive(Clone, Copy)]
pub struct Dual {
    /// `[N, k]`.
    pub value: Value,
    /// `[2, N, k]`, or `[2, 1, k]` where every query has the same.
    pub tangents: Value,
}

/// What enters a layer of a sampling network.
pub enum Entering {
    /// Features, before the first layer.
    Features(Features),
    /// What another layer gave.
    Dual(Dual),
}

/// Weights of some outputs of a layer, as the graph stores them.
pub struct Affine {
    /// `[inputs, outputs]`: the transpose of the safetensors tensor, so that Gemm and MatMul share it.
    weight: Value,
    bias: Value,
    outputs: usize,
}

impl Entering {
    /// The value without tangents, `[N, k]`.
    pub fn value(&self) -> Value {
        match self {
            Entering::Features(features) => features.value,
            Entering::Dual(dual) => dual.value,
        }
    }
}

impl Affine {
    /// Stores `outputs` of `layer` as `{name}.weight` and `{name}.bias`.
    pub fn new(g: &mut Graph, name: &str, layer: &Dense, outputs: Range<usize>) -> Affine {
        let column = |i| outputs.clone().map(move |o| layer.weight[o * layer.inputs + i]);
        let weight: Vec<f32> = (0..layer.inputs).flat_map(column).collect();
        Affine {
            weight: g.initializer(format!("{name}.weight"), &[layer.inputs, outputs.len()], &weight),
            bias: g.initializer(
                format!("{name}.bias"),
                &[outputs.len()],
                &layer.bias[outputs.clone()],
            ),
            outputs: outputs.len(),
        }
    }

    /// x·weight + bias.
    pub fn value(&self, g: &mut Graph, x: Value) -> Value {
        g.affine(x, self.weight, self.bias)
    }

    /// The same on a value and its tangents.
    pub fn dual(&self, g: &mut Graph, x: &Entering) -> Dual {
        let tangents = match x {
            Entering::Features(features) => self.first_tangents(g, features),
            Entering::Dual(dual) => g.matmul(dual.tangents, self.weight),
        };
        Dual {
            value: self.value(g, x.value()),
            tangents,
        }
    }

    fn first_tangents(&self, g: &mut Graph, features: &Features) -> Value {
        let mut sum: Option<Value> = None;
        for moving in &features.moving {
            let rows = g.rows(self.weight, moving.columns.clone());
            let term = g.matmul(moving.tangents, rows);
            sum = Some(sum.map_or(term, |sum| g.add(sum, term)));
        }
        sum.unwrap_or_else(|| g.constant(&[2, 1, self.outputs], &vec![0.0; 2 * self.outputs]))
    }
}

/// All `layers` on x, the last without activation.
pub fn forward(g: &mut Graph, prefix: &str, layers: &[Dense], activation: Activation, x: Value) -> Value {
    let mut x = x;
    for (i, layer) in layers.iter().enumerate() {
        let affine = Affine::new(g, &format!("{prefix}.{i}"), layer, 0..layer.outputs);
        x = affine.value(g, x);
        if i + 1 < layers.len() {
            x = match activation {
                Activation::Silu => silu(g, x).0,
                Activation::Relu => g.unary("Relu", x),
            };
        }
    }
    x
}

/// Hidden `layers` on x, each with its activation; they are named `{prefix}.0` and on.
pub fn hidden_dual(
    g: &mut Graph,
    prefix: &str,
    layers: &[Dense],
    activation: Activation,
    x: Features,
) -> Entering {
    let mut x = Entering::Features(x);
    for (i, layer) in layers.iter().enumerate() {
        let affine = Affine::new(g, &format!("{prefix}.{i}"), layer, 0..layer.outputs);
        let before = affine.dual(g, &x);
        x = Entering::Dual(activate(g, activation, before));
    }
    x
}

fn activate(g: &mut Graph, activation: Activation, x: Dual) -> Dual {
    match activation {
        Activation::Silu => {
            let (value, sigmoid) = silu(g, x.value);
            // σ·(1 + x·(1 − σ)) = σ + y·(1 − σ) with y = x·σ.
            let rest = g.one_minus(sigmoid);
            let bend = g.mul(value, rest);
            let slope = g.add(sigmoid, bend);
            Dual {
                value,
                tangents: g.mul(x.tangents, slope),
            }
        }
        Activation::Relu => {
            let zero = g.scalar(0.0);
            let passes = g.greater(x.value, zero);
            Dual {
                value: g.unary("Relu", x.value),
                tangents: g.select(passes, x.tangents, zero),
            }
        }
    }
}

/// x·σ(x) and σ(x).
fn silu(g: &mut Graph, x: Value) -> (Value, Value) {
    let sigmoid = g.unary("Sigmoid", x);
    (g.mul(x, sigmoid), sigmoid)
}
