//! `bake train`: the networks of one material.

use super::baking::Order;
use super::{check, find_material};
use crate::arguments::TrainOptions;
use crate::output;
use crate::progress::Stages;
use anyhow::{Result, bail};
use bake_runtime::{Family, Material, Role};
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
    if !options.json {
        say_domain(&material, options.preset)?;
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

/// Says how many inputs remain and what that saved.
fn say_domain(material: &Material, preset: Preset) -> Result<()> {
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
    output::line(&format!(
        "{} ({}, {preset} preset): {what}",
        material.name,
        material.family.name()
    ));
    if material.family != Family::Imported {
        let widest = material.widest();
        let fixed = widest.free().len() - free.len();
        let all = macs(&widest)?;
        output::line(&format!(
            "{fixed} parameters are fixed and left the network: {own} multiply-adds per sample instead of {all}"
        ));
    }
    Ok(())
}

/// The command that repeats this training.
fn command_line(options: &TrainOptions) -> String {
    let quick = if options.quick { " --quick" } else { "" };
    format!(
        "bake train {} --preset {}{quick} --seed {}",
        options.material, options.preset, options.seed
    )
}
