//! Solvers side by side on a picture, or on the slices of a material.

use super::{folder, material, refuse_large_exact};
use crate::arguments::MapsOptions;
use crate::commands::prepare_folder;
use crate::output;
use crate::progress::Stages;
use anyhow::{Context, Result, anyhow};
use bake_scenes::grey_picture::read_grey;
use bake_scenes::map_picture::{self, MapPanel, Square, write_sheet};
use bake_train::Error;
use bake_train::card::bins::SIDE;
use bake_train::compare::{Compared, Comparison, Row, Target, compare, slices_of};
use bake_train::transport::Solver;
use bake_train::transport::raster::Raster;
use std::path::Path;

/// Endings of the files that count as pictures.
const PICTURES: [&str; 4] = ["png", "jpg", "jpeg", "exr"];

/// Pixels per side that a picture is brought to.
const PICTURE_SIDE: usize = 256;

/// The first sizes of maps.
const SIDES: [usize; 2] = [64, 128];

/// Comparisons on one sheet.
const SHEET: usize = 5;

/// Runs the comparison.
pub fn run(options: &MapsOptions) -> Result<()> {
    let sides = match &options.cells[..] {
        [] => &SIDES[..],
        some => some,
    };
    refuse_large_exact(&options.solver, sides)?;
    let solvers = match &options.solver[..] {
        [] => &Solver::ALL[..],
        some => some,
    };
    let path = Path::new(&options.subject);
    let ending = path.extension().and_then(|e| e.to_str()).map(str::to_lowercase);
    let (name, targets) = if ending.is_some_and(|e| PICTURES.contains(&e.as_str())) {
        let name = path
            .file_stem()
            .map_or("picture".into(), |s| s.to_string_lossy().into_owned());
        let picture = read_grey(path)?;
        let raster = Raster::new(PICTURE_SIDE, &picture.to_square(PICTURE_SIDE))
            .with_context(|| path.display().to_string())?;
        let target = Target::Picture {
            name: name.clone(),
            raster,
        };
        (name, vec![target])
    } else {
        let material = material(options)?;
        (material.name.clone(), slices_of(&material, &options.theta)?)
    };
    let folder = folder(options, &name);
    prepare_folder(&folder)?;
    let stages = Stages::new();
    let total = targets.len() as u64;
    let mut comparisons = Vec::new();
    for (i, target) in targets.iter().enumerate() {
        let tick = |done: u64, of: u64| stages.report("comparing", i as u64 * of + done, total * of);
        let compared = compare(target, solvers, sides, options.seed, &tick);
        comparisons.push(compared.map_err(|error| match error {
            // There is nothing to resume from.
            Error::Interrupted => anyhow!("interrupted"),
            error => error.into(),
        })?);
    }
    stages.finish();
    let mut sheets = Vec::new();
    for (i, part) in comparisons.chunks(SHEET).enumerate() {
        let file = match comparisons.len() > SHEET {
            true => format!("comparison-{}.png", i + 1),
            false => "comparison.png".into(),
        };
        let drawn: Vec<map_picture::Comparison> = part.iter().map(|c| drawn(c, sides[0])).collect();
        write_sheet(&folder.join(&file), &drawn)?;
        sheets.push(folder.join(file));
    }
    let rows: Vec<&Row> = comparisons.iter().flat_map(|c| &c.rows).map(|r| &r.row).collect();
    if options.json {
        return output::json(&rows);
    }
    print(&rows);
    for sheet in &sheets {
        output::line(&sheet.display().to_string());
    }
    Ok(())
}

/// What a sheet shows of a comparison: its maps of `side`² cells.
fn drawn(comparison: &Comparison, side: usize) -> map_picture::Comparison {
    let square = |values: &[f64]| Square {
        side: SIDE,
        values: values.to_vec(),
    };
    let bins = match (comparison.disk, comparison.narrow) {
        (true, true) => "bins in the square of the lobe's chart: it is too narrow for the disk",
        (true, false) => "bins on the disk",
        (false, _) => "bins of the picture",
    };
    let panel = |compared: &Compared| {
        let row = &compared.row;
        MapPanel {
            title: row.solver.to_string(),
            lines: lines(row),
            map: Square {
                side: SIDE,
                values: compared.map.iter().map(|p| p.map(|v| v as f32)).collect(),
            },
            bins: square(&compared.bins),
            reference: square(&comparison.reference),
        }
    };
    map_picture::Comparison {
        title: comparison.slice.clone(),
        lines: vec![format!("{side} × {side} cells"), bins.to_string()],
        target: square(&comparison.target),
        disk: comparison.disk,
        panels: comparison
            .rows
            .iter()
            .filter(|c| c.row.n == side * side)
            .map(panel)
            .collect(),
    }
}

fn lines(row: &Row) -> Vec<String> {
    let mut lines = vec![
        format!("binning {:.4} (floor {:.4})", row.binning_l1, row.binning_floor),
        format!("folds {:.4}, stretch {:.0}", row.fold_fraction, row.max_stretch),
        format!("cost × {:.3}, {:.3} s", row.cost_ratio, row.seconds),
    ];
    if row.outside > 0.0 {
        lines.push(format!("{:.2} % outside", 100.0 * row.outside));
    }
    if let Some(solver) = row.fallback {
        lines.push(format!("fallback: {solver}"));
    }
    lines
}

fn print(rows: &[&Row]) {
    let widest = rows.iter().map(|r| r.slice.chars().count()).max().unwrap_or(0);
    output::line(&format!(
        "{:<widest$}  {:<16}{:>7}{:>9}{:>10}{:>10}{:>10}{:>9}{:>9}{:>9}",
        "slice", "solver", "n", "cost ×", "folds", "stretch", "binning", "floor", "outside", "seconds"
    ));
    for row in rows {
        output::line(&format!(
            "{:<widest$}  {:<16}{:>7}{:>9.4}{:>10.5}{:>10.1}{:>10.4}{:>9.4}{:>9.5}{:>9.3}{}",
            row.slice,
            row.solver,
            row.n,
            row.cost_ratio,
            row.fold_fraction,
            row.max_stretch,
            row.binning_l1,
            row.binning_floor,
            row.outside,
            row.seconds,
            row.fallback
                .map_or(String::new(), |solver| format!("  fallback: {solver}"))
        ));
    }
    output::line(&format!(
        "cost: mean squared distance over the exact assignment's of n row-column points; above {} points over a lower \
         bound of it. folds: share of the square with determinant ≤ 0. stretch: largest singular value. binning: share of \
         samples in the wrong one of {SIDE}² bins, twice counted; floor: what a perfect map scores. outside: share of \
         samples. seconds: wall time of one map on {} threads; `frame` uses one.",
        bake_train::transport::disk_map::EXACT_MAX,
        rayon::current_num_threads()
    ));
}
