//! What a stratum of held-out places comes to.

use super::heldout::HeldOut;
use super::judgement::Bias;
use super::weights::Mixed;
use bake_runtime::Estimate;
use serde::{Deserialize, Serialize};

/// Mean over the held-out set, and the value farthest from zero (or one, for integrals).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Mean of the signed values.
    pub mean: f64,
    /// The worst single value.
    pub worst: f64,
}

/// Errors over one stratum of held-out places. What is said of the mixture is null for a single chart.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StratumErrors {
    /// Σ over bins of |share of samples − true mass|.
    pub binning_l1: Spread,
    /// What a perfect map would score with the same points, bins and truth.
    pub binning_floor: f64,
    /// Relative standard error of the true albedo, worst channel.
    pub albedo_truth_se: Spread,
    /// Learned estimator.
    pub albedo_bias_learned: Bias,
    /// Exact estimator: reference f_cos × jacobian.
    pub albedo_bias_exact: Bias,
    /// The same on f_cos without noise and its own albedo: of the map alone, where the reference's noise hides it.
    pub albedo_bias_map: Bias,
    /// Evaluation network's f_cos × jacobian.
    pub albedo_bias_exact_baked: Bias,
    /// Reference f_cos × jacobian of the exact mixture of charts.
    pub albedo_bias_mixture: Option<Bias>,
    /// Variance over squared mean of the exact estimator's luminance weight, the reference's own noise included.
    pub weight_relvar_exact: Spread,
    /// The same on f_cos without noise: of the map alone.
    pub weight_relvar_map: Spread,
    /// Of the exact mixture of charts, on f_cos without noise.
    pub weight_relvar_mixture: Option<Spread>,
    /// Largest luminance weight of the exact estimator.
    pub weight_max_exact: f64,
    /// Largest luminance weight on f_cos without noise.
    pub weight_max_map: f64,
    /// Largest luminance weight of the exact mixture, on f_cos without noise.
    pub weight_max_mixture: Option<f64>,
    /// Share of the samples whose density in the mixture could not be found by inverting a map.
    pub newton_unconverged: Option<f64>,
    /// Share of u with a negative determinant.
    pub fold_fraction: f64,
    /// True mass of bins that no sample reached.
    pub coverage_loss: f64,
    /// Relative density error of samples against the pdf network.
    pub chi2_effect: Spread,
    /// ∫|f̂ − f|cos / ∫f cos.
    pub eval_rel_l1: Spread,
    /// Mean of the loss that the paper trains with, ‖p − t‖₁ / (‖p‖₁ + ‖t‖₁ + ε) over the channels (Bai et al. 2023, §5.2).
    pub eval_smape: f64,
    /// ∫ pdf dω.
    pub pdf_integral: Spread,
    /// Mean |ln(1 + p̂) − ln(1 + p)| at sampled directions, p the density that divides the exact estimator. Directions that
    /// a whole area of u leads to, as the rim of the disk, have none and are left out.
    pub pdf_log_l1: f64,
    /// The places one by one: in which part of the domain errors are large.
    pub places: Vec<PlaceErrors>,
}

/// Errors at one place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlaceErrors {
    /// Values of the free parameters.
    pub params: Vec<f64>,
    /// θ_o and φ_o, degrees.
    pub wo: [f64; 2],
    /// As in [`StratumErrors`].
    pub binning_l1: f64,
    /// As in [`StratumErrors`].
    pub weight_relvar_map: f64,
    /// As in [`StratumErrors`].
    pub weight_relvar_mixture: Option<f64>,
    /// As in [`StratumErrors`].
    pub eval_rel_l1: f64,
    /// As in [`StratumErrors`].
    pub pdf_integral: f64,
}

/// Everything measured at one place; biases are relative.
pub(super) struct Measured {
    pub place: HeldOut,
    pub binning_l1: f64,
    pub binning_floor: f64,
    pub truth_se: f64,
    pub bias_learned: Estimate,
    pub bias_exact: Estimate,
    pub bias_map: Estimate,
    pub bias_baked: Estimate,
    pub relvar: f64,
    pub relvar_map: f64,
    pub weight_max: f64,
    pub weight_max_map: f64,
    pub mixed: Option<Mixed>,
    pub fold: f64,
    pub coverage_loss: f64,
    pub chi2_effect: f64,
    pub eval_rel_l1: f64,
    pub eval_smape: f64,
    pub pdf_integral: f64,
    pub pdf_log_l1: f64,
}

/// The stratum of `rows`, at least one.
pub(super) fn summarise(rows: &[&Measured]) -> StratumErrors {
    let n = rows.len() as f64;
    let mean = |f: &dyn Fn(&Measured) -> f64| rows.iter().map(|m| f(m)).sum::<f64>() / n;
    let max = |f: &dyn Fn(&Measured) -> f64| rows.iter().map(|m| f(m)).fold(0.0, f64::max);
    let spread = |f: &dyn Fn(&Measured) -> f64| Spread {
        mean: mean(f),
        worst: max(f),
    };
    let bias = |f: &dyn Fn(&Measured) -> Estimate| Bias::of(&rows.iter().map(|m| f(m)).collect::<Vec<_>>());
    let mixed: Option<Vec<&Mixed>> = rows.iter().map(|m| m.mixed.as_ref()).collect();
    let mixed = mixed.as_ref();
    let farther = |w: f64, p: f64| if (p - 1.0).abs() > (w - 1.0).abs() { p } else { w };
    StratumErrors {
        binning_l1: spread(&|m| m.binning_l1),
        binning_floor: mean(&|m| m.binning_floor),
        albedo_truth_se: spread(&|m| m.truth_se),
        albedo_bias_learned: bias(&|m| m.bias_learned),
        albedo_bias_exact: bias(&|m| m.bias_exact),
        albedo_bias_map: bias(&|m| m.bias_map),
        albedo_bias_exact_baked: bias(&|m| m.bias_baked),
        albedo_bias_mixture: mixed.map(|all| Bias::of(&all.iter().map(|m| m.bias).collect::<Vec<_>>())),
        weight_relvar_exact: spread(&|m| m.relvar),
        weight_relvar_map: spread(&|m| m.relvar_map),
        weight_relvar_mixture: mixed.map(|all| Spread {
            mean: all.iter().map(|m| m.relvar).sum::<f64>() / n,
            worst: all.iter().map(|m| m.relvar).fold(0.0, f64::max),
        }),
        weight_max_exact: max(&|m| m.weight_max),
        weight_max_map: max(&|m| m.weight_max_map),
        weight_max_mixture: mixed.map(|all| all.iter().map(|m| m.weight_max).fold(0.0, f64::max)),
        newton_unconverged: mixed.map(|all| all.iter().map(|m| m.unconverged).sum::<f64>() / n),
        fold_fraction: mean(&|m| m.fold),
        coverage_loss: mean(&|m| m.coverage_loss),
        chi2_effect: spread(&|m| m.chi2_effect),
        eval_rel_l1: spread(&|m| m.eval_rel_l1),
        eval_smape: mean(&|m| m.eval_smape),
        pdf_integral: Spread {
            mean: mean(&|m| m.pdf_integral),
            worst: rows.iter().map(|m| m.pdf_integral).fold(1.0, farther),
        },
        pdf_log_l1: mean(&|m| m.pdf_log_l1),
        places: rows.iter().map(|m| m.place_errors()).collect(),
    }
}

impl Measured {
    fn place_errors(&self) -> PlaceErrors {
        let wo = self.place.wo;
        PlaceErrors {
            params: self.place.params.clone(),
            wo: [
                wo.z.acos().to_degrees(),
                wo.y.atan2(wo.x).to_degrees().rem_euclid(360.0),
            ],
            binning_l1: self.binning_l1,
            weight_relvar_map: self.relvar_map,
            weight_relvar_mixture: self.mixed.as_ref().map(|m| m.relvar),
            eval_rel_l1: self.eval_rel_l1,
            pdf_integral: self.pdf_integral,
        }
    }
}
