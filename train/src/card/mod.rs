//! The model card: what a baked material is, what it cost, and how far it is from its reference, measured on
//! held-out directions that training never saw.

mod batch;
pub mod binned;
pub mod bins;
pub mod cost;
pub mod heldout;
pub mod measure;
pub mod parity;
pub mod truth;

use crate::Tick;
use crate::error::Result;
use bake_runtime::{BakedMaterial, Material, Network};
use measure::BackendFactory;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Version of the card.
pub const FORMAT: u32 = 1;

/// Mean over the held-out set, and the value farthest from zero (or one, for integrals).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Mean of the signed values.
    pub mean: f64,
    /// The worst single value.
    pub worst: f64,
}

/// A bias with its uncertainty.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Bias {
    /// Mean over directions and channels of mean weight / albedo − 1.
    pub mean: f64,
    /// The value of a single direction and channel that is farthest from 0.
    pub worst: f64,
    /// Standard error of `mean`.
    pub se: f64,
    /// Mean per channel.
    pub mean_rgb: [f64; 3],
}

/// Errors over one stratum of held-out directions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StratumErrors {
    /// Σ over bins of |share of samples − true mass|.
    pub binning_l1: Spread,
    /// What a perfect map would score with the same points, bins and truth.
    pub binning_floor: f64,
    /// Learned estimator.
    pub albedo_bias_learned: Bias,
    /// Exact estimator: reference f_cos × jacobian.
    pub albedo_bias_exact: Bias,
    /// Evaluation network's f_cos × jacobian.
    pub albedo_bias_exact_baked: Bias,
    /// Variance over squared mean of the exact estimator's luminance weight, the reference's own noise included.
    pub weight_relvar_exact: Spread,
    /// Largest luminance weight of the exact estimator.
    pub weight_max_exact: f64,
    /// Share of u with a negative determinant.
    pub fold_fraction: f64,
    /// True mass of bins that no sample reached.
    pub coverage_loss: f64,
    /// Relative density error of samples against the pdf network.
    pub chi2_effect: Spread,
    /// ∫|f̂ − f|cos / ∫f cos.
    pub eval_rel_l1: Spread,
    /// Mean of |f̂ − f| / (f̂ + f) over the frame's square.
    pub eval_smape: f64,
    /// ∫ pdf dω.
    pub pdf_integral: Spread,
    /// Mean |ln(1 + p̂) − ln(1 + p)| at sampled directions, p the sampler's true density.
    pub pdf_log_l1: f64,
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

/// What the training cost.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainingCost {
    /// Seconds of wall time for the networks.
    pub seconds: f64,
    /// Seconds of wall time for frames, slices and maps.
    pub maps_seconds: f64,
    /// Samples drawn.
    pub samples: u64,
    /// Threads used.
    pub threads: usize,
    /// Slices with the fallback map, of all slices: θ_o ≤ 75°, 75–85°, above.
    pub fallback_maps: [(usize, usize); 3],
}

/// Largest differences between ways to run the networks, as |a − b| / max(1, |b|).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Parity {
    /// onnxruntime against native.
    pub ort_vs_native_max: Option<f64>,
    /// Native against the f64 oracle.
    pub native_vs_f64_max: f64,
    /// onnxruntime against the f64 oracle.
    pub ort_vs_f64_max: Option<f64>,
}

/// Nanoseconds per query, one thread.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Always 1.
    pub threads: usize,
    /// Queries per call.
    pub batch: usize,
    /// SIMD tier.
    pub tier: String,
    /// Learned estimator.
    pub sample_learned_ns: f64,
    /// Direction with its jacobian.
    pub sample_jacobian_ns: f64,
    /// Direction with its jacobian and the reference's f_cos.
    pub exact_total_ns: f64,
    /// Evaluation network.
    pub eval_ns: f64,
    /// Pdf network.
    pub pdf_ns: f64,
    /// The reference's random walk.
    pub reference_sample_ns: f64,
    /// The reference's stochastic evaluation.
    pub reference_eval_ns: f64,
    /// onnxruntime, learned estimator.
    pub ort_sample_ns: Option<f64>,
    /// Share of the core's multiply-add peak.
    pub percent_of_fma_peak: Option<f64>,
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
    /// `warp`.
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
    /// Held-out directions measured per stratum; 32 unless the bake was a quick one.
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

/// Measures everything of a card that does not come from its making: errors on every `every`-th held-out direction,
/// parity, cost.
///
/// # Errors
/// [`crate::Error::Interrupted`] when `tick` breaks; whatever a backend reports.
pub fn check(
    material: &BakedMaterial,
    tier: &str,
    native: BackendFactory,
    ort: Option<BackendFactory>,
    every: usize,
    tick: Tick,
) -> Result<(BTreeMap<String, StratumErrors>, Parity, Cost)> {
    let bsdf = material.sample.spec.material.conductor()?;
    let errors = measure::errors(&bsdf, native, every, tick)?;
    Ok((
        errors,
        parity::parity(material, native, ort)?,
        cost::cost(&bsdf, tier, native, ort)?,
    ))
}
