//! `bake scene`: the whole job for one scene.

use super::baking::Order;
use super::check;
use super::converged::converged;
use super::render::{CONVERGED_SPP, entry, label, pass, write_pictures};
use super::{RenderEntry, load, prepare_folder, write_json};
use crate::arguments::{BackendName, SceneOptions};
use crate::backends::Backends;
use crate::progress::Stages;
use crate::{machine, output};
use anyhow::Result;
use bake_runtime::Material;
use bake_scenes::{Estimator, Image, Method, Scene, picture};
use bake_train::card::Card;
use bake_train::presets::Preset;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Samples per pixel of the compared renders, and how many seeds tell bias from variance.
const SPP: u64 = 64;
const SEEDS: u64 = 4;
/// The same with `--quick`.
const QUICK_SPP: u64 = 16;
const QUICK_SEEDS: u64 = 2;
/// Samples per pixel of the converged reference with `--quick`.
const QUICK_CONVERGED_SPP: u64 = 128;
/// The methods compared, all on Sobol points.
const METHODS: [Method; 4] = [
    Method::Reference,
    Method::Baked(Estimator::Exact),
    Method::Baked(Estimator::ExactBaked),
    Method::Baked(Estimator::Learned),
];
/// The report beside the pictures.
const REPORT_FILE: &str = "report.json";
/// Side by side: reference | baked, equal samples per pixel.
const COMPARISON_FILE: &str = "comparison.png";

/// Seconds of wall time per stage.
#[derive(Debug, Default, Serialize)]
struct Seconds {
    maps: f64,
    train: f64,
    export: f64,
    check: f64,
    render: f64,
    total: f64,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Report {
    scene: String,
    seconds: Seconds,
    peak_rss_mib: Option<f64>,
    materials: Vec<Card>,
    renders: Vec<RenderEntry>,
}

/// Runs the command.
pub fn run(options: &SceneOptions) -> Result<()> {
    let started = Instant::now();
    let scene = load(&options.scene, Material::reference)?;
    let out = options
        .out
        .clone()
        .unwrap_or_else(|| PathBuf::from("out").join(&scene.name));
    prepare_folder(&out)?;
    let stages = Stages::new();
    let mut seconds = Seconds::default();
    let mut cards = Vec::new();
    let mut folders = BTreeMap::new();
    for material in scene.materials() {
        let folder = out.join(&material.name);
        let order = Order {
            material,
            preset: Preset::Warp,
            quick: options.quick,
            seed: options.seed,
            resume: options.resume,
            folder: &folder,
            command: command_line(options),
        };
        let (card, took) = order.fill(&stages)?;
        seconds.maps += took.maps;
        seconds.train += took.train;
        seconds.export += took.export;
        seconds.check += took.check;
        cards.push(card);
        folders.insert(material.name.clone(), folder);
    }
    let clock = Instant::now();
    let backends = Backends::load(BackendName::Native, &folders, &scene)?;
    let renders = compare(&scene, options, &backends, &out, &stages)?;
    seconds.render = clock.elapsed().as_secs_f64();
    seconds.total = started.elapsed().as_secs_f64();
    let report = Report {
        scene: scene.name.clone(),
        seconds,
        peak_rss_mib: machine::peak_rss_mib(),
        materials: cards,
        renders,
    };
    write_json(&out.join(REPORT_FILE), &report)?;
    if options.json {
        return output::json(&report);
    }
    print(&report, &out);
    Ok(())
}

/// The command that repeats this bake.
fn command_line(options: &SceneOptions) -> String {
    let quick = if options.quick { " --quick" } else { "" };
    format!(
        "bake scene {}{quick} --seed {}",
        options.scene.display(),
        options.seed
    )
}

/// Renders every method at equal samples per pixel and measures them against the converged reference.
fn compare(
    scene: &Scene,
    options: &SceneOptions,
    backends: &Backends,
    out: &Path,
    stages: &Stages,
) -> Result<Vec<RenderEntry>> {
    let (spp, seeds, converged_spp) = match options.quick {
        true => (QUICK_SPP, QUICK_SEEDS, QUICK_CONVERGED_SPP),
        false => (SPP, SEEDS, CONVERGED_SPP),
    };
    let reference = converged(&options.scene, scene, converged_spp, out, stages)?;
    picture::write_png(&out.join("converged.png"), &[&reference], scene.exposure)?;
    let mut entries = Vec::new();
    let mut compared: Vec<Image> = Vec::new();
    for method in METHODS {
        let mut images = Vec::new();
        let mut times = Vec::new();
        for k in 0..seeds {
            let clock = Instant::now();
            images.push(pass(scene, method, spp, 0, options.seed + k, backends, stages)?);
            times.push(clock.elapsed().as_secs_f64());
        }
        times.sort_by(f64::total_cmp);
        let path = out.join(format!("{}.exr", label(method)));
        write_pictures(&path, &images[0], scene.exposure)?;
        entries.push(entry(
            method,
            &images,
            times[times.len() / 2],
            Some(&reference),
            &path,
        )?);
        compared.push(images.swap_remove(0));
    }
    stages.finish();
    picture::write_png(
        &out.join(COMPARISON_FILE),
        &[&compared[0], &compared[1]],
        scene.exposure,
    )?;
    Ok(entries)
}

fn print(report: &Report, out: &Path) {
    for card in &report.materials {
        check::print(card, None);
    }
    output::line("");
    output::line(&format!(
        "{:<22}{:>6}{:>10}{:>12}{:>12}{:>12}",
        "render", "spp", "seconds", "relmse", "bias²", "variance"
    ));
    for r in &report.renders {
        let name = r
            .estimator
            .as_ref()
            .map_or(r.method.clone(), |e| format!("{}, {e}", r.method));
        let number = |v: Option<f64>| v.map_or("-".to_string(), |v| format!("{v:.2e}"));
        output::line(&format!(
            "{name:<22}{:>6}{:>10.2}{:>12}{:>12}{:>12}",
            r.spp,
            r.seconds,
            number(r.relmse),
            number(r.bias2),
            number(r.variance)
        ));
    }
    let s = &report.seconds;
    output::line(&format!(
        "\n{:.0} s in all: maps {:.0}, training {:.0}, check {:.0}, rendering {:.0}{}",
        s.total,
        s.maps,
        s.train,
        s.check,
        s.render,
        report
            .peak_rss_mib
            .map_or(String::new(), |m| format!("; peak memory {m:.0} MiB"))
    ));
    output::line(&format!(
        "models, pictures and {REPORT_FILE} are in {}",
        out.display()
    ));
}
