//! `bake check`: the model card, measured afresh.

use super::load_model;
use crate::arguments::CheckOptions;
use crate::progress::Stages;
use crate::{backends, output};
use anyhow::{Context, Result};
use bake_runtime::native::Tier;
use bake_runtime::onnxruntime::OrtBackend;
use bake_runtime::{Backend, BakedMaterial, Points};
use bake_train::card::heldout::{PER_STRATUM, STRATA};
use bake_train::card::{self, Bias, Card, PlaceErrors, Runners, Size, StratumErrors, TrainingCost};
use bake_train::presets::Preset;
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the card in a baked folder.
pub const CARD_FILE: &str = "card.json";

/// Of the held-out places, a quick bake measures every so many.
pub const QUICK_EVERY: usize = 4;

/// Keys that need onnxruntime.
const ORT_KEYS: [&str; 3] = [
    "parity.ort_vs_native_max",
    "parity.ort_vs_f64_max",
    "cost.ort_sample_ns",
];
/// Keys that need the exact mixture of two charts.
const MIXTURE_KEYS: [&str; 5] = [
    "errors.*.albedo_bias_mixture",
    "errors.*.weight_relvar_mixture",
    "errors.*.weight_max_mixture",
    "errors.*.newton_unconverged",
    "cost.sample_mixture_ns",
];

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

/// Measures the card of `material`, whose ONNX files lie in `folder`, at every `every`-th held-out place.
pub fn measure(
    material: &BakedMaterial,
    folder: &Path,
    provenance: Provenance,
    every: usize,
    stages: &Stages,
) -> Result<Card> {
    let mut nulls = BTreeMap::new();
    let mut say = |keys: &[&str], reason: &str| {
        nulls.extend(keys.iter().map(|key| (key.to_string(), reason.to_string())));
    };
    let native = backends::native(material)?;
    let ort = match OrtBackend::new(folder) {
        Ok(ort) => Some(ort),
        Err(error) => {
            output::warn(&format!(
                "parity with onnxruntime and ort_sample_ns stay null: {error}"
            ));
            say(&ORT_KEYS, &error.to_string());
            None
        }
    };
    let charts = material.sample.spec.charts().map_or(0, |c| c.anchors.len());
    if charts < 2 {
        say(&MIXTURE_KEYS, "there is one chart, and nothing to mix");
    }
    if provenance.training.is_none() {
        say(&["training"], "there was no card that recorded it");
    }
    let mixture = |points: Points, u: [&[f32]; 2], wi: [&mut [f32]; 3], jacobian: &mut [f32]| {
        let inversions = native.sample_mixture(points, u, wi, jacobian)?;
        Ok(inversions.unconverged as usize)
    };
    let runners = Runners {
        tier: Tier::chosen()?.name(),
        native: &native,
        ort: ort.as_ref().map(|ort| -> &dyn Backend { ort }),
        mixture: (charts > 1).then_some(&mixture as &card::Mixture),
    };
    let (errors, parity, cost) = card::check(material, &runners, every, &|done, total| {
        stages.report("checking held-out places", done, total)
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
    print_errors(card, old);
    print_worst_places(card);
    let c = &card.cost;
    let more = |what: &str, ns: Option<f64>| ns.map_or(String::new(), |ns| format!("; {what} {ns:.0}"));
    output::line(&format!(
        "ns per query, one thread, batch {}, {}: learned {:.0}, with jacobian {:.0}, exact {:.0}, eval {:.0}, pdf {:.0}; \
         reference sample {:.0}, reference eval {:.0}{}{}",
        c.batch,
        c.tier,
        c.sample_learned_ns,
        c.sample_jacobian_ns,
        c.exact_total_ns,
        c.eval_ns,
        c.pdf_ns,
        c.reference_sample_ns,
        c.reference_eval_ns,
        more("exact mixture", c.sample_mixture_ns),
        more("onnxruntime, learned", c.ort_sample_ns),
    ));
    if let Some(percent) = c.percent_of_fma_peak {
        output::line(&format!(
            "the layers of `learned` run at {percent:.0} % of the multiply-add peak, encodings and heads beside them"
        ));
    }
    let p = &card.parity;
    output::line(&format!(
        "largest difference: native to f64 {:.1e}{}",
        p.native_vs_f64_max,
        p.ort_vs_native_max
            .map_or(String::new(), |v| format!(", onnxruntime to native {v:.1e}"))
    ));
}

fn print_errors(card: &Card, old: Option<&Card>) {
    let row = |name: &str, value: &dyn Fn(&StratumErrors) -> Option<f64>| {
        let cells = |card: &Card, width: usize| {
            let cell = |stratum: &str| match card.errors.get(stratum).and_then(value) {
                Some(v) => format!("{v:>width$.2e}"),
                None => format!("{:>width$}", "-"),
            };
            STRATA.map(cell).concat()
        };
        let before = old.map_or(String::new(), |o| format!("   card:{}", cells(o, 10)));
        output::line(&format!("{name:<34}{}{before}", cells(card, 13)));
    };
    row("binning L1, mean", &|e| Some(e.binning_l1.mean));
    row("binning L1, worst", &|e| Some(e.binning_l1.worst));
    row("binning L1, floor", &|e| Some(e.binning_floor));
    row("albedo bias, learned", &|e| Some(e.albedo_bias_learned.mean));
    row("albedo bias, exact", &|e| Some(e.albedo_bias_exact.mean));
    row("   its standard error", &|e| Some(e.albedo_bias_exact.se));
    row("   worst, in standard errors", &|e| {
        Some(e.albedo_bias_exact.worst_sigmas)
    });
    row("   worst, as many are allowed", &|e| {
        Some(e.albedo_bias_exact.worst_allowed_sigmas)
    });
    row("albedo bias, map alone", &|e| Some(e.albedo_bias_map.mean));
    row("albedo bias, exact_baked", &|e| {
        Some(e.albedo_bias_exact_baked.mean)
    });
    row("weight variance, exact, mean", &|e| {
        Some(e.weight_relvar_exact.mean)
    });
    row("weight variance, map alone, mean", &|e| {
        Some(e.weight_relvar_map.mean)
    });
    row("weight variance, mixture, mean", &|e| {
        e.weight_relvar_mixture.map(|s| s.mean)
    });
    row("largest weight, exact", &|e| Some(e.weight_max_exact));
    row("largest weight, mixture", &|e| e.weight_max_mixture);
    row("folded share of u", &|e| Some(e.fold_fraction));
    row("energy not covered", &|e| Some(e.coverage_loss));
    row("χ² effect against pdf network", &|e| Some(e.chi2_effect.mean));
    row("evaluation, relative L1", &|e| Some(e.eval_rel_l1.mean));
    row("∫ pdf dω, mean", &|e| Some(e.pdf_integral.mean));
    let unsound = |name: &str, bias: &dyn Fn(&StratumErrors) -> Option<Bias>| {
        for stratum in STRATA {
            let bias = card.errors.get(stratum).and_then(bias);
            if bias.is_some_and(|b| !(b.mean_within && b.worst_within)) {
                output::line(&format!(
                    "the {name} estimator is biased in {stratum}: see its card"
                ));
            }
        }
    };
    unsound("exact", &|e| Some(e.albedo_bias_exact));
    unsound("exact mixture", &|e| e.albedo_bias_mixture);
}

/// Says where in a domain with free parameters errors are largest.
fn print_worst_places(card: &Card) {
    let labels: Vec<String> = card.domain.free().into_iter().map(|(label, ..)| label).collect();
    if labels.is_empty() {
        return;
    }
    let at = |place: &PlaceErrors| {
        let values = labels.iter().zip(&place.params);
        let values: Vec<String> = values
            .map(|(label, value)| format!("{label} {value:.3}"))
            .collect();
        format!("θ {:.1}°, {}", place.wo[0], values.join(", "))
    };
    for stratum in STRATA {
        let places = card.errors.get(stratum).map_or(&[][..], |e| &e.places);
        for (name, value) in [
            ("binning L1", (|p| p.binning_l1) as fn(&PlaceErrors) -> f64),
            ("weight variance, map alone", |p| p.weight_relvar_map),
        ] {
            if let Some(worst) = places.iter().max_by(|a, b| value(a).total_cmp(&value(b))) {
                output::line(&format!("largest {name}: {:.2e} at {}", value(worst), at(worst)));
            }
        }
    }
}
