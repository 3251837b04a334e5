//! `bake export`: ONNX beside the safetensors.

use crate::arguments::ExportOptions;
use crate::output;
use anyhow::Result;
use bake_runtime::BakedMaterial;

/// Runs the command.
pub fn run(options: &ExportOptions) -> Result<()> {
    let material = BakedMaterial::load(&options.model)?;
    bake_export::export(&material, &options.model)?;
    output::line(&format!("{}: sample.onnx, eval.onnx, pdf.onnx", options.model.display()));
    Ok(())
}
