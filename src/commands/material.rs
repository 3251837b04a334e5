//! `bake material`: what a material looks like, before anything is baked.

use super::{find_material, prepare_folder};
use crate::arguments::MaterialOptions;
use crate::output;
use crate::progress::Stages;
use anyhow::{Result, bail};
use bake_runtime::bsdf::direction;
use bake_runtime::field::Fields;
use bake_runtime::{Bsdf, Family, Material};
use bake_scenes::slice_picture::{DiskSlice, write_sheet};
use rayon::prelude::*;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Polar angles of the printed albedos, degrees.
const ALBEDO_THETAS: [f64; 10] = [0.0, 15.0, 30.0, 45.0, 60.0, 70.0, 80.0, 85.0, 88.0, 89.0];

/// Walks behind an albedo for each behind a slice, which connects every walk to every pixel.
const ALBEDO_FACTOR: u64 = 32;

/// All slices side by side.
const SHEET_FILE: &str = "slices.png";

/// The albedo at one direction.
#[derive(Debug, Serialize)]
struct AlbedoRow {
    theta: f64,
    phi: f64,
    albedo: [f64; 3],
    se: [f64; 3],
}

/// One slice and how its pictures are scaled.
#[derive(Debug, Serialize)]
struct SliceRow {
    theta: f64,
    phi: f64,
    exr: PathBuf,
    /// Largest f_cos, sr⁻¹.
    peak: f32,
    /// f_cos up to which the linear picture is not bent, sr⁻¹.
    exposed: f32,
    /// Orders of magnitude that the logarithmic picture shows.
    decades: f32,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Report {
    material: Material,
    /// Scalars that the material leaves free, shown at the middle of these ranges.
    free: Vec<(String, f64, f64)>,
    samples: u64,
    albedo: Vec<AlbedoRow>,
    slices: Vec<SliceRow>,
    sheet: PathBuf,
}

/// Runs the command.
pub fn run(options: &MaterialOptions) -> Result<()> {
    let described = describe(options)?;
    described.validate()?;
    let material = described.middle();
    let bsdf = material.reference()?;
    let out = match &options.out {
        Some(folder) => folder.clone(),
        None => Path::new("out/materials").join(&material.name),
    };
    prepare_folder(&out)?;
    let stages = Stages::new();
    let albedo = ALBEDO_THETAS.par_iter().map(|&theta| {
        let wo = direction(theta, options.phi);
        let albedo = bsdf.albedo(wo, options.samples * ALBEDO_FACTOR, options.seed);
        AlbedoRow {
            theta,
            phi: options.phi,
            albedo: albedo.mean.to_array(),
            se: albedo.se.to_array(),
        }
    });
    let mut slices = Vec::new();
    for (i, theta) in options.theta.iter().enumerate() {
        let total = options.theta.len() as u64;
        slices.push(DiskSlice::draw(
            &bsdf,
            [*theta, options.phi],
            options.size as usize,
            options.samples as usize,
            options.seed,
            &|rows, of| stages.report("slices", i as u64 * of + rows, total * of),
        )?);
    }
    stages.finish();
    let mut rows = Vec::new();
    for slice in &slices {
        let [theta, phi] = slice.wo_deg;
        let exr = out.join(format!("slice-theta-{theta}-phi-{phi}.exr"));
        slice.write_exr(&exr)?;
        let scale = slice.scale();
        rows.push(SliceRow {
            theta,
            phi,
            exr,
            peak: scale.peak,
            exposed: scale.exposed,
            decades: scale.decades,
        });
    }
    let sheet = out.join(SHEET_FILE);
    write_sheet(&sheet, &slices)?;
    let report = Report {
        free: described.free(),
        material,
        samples: options.samples,
        albedo: albedo.collect(),
        slices: rows,
        sheet,
    };
    if options.json {
        return output::json(&report);
    }
    print(&report)
}

/// The material of that name with what `--set` changes.
fn describe(options: &MaterialOptions) -> Result<Material> {
    let (name, here) = (options.name.as_str(), Path::new(""));
    let set = Fields(options.set.clone());
    if let Some(family) = Family::find(name) {
        return Ok(Material::assign(name, family, set, here)?);
    }
    match find_material(name)? {
        Some(material) => Ok(material.replaced(set, here)?),
        None => bail!(
            "{name}: there is no such material; give a family ({}), a material file, or the name of one in \
             scenes/materials",
            Family::names()
        ),
    }
}

fn print(report: &Report) -> Result<()> {
    let material = &report.material;
    let title = match material.name == material.family.name() {
        true => material.name.clone(),
        false => format!("{} ({})", material.name, material.family.name()),
    };
    output::line(&format!("{title}: {}", material.family.doc()));
    for (name, setting) in &material.parameters {
        output::line(&format!("  {name:<16}{}", serde_json::to_string(setting)?));
    }
    for (name, min, max) in &report.free {
        output::line(&format!("  {name} is free over {min}..{max}: this is its middle"));
    }
    output::line(&format!(
        "\nalbedo, {} samples each\n{:>5}{:>24}{:>27}",
        report.samples * ALBEDO_FACTOR,
        "θ",
        "RGB",
        "± se"
    ));
    for row in &report.albedo {
        let [r, g, b] = row.albedo;
        let [sr, sg, sb] = row.se;
        output::line(&format!(
            "{:>4}°{r:>10.5}{g:>10.5}{b:>10.5}   ± {sr:.5} {sg:.5} {sb:.5}",
            row.theta
        ));
    }
    output::line("\nslices, f_cos in sr⁻¹\n    θ     largest     exposed  decades");
    for row in &report.slices {
        output::line(&format!(
            "{:>4}°{:>12.4}{:>12.4}{:>9}   {}",
            row.theta,
            row.peak,
            row.exposed,
            row.decades,
            row.exr.display()
        ));
    }
    output::line(&format!(
        "{}: above, linear, where f_cos up to `exposed` keeps its proportions; below, its logarithm, from the largest \
         down to black `decades` lower; a ring at the camera",
        report.sheet.display()
    ));
    Ok(())
}
