//! What a training cost, and what the paper's cost.

use crate::maps::Summary;
use crate::optimiser::Rule;
use crate::training::run::Plan;
use crate::transport::Solver;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What the training of a material cost; the command stands on the card itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainingCost {
    /// Seconds of wall time for the networks.
    pub seconds: f64,
    /// Seconds of wall time for charts, slices and maps.
    pub maps_seconds: f64,
    /// Samples drawn, over all networks.
    pub samples: u64,
    /// Threads used.
    pub threads: usize,
    /// The maps that the sampling network learned from.
    pub maps: MapsUsed,
    /// How each network was trained: `sample`, `eval`, `pdf`, and `charts` where there are any.
    pub networks: BTreeMap<String, Recipe>,
    /// For the paper's preset, how the paper trained.
    pub paper: Option<PaperTraining>,
}

/// Importance maps that a network learned from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapsUsed {
    /// Name of the solver.
    pub solver: String,
    /// Cells per side.
    pub cells: usize,
    /// Number of slices.
    pub slices: usize,
    /// Where the network is told positions: `charts` or `disk`.
    pub positions: String,
    /// Fallback maps, of all maps (one per chart): θ_o ≤ 75°, 75–85°, above.
    pub fallback_maps: [(usize, usize); 3],
}

impl MapsUsed {
    /// Maps of `cells`² cells by `solver`, told on the disk or in charts.
    pub fn new(solver: Solver, cells: usize, on_disk: bool, maps: &Summary) -> MapsUsed {
        MapsUsed {
            solver: solver.name().into(),
            cells,
            slices: maps.slices,
            positions: if on_disk { "disk" } else { "charts" }.into(),
            fallback_maps: maps.strata.map(|c| (c.fallbacks, c.maps)),
        }
    }
}

/// How a network was trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recipe {
    /// `muon`, `adam` or `ranger`.
    pub optimiser: String,
    /// Peak learning rate.
    pub learning_rate: f64,
    /// Samples per step.
    pub batch: usize,
    /// Steps.
    pub steps: u64,
}

impl Recipe {
    /// That of `plan`.
    pub fn of(plan: &Plan) -> Recipe {
        Recipe {
            optimiser: match plan.rule {
                Rule::Muon => "muon",
                Rule::Adam => "adam",
                Rule::Ranger => "ranger",
            }
            .into(),
            learning_rate: plan.rate,
            batch: plan.batch,
            steps: plan.steps,
        }
    }
}

/// How Bai et al. 2023 trained each material, as their §5.2 has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PaperTraining {
    /// Where.
    pub hardware: String,
    /// Samples per step.
    pub batch: usize,
    /// Learning rate.
    pub learning_rate: f64,
    /// Epochs of each network; of how many samples the paper does not say.
    pub epochs: u32,
    /// Optimiser of `sample`, `eval` and `pdf`.
    pub optimisers: BTreeMap<String, String>,
    /// Hours for `sample`, `eval` and `pdf`.
    pub hours: BTreeMap<String, f64>,
}

impl PaperTraining {
    /// The numbers as printed.
    pub fn printed() -> PaperTraining {
        let rows = [
            ("sample", "adam", 48.0),
            ("eval", "ranger", 12.0),
            ("pdf", "ranger", 12.0),
        ];
        PaperTraining {
            hardware: "one NVIDIA RTX 3090".into(),
            batch: 1 << 20,
            learning_rate: 1e-4,
            epochs: 500,
            optimisers: rows
                .map(|(name, optimiser, _)| (name.into(), optimiser.into()))
                .into(),
            hours: rows.map(|(name, _, hours)| (name.into(), hours)).into(),
        }
    }
}
