//! The model card: what a baked material is, what it cost, and how far it is from its reference, measured at
//! held-out places that training never saw.

mod albedo;
pub(crate) mod batch;
pub mod binned;
pub mod bins;
mod cost;
mod densities;
#[cfg(test)]
pub(crate) mod fake;
pub mod heldout;
pub mod judgement;
pub mod measure;
mod parity;
mod quadrature;
mod summary;
#[cfg(test)]
mod tests;
pub mod training;
pub mod truth;
mod weights;

pub use cost::Cost;
pub use judgement::Bias;
pub use parity::{Parity, difference, is_next_to_a_jump};
pub use summary::{PlaceErrors, Spread, StratumErrors};
pub use training::{MapsUsed, PaperTraining, Recipe, TrainingCost};

use crate::Tick;
use crate::error::Result;
use bake_runtime::{Backend, BakedMaterial, Material, Network, Points};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Version of the card.
pub const FORMAT: u32 = 1;

/// Draws from two charts and weighs by their exact mixture: as [`Backend::sample_jacobian`] (points, u, wi, jacobian), but
/// the shares of the charts are those of densities that come from inverting the maps; says of how many queries the
/// inversion did not converge.
pub type Mixture<'a> =
    dyn Fn(Points, [&[f32]; 2], [&mut [f32]; 3], &mut [f32]) -> bake_runtime::Result<usize> + Sync + 'a;

/// The ways to run a baked material that its card measures.
#[derive(Clone, Copy)]
pub struct Runners<'a> {
    /// Name of the SIMD tier of `native`.
    pub tier: &'a str,
    /// Our own kernels.
    pub native: &'a dyn Backend,
    /// onnxruntime, where it is there.
    pub ort: Option<&'a dyn Backend>,
    /// The exact mixture of two charts; without it, what is said of the mixture stays null.
    pub mixture: Option<&'a Mixture<'a>>,
}

/// Size of one network.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Size {
    /// Multiply-adds per query.
    pub macs: usize,
    /// Weights and biases.
    pub parameters: usize,
    /// Bytes of the safetensors file.
    pub bytes: usize,
}

/// The model card.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Card {
    /// [`FORMAT`].
    pub format: u32,
    /// Name of the material.
    pub material: String,
    /// Name of its family.
    pub family: String,
    /// `warp` or `paper`.
    pub preset: String,
    /// Fixed parameters and free ranges.
    pub domain: Material,
    /// Seed of the training.
    pub seed: u64,
    /// The command that made it.
    pub command: String,
    /// `sample`, `eval`, `pdf`.
    pub networks: BTreeMap<String, Size>,
    /// What the training cost; `None` where nobody recorded it.
    pub training: Option<TrainingCost>,
    /// Held-out places measured per stratum; 32 unless the bake was a quick one.
    pub heldout_per_stratum: usize,
    /// Errors per stratum: `theta_0_75`, `theta_75_85`, `theta_85_89`.
    pub errors: BTreeMap<String, StratumErrors>,
    /// Agreement of backends.
    pub parity: Parity,
    /// Speed; beside the errors above, never without them.
    pub cost: Cost,
    /// Why a key is null.
    pub nulls: BTreeMap<String, String>,
}

impl Size {
    /// The size of `network`.
    pub fn of(network: &Network) -> Size {
        Size {
            macs: network.spec.macs(),
            parameters: network.spec.parameters(),
            bytes: network.to_bytes().len(),
        }
    }
}

/// Measures everything of a card that does not come from its making: errors at every `every`-th held-out place,
/// parity, cost.
///
/// # Errors
/// [`crate::Error::Interrupted`] when `tick` breaks; [`crate::Error::Runtime`] for a material with more free parameters
/// than [`heldout::DIMENSIONS`], and whatever a backend reports.
pub fn check(
    material: &BakedMaterial,
    runners: &Runners,
    every: usize,
    tick: Tick,
) -> Result<(BTreeMap<String, StratumErrors>, Parity, Cost)> {
    let errors = measure::errors(&material.sample.spec.material, runners, every, tick)?;
    Ok((
        errors,
        parity::parity(material, runners)?,
        cost::cost(
            &material.sample.spec.material,
            material.sample.spec.macs(),
            runners,
        )?,
    ))
}
