//! `bake export`: ONNX beside the safetensors.

use super::load_model;
use crate::arguments::ExportOptions;
use crate::output;
use anyhow::Result;

/// Runs the command.
pub fn run(options: &ExportOptions) -> Result<()> {
    let material = load_model(&options.model)?;
    bake_export::export(&material, &options.model)?;
    output::line(&format!(
        "{}: sample.onnx, eval.onnx, pdf.onnx",
        options.model.display()
    ));
    Ok(())
}
