//! The numbers of a network under training: one flat vector, layer by layer the weight `[out][in]`, then the bias.

use bake_runtime::network::Dense;
use bake_runtime::random::Rng;

/// Share of He initialisation that the last layer starts with: the network begins next to the identity map.
const LAST_LAYER_SCALE: f64 = 0.1;

/// Widths and numbers of a multilayer perceptron.
#[derive(Clone, Debug, PartialEq)]
pub struct Mlp {
    /// (inputs, outputs) of each layer.
    pub layers: Vec<(usize, usize)>,
    /// All weights and biases.
    pub values: Vec<f32>,
}

/// A standard normal number (Box and Muller 1958).
fn normal(rng: &mut Rng) -> f64 {
    let radius = (-2.0 * (1.0 - rng.uniform()).ln()).sqrt();
    radius * (2.0 * std::f64::consts::PI * rng.uniform()).cos()
}

impl Mlp {
    /// Layers of the given (inputs, outputs), initialised by He et al. 2015 from `rng`; biases are 0.
    pub fn random(layers: &[(usize, usize)], rng: &mut Rng) -> Mlp {
        let last = layers.len().saturating_sub(1);
        let mut values = Vec::new();
        for (i, &(inputs, outputs)) in layers.iter().enumerate() {
            let gain = if i == last { LAST_LAYER_SCALE } else { 2.0 };
            let scale = (gain / inputs as f64).sqrt();
            values.extend((0..inputs * outputs).map(|_| (scale * normal(rng)) as f32));
            values.resize(values.len() + outputs, 0.0);
        }
        Mlp {
            layers: layers.to_vec(),
            values,
        }
    }

    /// The layers as the runtime takes them.
    pub fn to_dense(&self) -> Vec<Dense> {
        let mut rest = &self.values[..];
        let dense = |&(inputs, outputs): &(usize, usize)| {
            let (weight, after) = rest.split_at(inputs * outputs);
            let (bias, after) = after.split_at(outputs);
            rest = after;
            Dense {
                weight: weight.to_vec(),
                bias: bias.to_vec(),
                inputs,
                outputs,
            }
        };
        self.layers.iter().map(dense).collect()
    }
}
