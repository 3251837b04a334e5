//! Pictures of entries of a database.

use super::{folder, material};
use crate::arguments::MapsOptions;
use crate::output;
use crate::progress::Stages;
use anyhow::{Context, Result, bail};
use bake_runtime::Material;
use bake_scenes::entry_picture::{ChartView, Entry, SLICE_SIDE, write_entry};
use bake_scenes::map_picture::{MapPanel, Square};
use bake_scenes::slice_picture::DiskSlice;
use bake_train::card::bins::SIDE;
use bake_train::database;
use bake_train::lobes::WALKS;
use bake_train::maps::{MappedSlice, WALK_SEED};
use bake_train::transport::Solver;
use bake_train::transport::frame_map::ChartMap;
use bake_train::view::{self, WEIGHT_SIDE, charts};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// What the metadata of a database says of it, as far as it matters here.
#[derive(Deserialize)]
struct Origin {
    material: Material,
    parameters: Vec<String>,
    solver: String,
}

/// What `--json` prints of an entry.
#[derive(Serialize)]
struct Viewed {
    index: usize,
    picture: PathBuf,
    parameters: Vec<(String, f64)>,
    theta: f64,
    phi: f64,
    charts: usize,
    fallback: bool,
}

/// Draws them.
pub fn run(options: &MapsOptions) -> Result<()> {
    let folder = folder(options, &material(options)?.name);
    let Some(fingerprint) = database::fingerprint(&folder)? else {
        bail!(
            "{}: there are no maps; compute them first, without --view",
            folder.display()
        )
    };
    let origin: Origin = serde_json::from_str(&fingerprint)
        .with_context(|| format!("{}: not maps that this version wrote", folder.display()))?;
    let Some(solver) = Solver::find(&origin.solver) else {
        bail!(
            "{}: made by the unknown solver `{}`",
            folder.display(),
            origin.solver
        )
    };
    let stages = Stages::new();
    let mut viewed = Vec::new();
    for (i, index) in options.view.iter().enumerate() {
        let Some(entry) = database::load_slice(&folder, *index)? else {
            bail!("{}: there is no entry {index}", folder.display())
        };
        let flow = stages.report("pictures", i as u64, options.view.len() as u64);
        if flow.is_break() {
            bail!("interrupted");
        }
        viewed.push(draw(&folder, &origin, solver, *index, &entry, &stages)?);
    }
    stages.finish();
    if options.json {
        return output::json(&viewed);
    }
    for entry in &viewed {
        output::line(&format!("{}", entry.picture.display()));
    }
    Ok(())
}

fn draw(
    folder: &Path,
    origin: &Origin,
    solver: Solver,
    index: usize,
    entry: &MappedSlice,
    stages: &Stages,
) -> Result<Viewed> {
    let bsdf = origin.material.bind(&entry.parameters)?;
    let theta = entry.wo[2].acos().to_degrees();
    let phi = entry.wo[1].atan2(entry.wo[0]).to_degrees();
    let slice = DiskSlice::draw(
        &bsdf,
        [theta, phi],
        SLICE_SIDE,
        WALKS / 2,
        WALK_SEED,
        &|done, total| stages.report("slice", done, total),
    )?;
    let views = charts(&bsdf, entry, solver)?;
    let parameters: Vec<(String, f64)> = origin
        .parameters
        .iter()
        .cloned()
        .zip(entry.parameters.clone())
        .collect();
    let values: Vec<String> = parameters.iter().map(|(n, v)| format!("{n} {v:.4}")).collect();
    let mut lines = vec![format!("θ {theta:.2}°, φ {phi:.2}°, solver {solver}")];
    lines.extend(values);
    let fallback = entry.charts.iter().any(|c| c.fallback);
    if fallback {
        lines.push("fallback: marginal inversion stands in".into());
    }
    let picture = folder.join(format!("entry-{index:05}.png"));
    write_entry(
        &picture,
        &Entry {
            title: format!("{} {index}", origin.material.name),
            lines,
            slice,
            charts: views
                .into_iter()
                .zip(&entry.charts)
                .enumerate()
                .map(chart_view)
                .collect(),
        },
    )?;
    Ok(Viewed {
        index,
        picture,
        parameters,
        theta,
        phi,
        charts: entry.charts.len(),
        fallback,
    })
}

fn chart_view((number, (view, chart)): (usize, (view::ChartView, &ChartMap))) -> ChartView {
    let [a, b, c] = [chart.chart.frame.x, chart.chart.frame.y, chart.chart.frame.shear];
    let beta = chart.chart.boost.velocity();
    let r = chart.residuals;
    ChartView {
        disk: view.disk,
        weight: Square {
            side: WEIGHT_SIDE,
            values: view.weight.iter().map(|w| w.map(|v| v as f32)).collect(),
        },
        panel: MapPanel {
            title: format!("chart {} of probability {:.3}", number + 1, chart.share),
            lines: vec![
                format!("A {a:.3}, {b:.3}, shear {c:.2}"),
                format!("boost {:.3}, {:.3}", beta[0], beta[1]),
                format!("c {:.1e}, residual {:.0e}", r.constant, r.residual),
                format!("softened {:.2} %, folds {:.0e}", 100.0 * r.softened, r.folds),
            ],
            map: Square {
                side: SIDE,
                values: view.map.iter().map(|p| p.map(|v| v as f32)).collect(),
            },
            bins: Square {
                side: SIDE,
                values: view.bins,
            },
            reference: Square {
                side: SIDE,
                values: view.reference,
            },
        },
    }
}
