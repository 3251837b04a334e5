//! `bake check`: the model card, measured afresh.

use super::load_model;
use crate::arguments::CheckOptions;
use crate::progress::Stages;
use crate::{backends, output};
use anyhow::{Context, Result};
use bake_runtime::BakedMaterial;
use bake_runtime::native::Tier;
use bake_train::card::heldout::PER_STRATUM;
use bake_train::card::{self, Card, Runners, Size, TrainingCost};
use bake_train::presets::Preset;
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the card in a baked folder.
pub const CARD_FILE: &str = "card.json";

/// Of the held-out directions, a quick bake measures every so many.
pub const QUICK_EVERY: usize = 4;

/// What is known of a bake besides what can be measured.
pub struct Provenance {
    /// Seed of the training.
    pub seed: u64,
    /// The command that made it.
    pub command: String,
    /// What the training cost.
    pub training: Option<TrainingCost>,
}

/// Runs the command.
pub fn run(options: &CheckOptions) -> Result<()> {
    let material = load_model(&options.model)?;
    let old = read_card(&options.model.join(CARD_FILE))?;
    let provenance = match &old {
        Some(card) => Provenance {
            seed: card.seed,
            command: card.command.clone(),
            training: card.training.clone(),
        },
        None => Provenance {
            seed: 0,
            command: String::new(),
            training: None,
        },
    };
    let card = measure(&material, &options.model, provenance, 1, &Stages::new())?;
    if options.json {
        return output::json(&card);
    }
    print(&card, old.as_ref());
    Ok(())
}

/// Reads the card at `path`; `None` where there is no file.
pub fn read_card(path: &Path) -> Result<Option<Card>> {
    if !path.exists() {
        return Ok(None);
    }
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let card = serde_json::from_str(&text).with_context(|| {
        format!(
            "{}: not a model card of this version; delete it, or bake the material again",
            path.display()
        )
    })?;
    Ok(Some(card))
}

/// Measures the card of `material`, whose ONNX files lie in `folder`, on every `every`-th held-out direction.
pub fn measure(
    material: &BakedMaterial,
    folder: &Path,
    provenance: Provenance,
    every: usize,
    stages: &Stages,
) -> Result<Card> {
    let native = || backends::native(material);
    let ort = || backends::ort(folder);
    let mut nulls = BTreeMap::new();
    let has_ort = match ort() {
        Ok(_) => true,
        Err(error) => {
            output::warn(&format!(
                "parity with onnxruntime and ort_sample_ns stay null: {error}"
            ));
            for key in [
                "parity.ort_vs_native_max",
                "parity.ort_vs_f64_max",
                "cost.ort_sample_ns",
            ] {
                nulls.insert(key.to_string(), error.to_string());
            }
            false
        }
    };
    nulls.insert(
        "cost.percent_of_fma_peak".into(),
        "the machine's peak is not measured by this version".into(),
    );
    if provenance.training.is_none() {
        nulls.insert("training".into(), "there was no card that recorded it".into());
    }
    let mixture = || backends::mixture(material);
    let charts = material.sample.spec.charts().map_or(0, |c| c.anchors.len());
    let runners = Runners {
        tier: Tier::best().name(),
        native: &native,
        ort: has_ort.then_some(&ort),
        mixture: (charts > 1).then_some(&mixture),
    };
    let (errors, parity, cost) = card::check(material, &runners, every, &|done, total| {
        stages.report("checking held-out slices", done, total)
    })?;
    stages.finish();
    let spec = &material.sample.spec;
    let networks = [&material.sample, &material.eval, &material.pdf];
    Ok(Card {
        format: card::FORMAT,
        material: spec.material.name.clone(),
        family: spec.material.family.name().to_string(),
        preset: Preset::of(spec).name().to_string(),
        domain: spec.material.clone(),
        seed: provenance.seed,
        command: provenance.command,
        networks: networks
            .iter()
            .map(|n| (n.spec.role.name().to_string(), Size::of(n)))
            .collect(),
        training: provenance.training,
        heldout_per_stratum: PER_STRATUM.div_ceil(every),
        errors,
        parity,
        cost,
        nulls,
    })
}

/// Prints the errors and costs of `card`, beside those of `old`.
pub fn print(card: &Card, old: Option<&Card>) {
    output::line(&format!(
        "{} ({}, {} preset)",
        card.material, card.family, card.preset
    ));
    output::line(&format!(
        "{:<34}{:>13}{:>13}{:>13}",
        "", "θ ≤ 75°", "75–85°", "85–89°"
    ));
    let strata = ["theta_0_75", "theta_75_85", "theta_85_89"];
    let row = |name: &str, value: &dyn Fn(&card::StratumErrors) -> f64| {
        let cells = |card: &Card| strata.map(|s| card.errors.get(s).map_or(f64::NAN, value));
        let text = cells(card).map(|v| format!("{v:>13.2e}")).concat();
        let before = old.map_or(String::new(), |o| {
            format!("   card:{}", cells(o).map(|v| format!("{v:>10.2e}")).concat())
        });
        output::line(&format!("{name:<34}{text}{before}"));
    };
    row("binning L1, mean", &|e| e.binning_l1.mean);
    row("binning L1, worst", &|e| e.binning_l1.worst);
    row("binning L1, floor", &|e| e.binning_floor);
    row("albedo bias, learned", &|e| e.albedo_bias_learned.mean);
    row("albedo bias, exact", &|e| e.albedo_bias_exact.mean);
    row("   its standard error", &|e| e.albedo_bias_exact.se);
    row("albedo bias, exact_baked", &|e| e.albedo_bias_exact_baked.mean);
    row("weight variance, exact, mean", &|e| e.weight_relvar_exact.mean);
    row("largest weight, exact", &|e| e.weight_max_exact);
    row("folded share of u", &|e| e.fold_fraction);
    row("energy not covered", &|e| e.coverage_loss);
    row("χ² effect against pdf network", &|e| e.chi2_effect.mean);
    row("evaluation, relative L1", &|e| e.eval_rel_l1.mean);
    row("∫ pdf dω, mean", &|e| e.pdf_integral.mean);
    let c = &card.cost;
    output::line(&format!(
        "ns per query, one thread, batch {}, {}: learned {:.0}, with jacobian {:.0}, exact {:.0}, eval {:.0}, pdf {:.0}; \
         reference walk {:.0}, reference eval {:.0}{}",
        c.batch,
        c.tier,
        c.sample_learned_ns,
        c.sample_jacobian_ns,
        c.exact_total_ns,
        c.eval_ns,
        c.pdf_ns,
        c.reference_sample_ns,
        c.reference_eval_ns,
        c.ort_sample_ns
            .map_or(String::new(), |ns| format!("; onnxruntime, learned {ns:.0}")),
    ));
    let p = &card.parity;
    output::line(&format!(
        "largest difference: native to f64 {:.1e}{}",
        p.native_vs_f64_max,
        p.ort_vs_native_max
            .map_or(String::new(), |v| format!(", onnxruntime to native {v:.1e}"))
    ));
}
