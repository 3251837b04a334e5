//! What the command line takes.

use bake_runtime::Family;
use bake_runtime::field::Field;
use bake_train::presets::Preset;
use bake_train::transport::Solver;
use clap::{Args, Parser, Subcommand, ValueEnum};
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Bakes parametric BSDFs into small networks that sample, evaluate and give the pdf of them.
///
/// Start with `bake scene scenes/vase --quick`, and look at out/vase/comparison.png.
#[derive(Debug, Parser)]
#[command(version, propagate_version = true)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Threads to use [default: one per core]. Results do not depend on it.
    #[arg(long, global = true)]
    pub threads: Option<NonZeroUsize>,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Bake every material of a scene, export, render and compare: the whole job.
    Scene(SceneOptions),
    /// Bake one material: charts, maps, the three networks, ONNX and model card.
    ///
    /// Parameters that the material fixes leave the networks, which are then smaller, quicker to train and quicker to run;
    /// what that saved is printed first. Two presets: `warp`, ours, and `paper`, the networks and losses of the paper.
    /// Learning curves are written beside the checkpoints, train-sample.csv and so on; curves.png beside the model card
    /// shows them.
    ///
    /// bake train vase
    ///
    /// bake train conductor --preset paper --out out/conductor-paper
    Train(TrainOptions),
    /// Measure the errors of a baked material afresh, beside its model card.
    Check(CheckOptions),
    /// Hold a baked material against other samplers: a normalising flow and an analytic lobe.
    ///
    /// RealNVP (Dinh et al. 2016, as Xie et al. 2019 use it) is trained here, with about as many parameters as the sampling
    /// network of MODEL and for about as long as that was; a cosine and a Blinn–Phong lobe (Sztrajman et al. 2021) are fitted
    /// to every slice. All are measured at the held-out places of the model card; rivals.png shows one slice as each draws
    /// it.
    ///
    /// The number of steps of the flow follows from the time that a step takes here and now; `--steps` repeats a run
    /// exactly. Ctrl-C leaves checkpoints that `--resume` takes up.
    ///
    /// bake rivals out/materials/vase --paper out/materials/vase-paper
    Rivals(RivalsOptions),
    /// Write the ONNX files beside the safetensors files of a baked material.
    Export(ExportOptions),
    /// Render a scene with one method.
    Render(RenderOptions),
    /// Answer questions from standard input: values, densities, samples and albedos at given directions.
    ///
    /// Every line is a JSON object and is printed again with its answer, in order, as soon as it is there:
    ///
    /// {"params": {"alpha": [0.3, 0.1], "reflectance": [1, 0.782, 0.344]}, "wo": [45, 0], "wi": [30, 180]}
    ///
    /// `wo` points to the camera and `wi` to the light, both as [θ, φ] in degrees, θ from the normal, φ from x
    /// towards y. What a line asks, and the keys that answer it:
    ///
    /// "wi": [θ, φ] gives `f_cos` (BSDF times cos θ_i, RGB, per steradian), `se` (its standard error, zeros where
    /// nothing is random) and `pdf` (per steradian). Below the horizon, θ ≥ 90, all are zero.
    ///
    /// "u": [a, b] (two numbers in [0, 1)) gives `wi` (a unit vector), `weight` (f_cos / pdf, RGB) and `pdf` of one
    /// sampled direction. Where nothing was drawn `wi` is null, `weight` and `pdf` are zero. Networks add `jacobian`,
    /// the signed area that u maps to, in steradians.
    ///
    /// "albedo": true gives `albedo` (the integral of f_cos over all wi, RGB) and `se`.
    ///
    /// "samples": N says how many evaluations or walks are averaged (16384 where it is missing; deterministic models
    /// need one evaluation, and albedos take at least 32). "id" may hold anything and comes back. A line that cannot
    /// be answered ends the program with status 2 and says which and why.
    ///
    /// SUBJECT decides who answers, and what `params` must hold: a family takes every parameter without a default (files
    /// relative to the current folder), a material what it leaves free, a folder of networks none. The name of a family
    /// always means the family; a material called like one is asked by its file, e.g. scenes/materials/conductor.toml.
    #[command(after_long_help = crate::help::families())]
    Query(QueryOptions),
    /// Show a material: its parameters, its albedo over θ, and pictures of its slices.
    ///
    /// A slice is f_cos (BSDF times cos θ_i) over all directions to the light, seen from above as a disk, for one
    /// direction to the camera. Every slice is written as EXR (linear, per steradian); slices.png shows them side by
    /// side, exposed for the lobe above and by the logarithm below, with a ring at the camera.
    ///
    /// NAME is a family, a material file, or the name of one in scenes/materials; the name of a family always means the
    /// family. Of a family `--set` gives what has no default, and of a material anything; what a material leaves free
    /// takes the middle of its range otherwise:
    ///
    /// bake material conductor --set alpha=[0.3,0.1] --set ior=gold
    ///
    /// bake material scenes/materials/layered.toml --set sigma_t=0.5
    ///
    /// bake material imported --set file=felt.safetensors
    ///
    /// Files of slices are written by `bake_bsdf.write_slices` in export/python.
    #[command(after_long_help = crate::help::families())]
    Material(MaterialOptions),
    /// Compute importance maps of a material, look at them, or compare the ways to make them.
    ///
    /// A map carries uniform numbers onto one slice of the BSDF; networks learn thousands of them. Slices are drawn from
    /// the material's free ranges and from all camera directions, and stored with their maps in shards of 128,
    /// maps-0000.safetensors and so on, each written whole or not at all. Ctrl-C keeps finished shards; `--resume` goes on
    /// to the same bytes, and to more slices when `--count` grows:
    ///
    /// bake maps conductor --count 4096 --resume
    ///
    /// bake maps conductor --view 0,17
    ///
    /// `--view` draws entries: the slice, and for every chart the map (red and green are its two coordinates), what it
    /// draws, how far that is from the truth, and the weights of its samples. In Python, `bake_bsdf.read_maps` of
    /// export/python reads the shards.
    ///
    /// `--compare` makes all solvers' maps of a grey-scale picture (PNG, JPEG or EXR), or of a material's slices at θ_o 10,
    /// 45, 75, 85 and 89° and its smallest, middle and largest roughness, and prints what each is judged by:
    ///
    /// bake maps --compare lotus.png
    ///
    /// bake maps --compare vase --solver marginal,frame
    Maps(MapsOptions),
    /// Measure what a reference model costs: ns per sample and eval, seconds per slice, beside their noise.
    ///
    /// One thread; a table over roughness and θ_o, of the family and of the baselines beside it: for the conductor,
    /// single scattering with compensated energy. Lines below the table say what its columns mean.
    Bench(BenchOptions),
}

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

fn finite(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err("give a number".into()),
    }
}

fn polar_angle(text: &str) -> Result<f64, String> {
    match finite(text) {
        Ok(theta) if (0.0..90.0).contains(&theta) => Ok(theta),
        _ => Err("give an angle in degrees, 0 to below 90".into()),
    }
}

fn solver(name: &str) -> Result<Solver, String> {
    let names = || Solver::ALL.map(Solver::name).join(", ");
    Solver::find(name).ok_or_else(|| format!("give one of {}", names()))
}

fn preset(name: &str) -> Result<Preset, String> {
    let names = || Preset::ALL.map(Preset::name).join(" or ");
    let found = Preset::ALL.into_iter().find(|preset| preset.name() == name);
    found.ok_or_else(|| format!("give {}", names()))
}

fn cells(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(cells @ (32 | 64 | 128 | 256)) => Ok(cells),
        _ => Err("give 32, 64, 128 or 256".into()),
    }
}

/// `KEY=VALUE`, the value as JSON or as a bare word.
fn assignment(text: &str) -> Result<(String, Field), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() && !value.trim().is_empty() => {
            let value = value.trim();
            let field = serde_json::from_str(value).unwrap_or_else(|_| Field::Text(value.into()));
            Ok((key.trim().into(), field))
        }
        _ => Err("give KEY=VALUE, e.g. roughness=0.3".into()),
    }
}

fn positive_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds.is_finite() => Ok(seconds),
        _ => Err("give a positive number of seconds".into()),
    }
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

/// Options of `bake bench`.
#[derive(Debug, Args)]
pub struct BenchOptions {
    /// The family: conductor, layered or principled.
    #[arg(long, value_parser = measured_family)]
    pub family: Family,
    /// Print the rows as one JSON list on standard output.
    #[arg(long)]
    pub json: bool,
}

fn measured_family(name: &str) -> Result<Family, String> {
    Family::find(name)
        .filter(|family| *family != Family::Imported)
        .ok_or_else(|| "give `conductor`, `layered` or `principled`".into())
}
