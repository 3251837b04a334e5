//! The table of `bake rivals`.

use super::Model;
use super::flow::{self, Budget, Trained};
use crate::output;
use bake_runtime::{BakedMaterial, spec::CHARTS_MAX};
use bake_train::card::Bias;
use bake_train::card::heldout::STRATA;
use bake_train::comparators::standings::{Standing, Standings};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// What `--json` prints.
#[derive(Serialize)]
pub struct Report {
    /// Name of the material.
    pub material: String,
    /// Held-out places measured per stratum.
    pub heldout_per_stratum: usize,
    /// Threads that training used.
    pub threads: usize,
    /// How the flow was trained.
    pub flow: Budget,
    /// The samplers.
    pub rows: Vec<Row>,
    /// One slice as each draws it.
    pub picture: PathBuf,
}

/// One sampler.
#[derive(Serialize)]
pub struct Row {
    /// `warp`, `paper`, `realnvp` or `blinn_phong`.
    pub sampler: String,
    /// Weights and biases; of Blinn–Phong, numbers fitted to every slice.
    pub parameters: usize,
    /// Multiply-adds of a sample alone.
    pub macs: usize,
    /// Multiply-adds of a sample with what its weight is divided by.
    pub macs_with_density: usize,
    /// Minutes that the training of the sampler alone took, without its maps.
    pub training_minutes: Option<f64>,
    /// Where these are from.
    pub training_from: Option<String>,
    /// Per stratum, bias of the weights that a network learned itself, from its card.
    pub albedo_bias_learned: Option<BTreeMap<String, Bias>>,
    /// Errors at the held-out places.
    #[serde(flatten)]
    pub standings: Option<Standings>,
}

impl Row {
    /// The row of a baked material.
    pub fn baked(model: &Model) -> Row {
        let spec = &model.networks.sample.spec;
        let time = flow::sampling_time(model);
        let learned = model.card.as_ref().map(|card| {
            let strata = card.errors.iter();
            let bias = strata.map(|(name, errors)| (name.clone(), errors.albedo_bias_learned));
            bias.collect()
        });
        Row {
            sampler: model.preset().name().into(),
            parameters: spec.parameters(),
            macs: spec.macs(),
            macs_with_density: macs_with_density(&model.networks),
            training_minutes: time.as_ref().map(|t| t.seconds / 60.0),
            training_from: time.map(|t| t.from),
            albedo_bias_learned: learned,
            standings: None,
        }
    }

    /// The row of a flow.
    pub fn flow(trained: &Trained) -> Row {
        let flow = &trained.flow;
        Row {
            sampler: "realnvp".into(),
            parameters: flow.parameters(),
            macs: flow.macs(),
            macs_with_density: flow.macs(),
            training_minutes: trained.seconds.map(|s| s / 60.0),
            training_from: trained.seconds.map(|_| "its learning curve".into()),
            albedo_bias_learned: None,
            standings: None,
        }
    }

    /// The row of a fit to every slice.
    pub fn blinn_phong() -> Row {
        Row {
            sampler: "blinn_phong".into(),
            // Exponent and share.
            parameters: 2,
            macs: 0,
            macs_with_density: 0,
            training_minutes: None,
            training_from: None,
            albedo_bias_learned: None,
            standings: None,
        }
    }

    /// Its name for people.
    pub fn title(&self) -> &str {
        match self.sampler.as_str() {
            "realnvp" => "RealNVP",
            "blinn_phong" => "Blinn–Phong",
            other => other,
        }
    }

    /// `value` of every stratum, from the normal to the horizon.
    fn strata<T>(&self, value: impl Fn(&Standing) -> T) -> Option<[T; 3]> {
        let found = self.standings.as_ref()?;
        let values = STRATA.iter().map(|name| found.strata.get(*name).map(&value));
        values.collect::<Option<Vec<T>>>()?.try_into().ok()
    }
}

/// Multiply-adds of a sample with its jacobian: the frame network once, value and two tangents through the other, and with
/// two charts the densities of both.
fn macs_with_density(networks: &BakedMaterial) -> usize {
    let spec = &networks.sample.spec;
    let frame: usize = spec.frame_layers().iter().map(|(i, o)| i * o).sum();
    let charts = spec.charts().map_or(1, |c| c.anchors.len());
    let densities = match charts == CHARTS_MAX {
        true => networks.pdf.spec.macs(),
        false => 0,
    };
    frame + 3 * (spec.macs() - frame) + densities
}

impl Report {
    /// Prints it as a table.
    pub fn print(&self) {
        output::line(&format!(
            "\n{}, {} held-out places per stratum",
            self.material, self.heldout_per_stratum
        ));
        output::line(&format!(
            "{:<13}{:<24}{:<27}{:<20}{:<17}{:>10}{:>9}",
            "",
            "binning L1",
            "variance of the weight",
            "albedo bias, %",
            "multiply-adds",
            "parameters",
            "minutes"
        ));
        let thetas = ["≤ 75°", "75–85°", "85–89°"];
        let heads = |width: usize| thetas.map(|t| format!("{t:<width$}")).concat();
        output::line(&format!(
            "{:<13}{}{}{:<20}{:<8}{:<9}",
            "",
            heads(8),
            heads(9),
            "mean ± se",
            "sample",
            "+density"
        ));
        for row in &self.rows {
            self.print_row(row);
        }
        if let Some(floor) = self.rows.first().and_then(|row| row.strata(|s| s.binning_floor)) {
            output::line(&format!(
                "{:<13}{}",
                "floor",
                floor.map(|v| format!("{v:<8.4}")).concat()
            ));
        }
        for row in &self.rows {
            print_notes(row);
        }
        output::line(&format!(
            "binning L1: share of samples in the wrong one of 64² bins, twice counted; floor: what a perfect sampler scores. \
             variance: of f_cos · jacobian over its squared mean, without the reference's noise. bias: of the same over all \
             places and channels. Both are means over places. minutes: training of the sampler alone on {} threads, \
             without maps; Blinn–Phong is fitted to every slice",
            self.threads
        ));
        output::line(&self.picture.display().to_string());
    }

    fn print_row(&self, row: &Row) {
        let (Some(standings), Some(binning), Some(variance)) = (
            &row.standings,
            row.strata(|s| s.binning_l1.mean),
            row.strata(|s| s.weight_relvar.mean),
        ) else {
            return;
        };
        let bias = &standings.albedo_bias;
        let bias = format!("{:+.3} ± {:.3}", 100.0 * bias.mean, 100.0 * bias.se);
        let minutes = row.training_minutes.map_or("–".into(), |m| format!("{m:.2}"));
        output::line(&format!(
            "{:<13}{}{}{bias:<20}{:<8}{:<9}{:>10}{minutes:>9}",
            row.title(),
            binning.map(|v| format!("{v:<8.4}")).concat(),
            variance.map(|v| format!("{v:<9.2e}")).concat(),
            row.macs,
            row.macs_with_density,
            row.parameters
        ));
    }
}

/// What does not fit into the row.
fn print_notes(row: &Row) {
    let three = |values: [f64; 3]| values.map(|v| format!("{:.2}", 100.0 * v)).join(" / ");
    if let Some(lost) = row
        .strata(|s| s.lost)
        .filter(|lost| lost.iter().any(|l| *l > 0.0))
    {
        output::line(&format!(
            "{}: {} % of the samples are below the horizon",
            row.title(),
            three(lost)
        ));
    }
    let learned = row.albedo_bias_learned.as_ref();
    let learned = learned.map(|strata| STRATA.map(|name| strata.get(name).map_or(f64::NAN, |b| b.mean)));
    if let Some(learned) = learned {
        output::line(&format!(
            "{}: the weight that its network learned is off by {} %, says its card",
            row.title(),
            three(learned)
        ));
    }
    if let Some(from) = &row.training_from {
        output::line(&format!("{}: minutes from {from}", row.title()));
    }
}
