//! Options of the commands that look at materials: questions, pictures, maps, costs.

use super::values::{assignment, cells, finite, measured_family, polar_angle, solver};
use bake_runtime::Family;
use bake_runtime::field::Field;
use bake_train::transport::Solver;
use clap::Args;
use std::path::PathBuf;

/// Options of `bake query`.
#[derive(Debug, Args)]
pub struct QueryOptions {
    /// A family (its reference model), a material file or its name in scenes/materials, or a folder of networks.
    pub subject: String,
    /// Seed of the random numbers; an answer depends on it and on its own line alone.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

/// Options of `bake material`.
#[derive(Debug, Args)]
pub struct MaterialOptions {
    /// A family, a material file, or the name of one in scenes/materials.
    pub name: String,
    /// Polar angles of the camera for the slices, degrees, 0 to below 90.
    #[arg(long, value_delimiter = ',', default_value = "10,45,75,85", value_parser = polar_angle)]
    pub theta: Vec<f64>,
    /// Azimuth of the camera, degrees from x towards y.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    pub phi: f64,
    /// Width and height of a slice in pixels.
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u64).range(16..=4096))]
    pub size: u64,
    /// Where the pictures go [default: out/materials/NAME].
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// A parameter and its value, e.g. roughness=0.3, alpha=[0.3,0.1] or ior=gold; may be given several times.
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = assignment)]
    pub set: Vec<(String, Field)>,
    /// Random walks behind each slice; albedos take 32 times as many. All pixels share them, so noise shows as faint
    /// streaks in the tails, which move with `--seed`. Slices of principled and imported materials need none.
    #[arg(long, default_value_t = 2048, value_parser = clap::value_parser!(u64).range(1..=1 << 24))]
    pub samples: u64,
    /// Seed of the random numbers.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print everything as one JSON object on standard output.
    #[arg(long)]
    pub json: bool,
}

/// Options of `bake maps`.
#[derive(Debug, Args)]
pub struct MapsOptions {
    /// A material file, or the name of one in scenes/materials; for --compare also a picture.
    pub subject: String,
    /// Number of slices.
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u64).range(1..=1 << 20))]
    pub count: u64,
    /// How maps are made: marginal, hierarchical, sinkhorn_sliced, exact or frame [default: frame; all for --compare].
    #[arg(long, value_delimiter = ',', value_parser = solver)]
    pub solver: Vec<Solver>,
    /// Cells per side of a map, 32, 64, 128 or 256 [default: 64; 64 and 128 for --compare].
    #[arg(long, value_delimiter = ',', value_parser = cells)]
    pub cells: Vec<usize>,
    /// Go on with what an interrupted run left, or add slices to a finished one.
    #[arg(long, conflicts_with_all = ["view", "compare"])]
    pub resume: bool,
    /// Go on although more than 2 % of the maps had to fall back to marginal inversion.
    #[arg(long)]
    pub allow_fallbacks: bool,
    /// Draw these entries of the database instead of computing it.
    #[arg(long, value_name = "INDEX", value_delimiter = ',', conflicts_with = "compare")]
    pub view: Vec<usize>,
    /// Compare solvers on SUBJECT instead of computing a database.
    #[arg(long)]
    pub compare: bool,
    /// Polar angles of the camera at which a material is compared, degrees.
    #[arg(long, value_delimiter = ',', default_value = "10,45,75,85,89", value_parser = polar_angle)]
    pub theta: Vec<f64>,
    /// A parameter and its value in place of the material's, e.g. alpha=[0.3,0.1]; may be given several times.
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = assignment)]
    pub set: Vec<(String, Field)>,
    /// Where shards and pictures go [default: out/maps/NAME].
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Seed of the places and of the solvers that draw numbers.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print the result as one JSON value on standard output: for --compare a list of rows, else an object.
    #[arg(long)]
    pub json: bool,
}

/// Options of `bake bench`.
#[derive(Debug, Args)]
pub struct BenchOptions {
    /// Folders of networks [default: the shipped materials, and synthetic networks of 3×32 to 6×128].
    #[arg(conflicts_with = "family")]
    pub models: Vec<PathBuf>,
    /// Measure the reference models of a family instead: conductor, layered or principled.
    #[arg(long, value_parser = measured_family)]
    pub family: Option<Family>,
    /// Three rounds instead of eleven, batches of 1 and 4096 alone.
    #[arg(long, conflicts_with = "family")]
    pub quick: bool,
    /// Where the pictures go [default: out/bench].
    #[arg(long, conflicts_with = "family")]
    pub out: Option<PathBuf>,
    /// Print the rows as one JSON list on standard output, and draw nothing.
    #[arg(long)]
    pub json: bool,
}
