//! Options of the commands that bake materials, and of those that take a baked one.

use super::values::{positive_seconds, preset};
use bake_train::presets::Preset;
use clap::Args;
use std::path::PathBuf;

/// Options of `bake train`.
#[derive(Debug, Args)]
pub struct TrainOptions {
    /// A material file, or the name of one in scenes/materials.
    pub material: String,
    /// Which networks and losses: warp or paper.
    #[arg(long, default_value = "warp", value_parser = preset)]
    pub preset: Preset,
    /// Where networks, card and checkpoints go [default: out/materials/NAME, or NAME-paper].
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Fewer slices and steps: a first look in about a minute.
    #[arg(long)]
    pub quick: bool,
    /// Seed of everything; the same seed gives the same networks, byte for byte.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Go on from the checkpoints of an interrupted run.
    #[arg(long)]
    pub resume: bool,
    /// Print the model card as one JSON object on standard output.
    #[arg(long)]
    pub json: bool,
}

/// Options of `bake check`.
#[derive(Debug, Args)]
pub struct CheckOptions {
    /// Folder of a baked material, e.g. scenes/materials/vase.
    pub model: PathBuf,
    /// Print the model card, measured afresh, as one JSON object on standard output.
    #[arg(long)]
    pub json: bool,
}

/// Options of `bake rivals`.
#[derive(Debug, Args)]
pub struct RivalsOptions {
    /// Folder of a baked material.
    pub model: PathBuf,
    /// Folder of the same material baked with `--preset paper`, to be measured beside it.
    #[arg(long, value_name = "MODEL")]
    pub paper: Option<PathBuf>,
    /// Train the flow for about this many seconds [default: as long as the sampling network of MODEL was trained].
    #[arg(long, conflicts_with = "steps", value_parser = positive_seconds)]
    pub seconds: Option<f64>,
    /// Train the flow for this many steps instead.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    pub steps: Option<u64>,
    /// Measure every fourth held-out place only.
    #[arg(long)]
    pub quick: bool,
    /// Where table, picture and checkpoints go [default: out/rivals/NAME].
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Seed of the flow and of what it learns from.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Go on from the checkpoints of an interrupted run, with its number of steps and its seed.
    #[arg(long, conflicts_with_all = ["steps", "seconds"])]
    pub resume: bool,
    /// Print the table as one JSON object on standard output.
    #[arg(long)]
    pub json: bool,
}

/// Options of `bake export`.
#[derive(Debug, Args)]
pub struct ExportOptions {
    /// Folder of a baked material with its safetensors files.
    pub model: PathBuf,
}
