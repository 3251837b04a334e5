//! `bake render`: one scene, one method.

use super::converged::converged;
use super::{RenderEntry, load, materials_folder, prepare_folder};
use crate::arguments::{BackendName, EstimatorName, MethodName, RenderOptions};
use crate::backends::Backends;
use crate::output;
use crate::progress::Stages;
use anyhow::{Result, bail};
use bake_runtime::Family;
use bake_runtime::Material;
use bake_scenes::metrics::{error_split, relmse};
use bake_scenes::{Estimator, Image, Method, RenderSettings, Scene, exr_file, picture};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Samples per pixel unless told otherwise.
const DEFAULT_SPP: u64 = 64;
/// Samples per pixel of the converged reference that errors are measured against.
pub const CONVERGED_SPP: u64 = 1024;

/// A method by its names.
pub fn method_of(method: MethodName, estimator: EstimatorName) -> Method {
    match method {
        MethodName::Reference => Method::Reference,
        MethodName::ReferenceRandom => Method::ReferenceRandom,
        MethodName::Vndf => Method::Vndf,
        MethodName::Cosine => Method::Cosine,
        MethodName::Baked => Method::Baked(match estimator {
            EstimatorName::Learned => Estimator::Learned,
            EstimatorName::Exact => Estimator::Exact,
            EstimatorName::ExactBaked => Estimator::ExactBaked,
        }),
    }
}

/// Words for a method in file names and progress bars, e.g. `baked-exact`.
pub fn label(method: Method) -> String {
    match method.estimator() {
        Some(estimator) => format!("{}-{}", method.name(), estimator.name()),
        None => method.name().to_string(),
    }
}

/// Runs the command.
pub fn run(options: &RenderOptions) -> Result<()> {
    let scene = load(&options.scene, Material::reference)?;
    let home = PathBuf::from("out").join(&scene.name);
    let method = method_of(options.method, options.estimator);
    let exr = options
        .out
        .clone()
        .unwrap_or_else(|| home.join(label(method)).with_extension("exr"));
    if exr.extension().is_none_or(|e| e != "exr") {
        bail!(
            "{}: --out must name an .exr file; the PNG goes beside it",
            exr.display()
        );
    }
    let folders = match method {
        Method::Baked(_) => model_folders(&scene, &options.scene, options.models.as_deref(), &home)?,
        _ => BTreeMap::new(),
    };
    let backends = Backends::load(options.backend, &folders, &scene)?;
    prepare_folder(
        exr.parent()
            .filter(|p| !p.as_os_str().is_empty())
            .unwrap_or(Path::new(".")),
    )?;
    let stages = Stages::new();
    let started = Instant::now();
    let image = match options.seconds {
        Some(seconds) => render_for(&scene, method, options.seed, seconds, &backends, &stages)?,
        None => pass(
            &scene,
            method,
            options.spp.unwrap_or(DEFAULT_SPP),
            0,
            options.seed,
            &backends,
            &stages,
        )?,
    };
    let seconds = started.elapsed().as_secs_f64();
    stages.finish();
    write_pictures(&exr, &image, scene.exposure)?;
    let reference = match options.json {
        true => {
            prepare_folder(&home)?;
            Some(converged(&options.scene, &scene, CONVERGED_SPP, &home, &stages)?)
        }
        false => None,
    };
    let entry = entry(method, &[image], seconds, reference.as_ref(), &exr)?;
    if options.json {
        return output::json(&entry);
    }
    let backend = if options.backend == BackendName::Ort {
        ", onnxruntime"
    } else {
        ""
    };
    output::line(&format!(
        "{}: {} spp, {:.1} s{backend}",
        exr.display(),
        entry.spp,
        entry.seconds
    ));
    Ok(())
}

/// The folder of every baked material of `scene`.
fn model_folders(
    scene: &Scene,
    scene_path: &Path,
    models: Option<&Path>,
    home: &Path,
) -> Result<BTreeMap<String, PathBuf>> {
    let candidates: Vec<PathBuf> = match models {
        Some(folder) => vec![folder.to_path_buf()],
        None => vec![home.to_path_buf(), materials_folder(scene_path)],
    };
    let mut folders = BTreeMap::new();
    for material in scene.materials() {
        let found = candidates
            .iter()
            .map(|c| c.join(&material.name))
            .find(|f| f.join("sample.safetensors").exists());
        let Some(folder) = found else {
            if material.family != Family::Conductor {
                bail!(
                    "material `{}` is not baked, and its family `{}` cannot be so far; render it with --method reference",
                    material.name,
                    material.family.name()
                );
            }
            let looked = candidates
                .iter()
                .map(|c| c.join(&material.name).display().to_string())
                .collect::<Vec<_>>();
            bail!(
                "material `{}` is not baked: no sample.safetensors in {}; run `bake scene {}` first",
                material.name,
                looked.join(" or "),
                scene_path.display()
            );
        };
        folders.insert(material.name.clone(), folder);
    }
    Ok(folders)
}

/// One pass of `spp` samples after `offset`.
pub fn pass(
    scene: &Scene,
    method: Method,
    spp: u64,
    offset: u64,
    seed: u64,
    backends: &Backends,
    stages: &Stages,
) -> Result<Image> {
    let settings = RenderSettings {
        method,
        spp,
        sample_offset: offset,
        seed,
    };
    let label = format!("render {}", label(method));
    let tick = |done: u64, total: u64| stages.report(&label, done, total);
    Ok(bake_scenes::render(
        scene,
        &settings,
        &|name| backends.get(name),
        &tick,
    )?)
}

/// Passes that double the samples until the time is used up; the last one is sized to fit.
fn render_for(
    scene: &Scene,
    method: Method,
    seed: u64,
    seconds: f64,
    backends: &Backends,
    stages: &Stages,
) -> Result<Image> {
    let started = Instant::now();
    let mut image = pass(scene, method, 1, 0, seed, backends, stages)?;
    loop {
        let used = started.elapsed().as_secs_f64();
        let affordable = (image.spp as f64 * (seconds - used) / used) as u64;
        let spp = affordable.min(image.spp);
        if spp == 0 {
            return Ok(image);
        }
        let next = pass(scene, method, spp, image.spp, seed, backends, stages)?;
        image.merge(&next)?;
    }
}

/// Writes `exr` with all the data, and a PNG beside it.
pub fn write_pictures(exr: &Path, image: &Image, exposure: f32) -> Result<()> {
    exr_file::write(exr, image)?;
    picture::write_png(&exr.with_extension("png"), &[image], exposure)?;
    Ok(())
}

/// The report of a method from images of several seeds; `seconds` is the time of one.
pub fn entry(
    method: Method,
    images: &[Image],
    seconds: f64,
    reference: Option<&Image>,
    path: &Path,
) -> Result<RenderEntry> {
    let mut nulls = BTreeMap::new();
    nulls.insert(
        "flip".to_string(),
        "FLIP is not measured by this version".to_string(),
    );
    let mut error = None;
    match reference {
        Some(reference) => {
            let all = images
                .iter()
                .map(|i| relmse(i, reference))
                .collect::<bake_scenes::Result<Vec<f64>>>()?;
            error = Some(all.iter().sum::<f64>() / all.len() as f64);
        }
        None => {
            nulls.insert("relmse".into(), "no converged reference was asked for".into());
        }
    }
    let split = match reference {
        Some(reference) if images.len() > 1 => Some(error_split(images, reference)?),
        _ => {
            for key in ["bias2", "variance"] {
                nulls.insert(key.into(), "several seeds are needed to tell them apart".into());
            }
            None
        }
    };
    Ok(RenderEntry {
        method: method.name().to_string(),
        estimator: method.estimator().map(|e| e.name().to_string()),
        spp: images.first().map_or(0, |i| i.spp),
        seconds,
        relmse: error,
        bias2: split.map(|s| s.bias2),
        variance: split.map(|s| s.variance),
        flip: None,
        image: path.to_path_buf(),
        nulls,
    })
}
