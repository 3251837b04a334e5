//! `bake bench --family`: what the reference models cost, beside the noise that it buys.

use crate::output;
use crate::progress::Stages;
use anyhow::Result;
use bake_runtime::Family;
use bake_train::bench::reference::{Row, SLICE_NOISE, SLICE_SIDE, rows};

/// Measures the models of `family`.
pub fn run(family: Family, json: bool) -> Result<()> {
    let stages = Stages::new();
    let label = format!("measuring {}", family.name());
    let rows = rows(family, &|done, total| stages.report(&label, done, total))?;
    stages.finish();
    if json {
        return output::json(&rows);
    }
    print(&rows);
    Ok(())
}

fn print(rows: &[Row]) {
    output::line(&format!(
        "{:<13}{:>13}{:>6}{:>11}{:>9}{:>12}{:>9}{:>9}{:>10}{:>9}{:>8}",
        "model",
        "alpha",
        "θ_o",
        "sample ns",
        "rel var",
        "propose ns",
        "eval ns",
        "rel sd",
        "slice ms",
        "noise %",
        "walks"
    ));
    for row in rows {
        output::line(&format!(
            "{:<13}{:>13}{:>5}°{:>11.0}{:>9.3}{:>12.0}{:>9.0}{:>9.3}{:>10.1}{:>9.2}{:>8}",
            row.model,
            format!("{} × {}", row.alpha[0], row.alpha[1]),
            row.theta_deg,
            row.sample_ns,
            row.sample_relvar,
            row.propose_ns,
            row.eval_ns,
            row.eval_rel_sd,
            row.slice_seconds * 1e3,
            row.slice_noise * 100.0,
            row.slice_walks,
        ));
    }
    output::line(&format!(
        "One thread, medians of interleaved rounds. rel var: variance over squared mean of the weight of `sample`; \
         propose: the deterministic proposal with its pdf; rel sd: standard deviation over mean of one `eval`; \
         slice: {SLICE_SIDE}² directions with at most {} % noise (standard deviation over mean, weighed by energy).",
        SLICE_NOISE * 100.0
    ));
}
