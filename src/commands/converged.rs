//! The converged reference of a scene: rendered once by the reference sampler, kept, and reused.

use super::scene_file;
use crate::progress::Stages;
use anyhow::{Context, Result};
use bake_scenes::{Image, Method, RenderSettings, Scene, exr_file, render};
use std::path::{Path, PathBuf};

/// Seed of the converged reference, apart from the seeds that users start from.
const SEED: u64 = 0xc0ffee;
/// Samples per pixel of one pass.
const PASS_SPP: u64 = 64;
/// Attribute of the EXR that says what it was rendered from.
const FINGERPRINT: &str = "bake.fingerprint";

/// FNV-1a over everything the picture depends on: the scene's text and its materials.
fn fingerprint(folder: &Path, scene: &Scene, spp: u64) -> Result<String> {
    let path = scene_file(folder);
    let mut text = std::fs::read(&path).with_context(|| path.display().to_string())?;
    for material in scene.materials() {
        text.extend(format!("{material:?}").bytes());
    }
    let hash = text.iter().fold(0xcbf2_9ce4_8422_2325u64, |h, b| {
        (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3)
    });
    Ok(format!("{hash:016x}-{spp}"))
}

/// The converged reference at `spp`, from `out` or rendered and kept there.
pub fn converged(folder: &Path, scene: &Scene, spp: u64, out: &Path, stages: &Stages) -> Result<Image> {
    let path: PathBuf = out.join(format!("converged-{spp}.exr"));
    let fingerprint = fingerprint(folder, scene, spp)?;
    if path.exists() {
        let image = exr_file::read(&path)?;
        if image.attributes.get(FINGERPRINT) == Some(&fingerprint) {
            return Ok(image);
        }
    }
    let no_backend = |name: &str| {
        Err(bake_runtime::Error::network(
            name,
            "the reference needs no networks",
        ))
    };
    let mut image = Image::new(scene.width, scene.height);
    while image.spp < spp {
        let pass = PASS_SPP.min(spp - image.spp);
        let settings = RenderSettings {
            method: Method::Reference,
            spp: pass,
            sample_offset: image.spp,
            seed: SEED,
        };
        let before = image.spp;
        let rendered = render(scene, &settings, &no_backend, &|done, total| {
            let share = done as f64 / total.max(1) as f64;
            stages.report(
                "converged reference",
                ((before as f64 + share * pass as f64) * 16.0) as u64,
                spp * 16,
            )
        })?;
        image.merge(&rendered)?;
    }
    stages.finish();
    image.attributes.insert(FINGERPRINT.to_string(), fingerprint);
    exr_file::write(&path, &image)?;
    Ok(image)
}
