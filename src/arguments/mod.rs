//! What the command line takes; the options of its commands by what they are about.

mod baked;
mod references;
mod scenes;
mod values;

pub use baked::{CheckOptions, ExportOptions, RivalsOptions, TrainOptions};
pub use references::{BenchOptions, MapsOptions, MaterialOptions, QueryOptions};
pub use scenes::{BackendName, EstimatorName, MethodName, RenderOptions, SceneOptions};

use clap::{Parser, Subcommand};
use std::num::NonZeroUsize;

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
    /// Measure what queries cost beside their error: every SIMD tier, onnxruntime, batches of 1 to 65536.
    ///
    /// One thread, medians of interleaved rounds; beside them the operations per second, their share of the multiply-add
    /// peak that a loop reaches in the same rounds, the largest difference from f64, and the binning error of the model card:
    ///
    /// bake bench
    ///
    /// bake bench out/vase/vase --quick
    ///
    /// `--family` measures a reference model instead, ns per sample and eval and seconds per slice, over roughness and θ_o,
    /// and the baselines beside it: for the conductor, single scattering with compensated energy.
    ///
    /// Lines below the tables say what their columns mean.
    Bench(BenchOptions),
}
