//! `bake bench`: what queries cost beside their error, on every tier, against onnxruntime and the processor's peak.

mod measure;
mod queries;
mod reference;
mod report;
mod row;
mod subjects;

use crate::arguments::BenchOptions;
use crate::output;
use crate::progress::Stages;
use anyhow::Result;
use std::path::PathBuf;

/// Materials that are measured where none is named, of those that ship.
const SHIPPED: [&str; 4] = ["vase", "conductor", "layered", "principled"];
/// Where these lie.
const SHIPPED_FOLDER: &str = "scenes/materials";
/// Where the picture goes unless it is said.
const OUT: &str = "out/bench";

/// Runs the command.
pub fn run(options: &BenchOptions) -> Result<()> {
    if let Some(family) = options.family {
        return reference::run(family, options.json);
    }
    let shipped = || SHIPPED.map(|name| PathBuf::from(SHIPPED_FOLDER).join(name));
    let folders = match &options.models[..] {
        [] => shipped().into_iter().filter(|folder| folder.exists()).collect(),
        models => models.to_vec(),
    };
    let subjects = subjects::all(&folders, options.models.is_empty())?;
    let stages = Stages::new();
    let results = measure::all(&subjects, options.quick, &|done, total| {
        stages.report("measuring", done, total)
    })?;
    stages.finish();
    if options.json {
        return output::json(&results.rows);
    }
    report::print(&results);
    let out = options.out.clone().unwrap_or_else(|| PathBuf::from(OUT));
    let pictures = report::draw(&results, &out)?;
    output::line(&format!("pictures: {}", pictures.join(", ")));
    Ok(())
}
