//! Dense layers: on a value, and on a value with its two tangents along u.
//!
//! Value and tangents stay apart, `[N, k]` and `[2, N, k]`: both are matrix products with the same weights,
//! nothing is copied to stack them, and the tangents skip the bias. The first layer's tangents do not depend
//! on the query, so they start as `[2, 1, k]` constants that onnxruntime folds away.

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

/// Weights of some outputs of a layer, as the graph stores them.
pub struct Affine {
    /// `[inputs, outputs]`: the transpose of the safetensors tensor, so that Gemm and MatMul share it.
    weight: Value,
    bias: Value,
}

impl Affine {
    /// Stores `outputs` of `layer` as `{name}.weight` and `{name}.bias`.
    pub fn new(g: &mut Graph, name: &str, layer: &Dense, outputs: Range<usize>) -> Affine {
        let column = |i| outputs.clone().map(move |o| layer.weight[o * layer.inputs + i]);
        let weight: Vec<f32> = (0..layer.inputs).flat_map(column).collect();
        Affine {
            weight: g.initializer(format!("{name}.weight"), &[layer.inputs, outputs.len()], &weight),
            bias: g.initializer(format!("{name}.bias"), &[outputs.len()], &layer.bias[outputs]),
        }
    }

    /// x·weight + bias.
    pub fn value(&self, g: &mut Graph, x: Value) -> Value {
        g.affine(x, self.weight, self.bias)
    }

    /// The same on a value and its tangents.
    pub fn dual(&self, g: &mut Graph, x: Dual) -> Dual {
        Dual {
            value: self.value(g, x.value),
            tangents: g.matmul(x.tangents, self.weight),
        }
    }
}

/// All `layers` on x, the last without activation.
pub fn forward(g: &mut Graph, prefix: &str, layers: &[Dense], activation: Activation, x: Value) -> Value {
    let mut x = x;
    for (i, layer) in layers.iter().enumerate() {
        let affine = Affine::new(g, &format!("{prefix}.{i}"), layer, 0..layer.outputs);
        x = affine.value(g, x);
        if i + 1 < layers.len() {
            x = activate(g, activation, x).value;
        }
    }
    x
}

/// Hidden `layers` on x, each with its activation; they are named `{prefix}.0` and on.
pub fn hidden_dual(g: &mut Graph, prefix: &str, layers: &[Dense], activation: Activation, x: Dual) -> Dual {
    let mut x = x;
    for (i, layer) in layers.iter().enumerate() {
        let affine = Affine::new(g, &format!("{prefix}.{i}"), layer, 0..layer.outputs);
        let before = affine.dual(g, x);
        let after = activate(g, activation, before.value);
        let slope = after.slope(g);
        x = Dual {
            value: after.value,
            tangents: g.mul(before.tangents, slope),
        };
    }
    x
}

/// A hidden layer after its activation.
struct Activated {
    value: Value,
    /// σ(x).
    sigmoid: Value,
}

fn activate(g: &mut Graph, activation: Activation, x: Value) -> Activated {
    match activation {
        Activation::Silu => {
            let sigmoid = g.unary("Sigmoid", x);
            Activated {
                value: g.mul(x, sigmoid),
                sigmoid,
            }
        }
    }
}

impl Activated {
    /// Derivative of the activation: σ·(1 + x·(1 − σ)) = σ + y·(1 − σ) with y = x·σ.
    fn slope(&self, g: &mut Graph) -> Value {
        let rest = g.one_minus(self.sigmoid);
        let bend = g.mul(self.value, rest);
        g.add(self.sigmoid, bend)
    }
}
