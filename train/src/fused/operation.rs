//! The kernel as one operation of candle's graph.

use super::{Fused, TileLoss, unpoisoned};
use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor, bail};
use std::sync::Mutex;

/// Mean loss of a network as a function of its flat parameter vector: a scalar that candle can differentiate.
///
/// The forward pass finds the gradient along the way and keeps it for the backward pass, so an operation is
/// good for one forward and one backward pass.
pub struct FusedLoss<L> {
    loss: L,
    queries: usize,
    kernel: Mutex<Fused>,
    gradient: Mutex<Vec<f32>>,
}

impl<L: TileLoss> FusedLoss<L> {
    /// The mean of `loss` over `queries` queries by `kernel`.
    pub fn new(kernel: Fused, queries: usize, loss: L) -> FusedLoss<L> {
        FusedLoss {
            loss,
            queries,
            kernel: Mutex::new(kernel),
            gradient: Mutex::default(),
        }
    }
}

impl<L: TileLoss> CustomOp1 for FusedLoss<L> {
    fn name(&self) -> &'static str {
        "fused_loss"
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let Some((start, end)) = layout.contiguous_offsets() else {
            bail!("fused_loss needs contiguous parameters")
        };
        let parameters = &storage.as_slice::<f32>()?[start..end];
        let mut kernel = unpoisoned(self.kernel.lock());
        let step = kernel.step(parameters, self.queries, &self.loss);
        let (value, gradient) = step.map_err(candle_core::Error::wrap)?;
        *unpoisoned(self.gradient.lock()) = gradient;
        Ok((CpuStorage::F32(vec![value as f32]), Shape::from(())))
    }

    fn bwd(&self, parameters: &Tensor, _value: &Tensor, upstream: &Tensor) -> Result<Option<Tensor>> {
        let gradient = unpoisoned(self.gradient.lock());
        let gradient = Tensor::from_slice(&gradient, parameters.shape(), parameters.device())?;
        Ok(Some(gradient.broadcast_mul(upstream)?))
    }
}
