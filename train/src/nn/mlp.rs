//! A multilayer perceptron under training.

use super::bias_silu::BiasSilu;
use bake_runtime::network::Dense;
use bake_runtime::random::Rng;
use candle_core::{Device, Result, Tensor, Var};

/// Share of He initialisation that the last layer starts with: the network begins next to the identity map.
const LAST_LAYER_SCALE: f64 = 0.1;

/// Dense layers with SiLU between them.
#[derive(Clone, Debug)]
pub struct Mlp {
    /// (weight `[out, in]`, bias `[out]`) per layer.
    pub layers: Vec<(Var, Var)>,
}

/// A standard normal number (Box and Muller 1958).
fn normal(rng: &mut Rng) -> f64 {
    let radius = (-2.0 * (1.0 - rng.uniform()).ln()).sqrt();
    radius * (2.0 * std::f64::consts::PI * rng.uniform()).cos()
}

impl Mlp {
    /// Layers of the given (inputs, outputs), initialised by He et al. 2015 from `rng`.
    pub fn random(shapes: &[(usize, usize)], rng: &mut Rng) -> Result<Mlp> {
        let last = shapes.len() - 1;
        let dense = shapes.iter().enumerate().map(|(i, &(inputs, outputs))| {
            let gain = if i == last { LAST_LAYER_SCALE } else { 2.0 };
            let scale = (gain / inputs as f64).sqrt();
            let weight = (0..inputs * outputs)
                .map(|_| (scale * normal(rng)) as f32)
                .collect();
            Dense {
                weight,
                bias: vec![0.0; outputs],
                inputs,
                outputs,
            }
        });
        Mlp::from_dense(&dense.collect::<Vec<_>>())
    }

    /// Layers with given weights.
    pub fn from_dense(dense: &[Dense]) -> Result<Mlp> {
        let var = |d: &Dense| -> Result<(Var, Var)> {
            let weight = Var::from_vec(d.weight.clone(), (d.outputs, d.inputs), &Device::Cpu)?;
            Ok((weight, Var::from_vec(d.bias.clone(), d.outputs, &Device::Cpu)?))
        };
        Ok(Mlp {
            layers: dense.iter().map(var).collect::<Result<_>>()?,
        })
    }

    /// The weights as the runtime takes them.
    pub fn to_dense(&self) -> Result<Vec<Dense>> {
        let dense = |(weight, bias): &(Var, Var)| -> Result<Dense> {
            let (outputs, inputs) = weight.dims2()?;
            let weight = weight.flatten_all()?.to_vec1::<f32>()?;
            Ok(Dense {
                weight,
                bias: bias.to_vec1::<f32>()?,
                inputs,
                outputs,
            })
        };
        self.layers.iter().map(dense).collect()
    }

    /// All variables, weight before bias, layer by layer.
    pub fn vars(&self) -> Vec<&Var> {
        self.layers.iter().flat_map(|(w, b)| [w, b]).collect()
    }

    /// Output of rows `x` `[columns·batch, in]`: a block of values, then `columns − 1` blocks of tangents.
    pub fn forward(&self, x: &Tensor, columns: usize) -> Result<Tensor> {
        let mut x = x.clone();
        for (i, (weight, bias)) in self.layers.iter().enumerate() {
            let y = x.matmul(&weight.t()?)?;
            x = if i + 1 < self.layers.len() {
                y.apply_op2(bias.as_tensor(), BiasSilu { columns })?
            } else if columns == 1 {
                y.broadcast_add(bias.as_tensor())?
            } else {
                let batch = y.dim(0)? / columns;
                let values = y.narrow(0, 0, batch)?.broadcast_add(bias.as_tensor())?;
                Tensor::cat(&[values, y.narrow(0, batch, y.dim(0)? - batch)?], 0)?
            };
        }
        Ok(x)
    }
}
