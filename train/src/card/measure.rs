//! The errors of a baked material over the held-out places, as the definitions of [`StratumErrors`] say.

use super::Runners;
use super::batch::Buffers;
use super::densities::{chi2_effect, densities};
use super::heldout::{self, HeldOut};
use super::summary::{Measured, StratumErrors, summarise};
use super::truth::Truth;
use super::weights;
use crate::Tick;
use crate::error::Result;
use crate::maps::advance;
use bake_runtime::{Material, Reference};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::atomic::AtomicU64;

/// R2 points behind the binning and the learned estimator.
pub const BINNING_POINTS: u64 = 1 << 21;

/// Queries behind the errors of one place; multiples of [`super::batch::BATCH`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Samples {
    /// R2 points behind the binning and the learned estimator.
    pub binning: u64,
    /// Random points behind the exact estimators and the χ² test.
    pub exact: usize,
    /// Random points behind the exact mixture, whose inversions are slow.
    pub mixture: usize,
    /// Nodes per chart behind the errors of the evaluation and pdf networks.
    pub density: usize,
}

impl Samples {
    /// Those of cards.
    pub const CARD: Samples = Samples {
        binning: BINNING_POINTS,
        exact: 1 << 18,
        mixture: 1 << 16,
        density: 1 << 12,
    };
}

/// Measures all strata of the domain of `material`, at every `every`-th of their places.
///
/// # Errors
/// [`crate::Error::Interrupted`] when `tick` breaks; as [`heldout::places`]; whatever a backend reports.
pub fn errors(
    material: &Material,
    runners: &Runners,
    every: usize,
    tick: Tick,
) -> Result<BTreeMap<String, StratumErrors>> {
    let strata = heldout::places(material)?;
    let all: Vec<(&String, u64, &HeldOut)> = strata
        .iter()
        .flat_map(|(name, places)| {
            let some = places.iter().enumerate().step_by(every);
            some.map(move |(i, place)| (name, i as u64, place))
        })
        .collect();
    let done = AtomicU64::new(0);
    // One place is one task: they take between one and ten seconds.
    let measured: Result<Vec<Measured>> = all
        .par_iter()
        .with_max_len(1)
        .map(|&(name, i, place)| {
            let key = name
                .bytes()
                .fold(i, |h, b| h.wrapping_mul(31).wrapping_add(u64::from(b)));
            let reference = material.bind(&place.params)?;
            let measured = measure(&reference, place, runners, &Samples::CARD, key)?;
            advance(&done, all.len(), tick)?;
            Ok(measured)
        })
        .collect();
    let measured = measured?;
    let of = |name: &str| -> Vec<&Measured> {
        let rows = all.iter().zip(&measured);
        rows.filter(|((n, ..), _)| n.as_str() == name)
            .map(|(_, m)| m)
            .collect()
    };
    Ok(strata
        .keys()
        .map(|name| (name.clone(), summarise(&of(name))))
        .collect())
}

/// Measures one place, where the material is `reference`; `key` tells it from others.
pub(super) fn measure(
    reference: &Reference,
    place: &HeldOut,
    runners: &Runners,
    samples: &Samples,
    key: u64,
) -> Result<Measured> {
    let truth = Truth::new(reference, place.wo)?;
    let backend = runners.native;
    let mut buffers = Buffers::new(place);
    let learned = weights::learned(&truth, samples, backend, &mut buffers)?;
    let exact = weights::exact(reference, &truth, samples, backend, &mut buffers, key)?;
    let mixed = runners
        .mixture
        .map(|m| weights::mixed(reference, &truth, samples, m, &mut buffers, key))
        .transpose()?;
    let densities = densities(&truth, samples, backend, &mut buffers)?;
    let chi2_effect = chi2_effect(&truth, &exact.counts, backend, &mut buffers)?;
    let truth_se =
        (truth.albedo.se / truth.albedo.mean.max(glam::DVec3::splat(f64::MIN_POSITIVE))).max_element();
    Ok(Measured {
        place: place.clone(),
        binning_l1: learned.binning_l1,
        binning_floor: truth.binned.floor(samples.binning),
        truth_se,
        bias_learned: learned.bias,
        bias_exact: exact.bias,
        bias_map: exact.bias_map,
        bias_baked: exact.bias_baked,
        relvar: exact.relvar,
        relvar_map: exact.relvar_map,
        weight_max: exact.weight_max,
        weight_max_map: exact.weight_max_map,
        mixed,
        fold: exact.fold,
        coverage_loss: learned.coverage_loss,
        chi2_effect,
        eval_rel_l1: densities.eval_rel_l1,
        eval_smape: densities.eval_smape,
        pdf_integral: densities.pdf_integral,
        pdf_log_l1: exact.pdf_log_l1,
    })
}
