//! `bake train`: the networks of one material.

use super::baking::Order;
use super::{check, find_material, prepare_folder};
use crate::arguments::TrainOptions;
use crate::output;
use crate::progress::Stages;
use anyhow::{Result, bail};
use bake_runtime::{Material, Role};
use bake_train::presets::Preset;
use std::path::PathBuf;

/// Runs the command.
pub fn run(options: &TrainOptions) -> Result<()> {
    let Some(material) = find_material(&options.material)? else {
        bail!(
            "{}: there is no such material; give a material file, or the name of one in scenes/materials",
            options.material
        );
    };
    material.validate()?;
    let folder = match &options.out {
        Some(folder) => folder.clone(),
        None => PathBuf::from("out/materials").join(model_name(&material.name, options.preset)),
    };
    let domain = domain(&material, options.preset)?;
    prepare_folder(&folder)?;
    if !options.json {
        output::line(&domain);
    }
    let order = Order {
        material: &material,
        preset: options.preset,
        quick: options.quick,
        seed: options.seed,
        resume: options.resume,
        folder: &folder,
        command: command_line(options),
    };
    let (card, took) = order.fill(&Stages::new())?;
    if options.json {
        return output::json(&card);
    }
    check::print(&card, None);
    output::line(&format!(
        "maps {:.0} s, networks {:.0} s, check {:.0} s; {} holds networks, ONNX and card",
        took.maps,
        took.train,
        took.check,
        folder.display()
    ));
    Ok(())
}

/// Name of the folder of the networks of a material.
fn model_name(material: &str, preset: Preset) -> String {
    match preset {
        Preset::Warp => material.to_string(),
        Preset::Paper => format!("{material}-paper"),
    }
}

/// How many inputs remain, and what that saved.
fn domain(material: &Material, preset: Preset) -> Result<String> {
    let free = material.free();
    let names: Vec<&str> = free.iter().map(|(name, ..)| name.as_str()).collect();
    let macs = |m: &Material| preset.spec(Role::Sample, m).map(|spec| spec.macs());
    let own = macs(material)?;
    let what = match names.is_empty() {
        true => "only the directions remain as inputs".to_string(),
        false => format!(
            "{} free inputs beside the directions: {}",
            names.len(),
            names.join(", ")
        ),
    };
    let widest = material.widest();
    let fixed = widest.free().len() - free.len();
    Ok(format!(
        "{} ({}, {preset} preset): {what}\n{fixed} parameters are fixed and left the network: {own} multiply-adds per \
         sample instead of {}",
        material.name,
        material.family.name(),
        macs(&widest)?
    ))
}

/// The command that repeats this training.
fn command_line(options: &TrainOptions) -> String {
    let quick = if options.quick { " --quick" } else { "" };
    format!(
        "bake train {} --preset {}{quick} --seed {}",
        options.material, options.preset, options.seed
    )
}
