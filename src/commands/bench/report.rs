//! The table and the pictures of `bake bench`.

use super::queries::Estimator;
use super::row::{Results, Row};
use crate::output;
use anyhow::Result;
use bake_scenes::curve_picture::{Axes, CurvePanel, Series, write_curves};
use std::path::Path;

/// Prints all rows.
pub fn print(results: &Results) {
    let mut subject = "";
    for row in &results.rows {
        if row.subject != subject {
            subject = &row.subject;
            output::line(&format!(
                "\n{:<26}{:>10}{:>11}{:>7}{:>11}{:>9}{:>8}{:>11}{:>10}",
                subject,
                "backend",
                "estimator",
                "batch",
                "ns/query",
                "GFLOP/s",
                "% peak",
                "max error",
                "binning"
            ));
        }
        let backend = match (row.tier, row.bound) {
            (None, _) => row.backend.to_string(),
            (Some(tier), false) => tier.to_string(),
            (Some(_), true) => "bound".to_string(),
        };
        let number =
            |value: Option<f64>, digits: usize| value.map_or("-".into(), |v| format!("{v:.digits$}"));
        let error = row.max_abs_error.map_or("-".into(), |v| format!("{v:.1e}"));
        output::line(&format!(
            "{:<26}{:>10}{:>11}{:>7}{:>11.1}{:>9}{:>8}{:>11}{:>10}",
            "",
            backend,
            row.estimator.name(),
            row.batch,
            row.ns_per_query,
            number(row.gflops, 1),
            number(row.percent_of_fma_peak, 1),
            error,
            number(row.binning_l1, 4),
        ));
    }
    let peaks = results.peaks.iter().map(|(tier, (gflops, per_cycle))| {
        format!("{tier} {gflops:.1} GFLOP/s ({per_cycle:.2} vectors a cycle)")
    });
    output::line(&format!(
        "\nOne thread, medians of interleaved rounds. bound: the best tier with all free parameters bound. GFLOP/s: two \
         operations for every multiply-add of the layers, tangents included; % peak: of independent multiply-adds of the \
         same tier, the highest of the same rounds ({}); of the best tier for ort, which gets its best of three chunk sizes. \
         max error: largest |a − b| / max(1, |b|) against f64. binning: of the sampling network, θ_o ≤ 75°, from the model \
         card. onnxruntime's `learned` and `jacobian` are one graph. \
         load: from the files to a material that can answer, all of it.",
        peaks.collect::<Vec<_>>().join(", ")
    ));
}

/// Draws ns per query over the batch, a panel for each subject, and error over ns, into `out`; the names of the pictures.
pub fn draw(results: &Results, out: &Path) -> Result<Vec<String>> {
    let mut subjects: Vec<&str> = results.rows.iter().map(|row| row.subject.as_str()).collect();
    subjects.dedup();
    let panels: Vec<CurvePanel> = subjects
        .iter()
        .map(|subject| over_batch(results, subject))
        .collect();
    let mut names = Vec::new();
    let mut write = |name: &str, panels: &[CurvePanel]| -> Result<()> {
        let path = out.join(name);
        write_curves(&path, panels)?;
        names.push(path.display().to_string());
        Ok(())
    };
    write("batches.png", &panels)?;
    let errors = over_error(results);
    if !errors.series.is_empty() {
        write("errors.png", &[errors])?;
    }
    Ok(names)
}

fn rows<'a>(results: &'a Results, subject: &'a str, estimator: Estimator) -> impl Iterator<Item = &'a Row> {
    let of_it = move |row: &&Row| row.subject == subject && row.estimator == estimator && !row.bound;
    results.rows.iter().filter(of_it)
}

/// What one subject's first estimator costs on every backend.
fn over_batch(results: &Results, subject: &str) -> CurvePanel {
    let queries = |row: &&Row| row.subject == subject && row.estimator != Estimator::Load;
    let first = results.rows.iter().find(queries);
    let estimator = first.map_or(Estimator::Layers, |row| row.estimator);
    let mut series: Vec<Series> = Vec::new();
    for row in rows(results, subject, estimator) {
        let name = row.tier.unwrap_or(row.backend);
        let at = match series.iter().position(|s| s.name == name) {
            Some(at) => at,
            None => {
                series.push(Series {
                    name: name.to_string(),
                    points: Vec::new(),
                });
                series.len() - 1
            }
        };
        series[at].points.push([row.batch as f64, row.ns_per_query]);
    }
    CurvePanel {
        title: format!("{subject}, {}", estimator.name()),
        series,
        axes: Some(Axes {
            across: "queries per call".into(),
            up: "ns per query".into(),
        }),
        ..CurvePanel::default()
    }
}

/// Binning error over the cost of a sample, of the materials that have a card; batches of 4096.
fn over_error(results: &Results) -> CurvePanel {
    let sampled = |row: &&Row| row.estimator == Estimator::Learned && row.batch == 4096 && !row.bound;
    let mut series: Vec<Series> = Vec::new();
    for row in results.rows.iter().filter(sampled) {
        let Some(error) = row.binning_l1 else { continue };
        let point = [row.ns_per_query, error];
        match series.iter_mut().find(|s| s.name == row.subject) {
            Some(series) => series.points.push(point),
            None => series.push(Series {
                name: row.subject.clone(),
                points: vec![point],
            }),
        }
    }
    CurvePanel {
        title: "Learned samples on every tier and in onnxruntime".into(),
        series,
        axes: Some(Axes {
            across: "ns per query".into(),
            up: "binning error, θ ≤ 75°".into(),
        }),
        ..CurvePanel::default()
    }
}
