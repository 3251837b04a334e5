//! A multilayer perceptron in candle's operations.

use super::bias_silu::BiasSilu;
use bake_runtime::network::Dense;
use candle_core::{Device, Result, Tensor, Var};

/// Dense layers with SiLU between them.
#[derive(Clone, Debug)]
pub struct Mlp {
    /// (weight `[out, in]`, bias `[out]`) per layer.
    pub layers: Vec<(Var, Var)>,
}

impl Mlp {
    /// Layers with given weights.
    pub fn from_dense(dense: &[Dense]) -> Result<Mlp> {
        let var = |d: &Dense| -> Result<(Var, Var)> {
            let weight = Var::from_slice(&d.weight, (d.outputs, d.inputs), &Device::Cpu)?;
            Ok((weight, Var::from_slice(&d.bias, d.outputs, &Device::Cpu)?))
        };
        Ok(Mlp {
            layers: dense.iter().map(var).collect::<Result<_>>()?,
        })
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
