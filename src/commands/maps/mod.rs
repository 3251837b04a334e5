//! `bake maps`: a database of importance maps, pictures of its entries, and comparisons of solvers.

mod build;
mod compare;
mod view;

use super::find_material;
use crate::arguments::MapsOptions;
use anyhow::{Result, bail};
use bake_runtime::Material;
use bake_runtime::field::Fields;
use bake_train::transport::Solver;
use bake_train::transport::disk_map::EXACT_MAX;
use std::path::{Path, PathBuf};

/// Runs the command.
pub fn run(options: &MapsOptions) -> Result<()> {
    if options.compare {
        compare::run(options)
    } else if options.view.is_empty() {
        build::run(options)
    } else {
        view::run(options)
    }
}

/// The material that the command is about.
fn material(options: &MapsOptions) -> Result<Material> {
    let Some(material) = find_material(&options.subject)? else {
        bail!(
            "{}: there is no such material; give a material file, or the name of one in scenes/materials",
            options.subject
        )
    };
    let material = material.replaced(Fields(options.set.clone()), Path::new(""))?;
    material.validate()?;
    Ok(material)
}

/// Refuses an exact assignment that is asked for where all sizes of maps are too large for it.
fn refuse_large_exact(solvers: &[Solver], sides: &[usize]) -> Result<()> {
    let smallest = sides.iter().min().copied().unwrap_or_default();
    if solvers.contains(&Solver::Exact) && smallest * smallest > EXACT_MAX {
        bail!(
            "--solver exact: {smallest} × {smallest} points are too many for an exact assignment; give --cells 64 or less"
        );
    }
    Ok(())
}

/// Where the files of the subject called `name` go.
fn folder(options: &MapsOptions, name: &str) -> PathBuf {
    match &options.out {
        Some(folder) => folder.clone(),
        None => Path::new("out/maps").join(name),
    }
}
