//! Options of the commands that take a scene.

use super::values::positive_seconds;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Options of `bake scene`.
#[derive(Debug, Args)]
pub struct SceneOptions {
    /// Folder with scene.toml, e.g. scenes/vase.
    pub scene: PathBuf,
    /// Where models, pictures and the report go [default: out/SCENE].
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Fewer slices, steps and samples: a first look in about a minute.
    #[arg(long)]
    pub quick: bool,
    /// Seed of training and rendering; the same seed gives the same networks, byte for byte.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Go on from the checkpoints of an interrupted run.
    #[arg(long)]
    pub resume: bool,
    /// Print the report as one JSON object on standard output.
    #[arg(long)]
    pub json: bool,
}

/// Options of `bake render`.
#[derive(Debug, Args)]
pub struct RenderOptions {
    /// Folder with scene.toml.
    pub scene: PathBuf,
    /// How materials are sampled.
    #[arg(long, value_enum, default_value_t = MethodName::Baked)]
    pub method: MethodName,
    /// Where the weight of a baked sample comes from.
    #[arg(long, value_enum, default_value_t = EstimatorName::Exact)]
    pub estimator: EstimatorName,
    /// Samples per pixel [default: 64].
    #[arg(long, conflicts_with = "seconds", value_parser = clap::value_parser!(u64).range(1..))]
    pub spp: Option<u64>,
    /// Render for this many seconds instead, in passes that double the samples.
    #[arg(long, value_parser = positive_seconds)]
    pub seconds: Option<f64>,
    /// What runs the networks.
    #[arg(long, value_enum, default_value_t = BackendName::Native)]
    pub backend: BackendName,
    /// Folder of baked materials [default: out/SCENE where the material was baked, else scenes/materials].
    #[arg(long)]
    pub models: Option<PathBuf>,
    /// Where the picture goes: FILE.exr, with FILE.png beside it [default: out/SCENE/METHOD.exr].
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Seed of the samples.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print the result as one JSON object, with the error against the converged reference, on standard output.
    #[arg(long)]
    pub json: bool,
}

/// Methods on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
pub enum MethodName {
    /// The reference model's random walk, Sobol points on its first bounce.
    Reference,
    /// The same with random numbers.
    ReferenceRandom,
    /// Visible normals, evaluated with the reference model.
    Vndf,
    /// Cosine, evaluated with the reference model.
    Cosine,
    /// The baked networks.
    Baked,
}

/// Estimators on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
pub enum EstimatorName {
    /// Weight regressed by the network: fastest, biased as the card says.
    Learned,
    /// Reference f_cos times the map's signed Jacobian: unbiased.
    Exact,
    /// Evaluation network times the map's signed Jacobian.
    ExactBaked,
}

/// Backends on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum BackendName {
    /// Our own SIMD kernels.
    Native,
    /// onnxruntime on the exported ONNX files.
    Ort,
}
