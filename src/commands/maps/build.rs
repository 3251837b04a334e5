//! The database of a material's maps.

use super::{folder, material, refuse_large_exact};
use crate::arguments::MapsOptions;
use crate::commands::prepare_folder;
use crate::progress::Stages;
use crate::{machine, output};
use anyhow::{Result, bail};
use bake_train::maps::{CELLS, Charts, Counts, Job, Summary, compute};
use bake_train::transport::Solver;
use bake_train::{database, places};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Share of maps that may fall back to marginal inversion before the run ends with an error.
const FALLBACKS_MAX: f64 = 0.02;

/// Strata of θ_o, in the order of [`Summary::strata`].
const STRATA: [&str; 3] = ["theta_0_75", "theta_75_85", "theta_85_90"];

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    material: String,
    solver: &'static str,
    cells: usize,
    slices: usize,
    /// Slices that this run computed; the rest were there.
    computed: usize,
    free: Vec<String>,
    strata: Vec<Stratum>,
    fallback_percent: f64,
    /// Mean and largest error that removing the noise of stochastic slices costs a density, percent of its albedo.
    smoothing_error_percent: [f64; 2],
    seconds: f64,
    seconds_per_map: Option<f64>,
    threads: usize,
    peak_rss_mib: Option<f64>,
    folder: PathBuf,
}

#[derive(Serialize)]
struct Stratum {
    name: &'static str,
    maps: usize,
    fallbacks: usize,
    softened: usize,
}

/// Computes it.
pub fn run(options: &MapsOptions) -> Result<()> {
    let material = material(options)?;
    let solver = match options.solver[..] {
        [] => Solver::Frame,
        [one] => one,
        _ => bail!("--solver: a database is made by one solver; several are for --compare"),
    };
    let cells = match options.cells[..] {
        [] => CELLS,
        [one] => one,
        _ => bail!("--cells: the maps of a database have one size; several are for --compare"),
    };
    refuse_large_exact(&[solver], &[cells])?;
    let folder = folder(options, &material.name);
    prepare_folder(&folder)?;
    let places = places::draw(&material, options.count as usize, options.seed);
    let job = Job {
        material: &material,
        places: &places,
        drawn: "scrambled Sobol, roughness in its square root, θ_o = 90°·√ξ",
        charts: Charts::Fitted,
        solver,
        cells,
        seed: options.seed,
    };
    match (database::fingerprint(&folder)?, options.resume) {
        (Some(_), false) => bail!(
            "{}: there are maps already; give --resume to go on with them, or another --out",
            folder.display()
        ),
        (Some(found), true) if found != job.fingerprint() => bail!(
            "{}: these maps are of another material, solver, size or seed; give another --out",
            folder.display()
        ),
        _ => {}
    }
    let stages = Stages::new();
    let clock = Instant::now();
    let summary = compute(&job, &folder, &|done, total| {
        stages.report("importance maps", done, total)
    })?;
    stages.finish();
    let seconds = clock.elapsed().as_secs_f64();
    let report = Report {
        material: material.name.clone(),
        solver: solver.name(),
        cells,
        slices: summary.slices,
        computed: summary.computed,
        free: material.free().into_iter().map(|(name, ..)| name).collect(),
        strata: strata(&summary),
        fallback_percent: 100.0 * summary.fallback_share(),
        smoothing_error_percent: summary.smoothing_error.map(|e| 100.0 * e),
        seconds,
        seconds_per_map: (summary.computed > 0).then(|| seconds / summary.computed as f64),
        threads: rayon::current_num_threads(),
        peak_rss_mib: machine::peak_rss_mib(),
        folder,
    };
    if options.json {
        output::json(&report)?;
    } else {
        print(&report);
    }
    if summary.fallback_share() > FALLBACKS_MAX && !options.allow_fallbacks {
        bail!(
            "{:.1} % of the maps fell back to marginal inversion, more than {:.0} %; they are stored and marked \
             `fallback`; give --resume --allow-fallbacks to go on with them",
            100.0 * summary.fallback_share(),
            100.0 * FALLBACKS_MAX
        );
    }
    Ok(())
}

fn strata(summary: &Summary) -> Vec<Stratum> {
    let stratum = |(name, counts): (&'static str, &Counts)| Stratum {
        name,
        maps: counts.maps,
        fallbacks: counts.fallbacks,
        softened: counts.softened,
    };
    STRATA.into_iter().zip(&summary.strata).map(stratum).collect()
}

fn print(report: &Report) {
    let free = match report.free.is_empty() {
        true => "the camera direction".to_string(),
        false => format!("the camera direction, {}", report.free.join(", ")),
    };
    output::line(&format!(
        "{}: {} slices over {free}; {} computed in {:.1} s by `{}` on {} threads",
        report.material, report.slices, report.computed, report.seconds, report.solver, report.threads
    ));
    output::line(&format!(
        "{:<14}{:>8}{:>18}{:>12}",
        "θ_o", "maps", "fallbacks", "softened"
    ));
    for (stratum, label) in report.strata.iter().zip(["to 75°", "75 to 85°", "above 85°"]) {
        let percent = 100.0 * stratum.fallbacks as f64 / stratum.maps.max(1) as f64;
        output::line(&format!(
            "{label:<14}{:>8}{:>9} ({percent:>5.2} %){:>12}",
            stratum.maps, stratum.fallbacks, stratum.softened
        ));
    }
    if let Some(seconds) = report.seconds_per_map {
        output::line(&format!("{:.1} ms per slice", 1e3 * seconds));
    }
    if let Some(rss) = report.peak_rss_mib {
        output::line(&format!("{rss:.0} MiB of memory at most"));
    }
    let [mean, worst] = report.smoothing_error_percent;
    if worst > 0.0 {
        output::line(&format!(
            "removing the noise of walks changes densities by {mean:.2} % on average, {worst:.2} % at most; weights of \
             samples do not see it"
        ));
    }
    output::line(&format!(
        "{}: shards maps-*.safetensors; `--view INDEX` draws an entry. fallback: marginal inversion stands in; softened: \
         the map is of a density with gentler falls",
        report.folder.display()
    ));
}
