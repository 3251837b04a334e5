//! The networks that ship are those of today's presets for the materials of today's files, and their cards keep to what is
//! claimed of them. That cards tell the truth is what `tests/binning.rs` measures.

#[path = "support/shipped.rs"]
mod shipped;

use bake_runtime::{BakedMaterial, Role};
use bake_scenes::material_file::load_material;
use bake_train::card::heldout::STRATA;
use bake_train::presets::Preset;
use shipped::{card, folder};
use std::collections::BTreeSet;

/// The materials whose networks ship, in all of [`PRESETS`].
const SHIPPED: [&str; 4] = ["conductor", "layered", "principled", "vase"];
/// See [`SHIPPED`].
const PRESETS: [Preset; 2] = [Preset::Warp, Preset::Paper];
/// Everything that is committed of models, in MB of 10⁶ bytes.
const SHIPPED_MB: f64 = 20.0;

/// What the cards of the warp preset keep to: means over θ_o ≤ 75° and 85–89°.
struct Limits {
    material: &'static str,
    binning_l1: [f64; 2],
    /// Variance of the exact weight, by the mixture's density where there are two charts.
    relvar: [f64; 2],
    eval_rel_l1: [f64; 2],
}

/// The vase is the conductor with nothing but `wo` free.
const LIMITS: [Limits; 4] = [
    Limits {
        material: "vase",
        binning_l1: [0.025, 0.08],
        relvar: [0.01, 0.2],
        eval_rel_l1: [0.01, 0.03],
    },
    Limits {
        material: "conductor",
        binning_l1: [0.05, 0.15],
        // No limit was set at grazing angles: a tenfold deviation would be noticed.
        relvar: [0.02, 0.5],
        eval_rel_l1: [0.03, 0.06],
    },
    Limits {
        material: "layered",
        binning_l1: [0.035, 0.11],
        relvar: [0.01, 0.3],
        eval_rel_l1: [0.03, 0.06],
    },
    Limits {
        material: "principled",
        binning_l1: [0.025, 0.08],
        relvar: [0.005, 0.15],
        eval_rel_l1: [0.03, 0.06],
    },
];
/// The same of |mean bias| of the learned weight, and of the integral of the pdf − 1.
const LEARNED_BIAS: [f64; 2] = [0.005, 0.03];
/// See [`LEARNED_BIAS`].
const PDF_INTEGRAL: [f64; 2] = [0.02, 0.06];
/// The exact weight's mean bias where its standard error is smaller.
const EXACT_BIAS: f64 = 5e-4;
/// Strata of [`Limits`].
const NEAR_AND_GRAZING: [&str; 2] = [STRATA[0], STRATA[2]];

fn name(material: &str, preset: Preset) -> String {
    match preset {
        Preset::Warp => material.into(),
        Preset::Paper => format!("{material}-paper"),
    }
}

#[test]
fn nothing_else_ships() {
    let entries = std::fs::read_dir(folder("")).expect("materials are part of the tree");
    let folders = entries
        .map(|entry| entry.expect("readable").path())
        .filter(|path| path.is_dir());
    let found: BTreeSet<String> = folders
        .map(|path| {
            path.file_name()
                .and_then(|n| n.to_str())
                .expect("plain names")
                .to_string()
        })
        .collect();
    let all = SHIPPED
        .iter()
        .flat_map(|material| PRESETS.map(|preset| name(material, preset)));
    assert_eq!(found, all.collect());
}

#[test]
fn networks_are_of_todays_presets_and_files() {
    for material in SHIPPED {
        let file = load_material(&folder("").join(format!("{material}.toml"))).expect("its own file");
        for preset in PRESETS {
            let name = name(material, preset);
            let baked = BakedMaterial::load(&folder(&name)).unwrap_or_else(|e| panic!("{name}: {e}"));
            for (role, network) in [
                (Role::Sample, &baked.sample),
                (Role::Eval, &baked.eval),
                (Role::Pdf, &baked.pdf),
            ] {
                let spec = preset.spec(role, &file).expect("it can be baked");
                assert!(
                    network.spec == spec,
                    "{name}: its {} network is of another specification",
                    role.name()
                );
            }
            let card = card(&name);
            assert_eq!(
                (card.material.as_str(), card.preset.as_str()),
                (material, preset.name())
            );
            assert_eq!(card.domain, file, "{name}");
            let training = card
                .training
                .unwrap_or_else(|| panic!("{name}: its card has no training"));
            assert!(
                training.seconds > 0.0 && training.maps_seconds > 0.0 && training.samples > 0,
                "{name}"
            );
            assert_eq!(
                card.command,
                format!("bake train {material} --preset {preset} --seed {}", card.seed)
            );
        }
    }
}

#[test]
fn cards_of_the_warp_preset_keep_to_their_limits() {
    for limits in LIMITS {
        let name = limits.material;
        let card = card(name);
        for (i, stratum) in NEAR_AND_GRAZING.into_iter().enumerate() {
            let errors = &card.errors[stratum];
            let below = |what: &str, value: f64, limit: f64| {
                assert!(
                    value.abs() <= limit,
                    "{name}, {stratum}: {what} {value} above {limit}"
                );
            };
            below("binning", errors.binning_l1.mean, limits.binning_l1[i]);
            let relvar = errors.weight_relvar_mixture.unwrap_or(errors.weight_relvar_exact);
            below("variance", relvar.mean, limits.relvar[i]);
            below("evaluation", errors.eval_rel_l1.mean, limits.eval_rel_l1[i]);
            below("learned bias", errors.albedo_bias_learned.mean, LEARNED_BIAS[i]);
            below(
                "integral of the pdf - 1",
                errors.pdf_integral.mean - 1.0,
                PDF_INTEGRAL[i],
            );
            let exact = errors.albedo_bias_exact;
            below("exact bias", exact.mean, EXACT_BIAS.max(3.0 * exact.se));
            assert!(exact.worst_within, "{name}, {stratum}: {exact:?}");
        }
    }
}

#[test]
fn what_ships_is_small() {
    let mut bytes = 0;
    for entry in std::fs::read_dir(folder("")).expect("materials are part of the tree") {
        let path = entry.expect("readable").path();
        if path.is_dir() {
            let files = std::fs::read_dir(path).expect("readable");
            bytes += files
                .map(|f| f.and_then(|f| f.metadata()).expect("readable").len())
                .sum::<u64>();
        }
    }
    let mb = bytes as f64 / 1e6;
    assert!(mb < SHIPPED_MB, "{mb} MB");
}
