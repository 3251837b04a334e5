//! The frame network: `wo` ↦ lobe frame, trained on fitted frames relative to their analytic anchor.

use super::mlp::Mlp;
use crate::Tick;
use crate::error::Result;
use crate::places::Place;
use crate::training::trainer::{Plan, Trainer};
use bake_runtime::encoding::{GRAZING_FEATURES, grazing};
use bake_runtime::frame::{FRAME_OUTPUTS, Frame};
use bake_runtime::network::Dense;
use bake_runtime::oracle::predict_frame;
use bake_runtime::spec::{Activation, NetworkSpec};
use candle_core::{Device, Tensor};
use std::path::Path;

/// A trained frame network.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameNetwork {
    /// Its layers.
    pub layers: Vec<Dense>,
    /// Roughness in the anchor.
    pub anchor_alpha: [f64; 2],
}

impl FrameNetwork {
    /// The frame at `wo`, folded to x, y ≥ 0.
    pub fn predict(&self, wo: [f64; 3]) -> Frame {
        predict_frame(&self.layers, Activation::Silu, self.anchor_alpha, wo)
    }

    /// A hash of its weights.
    pub fn hash(&self) -> u64 {
        let weights = self.layers.iter().flat_map(|l| l.weight.iter().chain(&l.bias));
        crate::maps::hash(weights.map(|w| u64::from(w.to_bits())))
    }

    /// Trains on `directions` with their fitted `targets`, in the widths that `spec` gives its frame network.
    ///
    /// # Errors
    /// As [`Trainer::run`].
    pub fn train(
        spec: &NetworkSpec,
        plan: Plan,
        directions: &[Place],
        targets: &[[f64; FRAME_OUTPUTS]],
        folder: &Path,
        tick: Tick,
    ) -> Result<FrameNetwork> {
        // The targets are fitted to the whole material, not to its roughness alone.
        let context = format!(
            "{:?} {} frames, anchor {:?}",
            spec.material,
            directions.len(),
            spec.frame.anchor_alpha
        );
        let trainer = Trainer::new(plan, &spec.frame_layers(), folder, &context)?;
        let features: Vec<[f32; GRAZING_FEATURES]> = directions
            .iter()
            .map(|place| grazing(place.wo).map(|v| v as f32))
            .collect();
        let mlp = trainer.run(
            |mlp: &Mlp, _, batch, rng| {
                let (mut x, mut y) = (Vec::new(), Vec::new());
                for _ in 0..batch {
                    let k = (rng.uniform() * directions.len() as f64) as usize;
                    x.extend(features[k]);
                    y.extend(targets[k].map(|v| v as f32));
                }
                let x = Tensor::from_vec(x, (batch, GRAZING_FEATURES), &Device::Cpu)?;
                let y = Tensor::from_vec(y, (batch, FRAME_OUTPUTS), &Device::Cpu)?;
                Ok((mlp.forward(&x, 1)? - y)?.abs()?.mean_all()?)
            },
            tick,
        )?;
        Ok(FrameNetwork {
            layers: mlp.to_dense()?,
            anchor_alpha: spec.frame.anchor_alpha,
        })
    }
}
