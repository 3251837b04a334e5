//! Baking one material into a folder: what `bake scene` and `bake train` share.

use super::check::{self, CARD_FILE, Provenance};
use super::{curves, prepare_folder, write_json};
use crate::output;
use crate::progress::Stages;
use anyhow::{Context, Result};
use bake_runtime::Material;
use bake_train::bake::{Effort, bake};
use bake_train::card::Card;
use bake_train::presets::Preset;
use std::path::Path;
use std::time::Instant;

/// Where checkpoints lie in the folder of a model.
pub const CHECKPOINTS: &str = "checkpoints";

/// What is baked, how, and where to.
pub struct Order<'a> {
    /// The material.
    pub material: &'a Material,
    /// The preset.
    pub preset: Preset,
    /// A first look instead of all the work.
    pub quick: bool,
    /// Seed of everything.
    pub seed: u64,
    /// Whether checkpoints in the folder are taken up.
    pub resume: bool,
    /// Where networks, their card and checkpoints go.
    pub folder: &'a Path,
    /// The command that repeats it.
    pub command: String,
}

/// Seconds that the stages took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Took {
    /// Slices and maps.
    pub maps: f64,
    /// Networks.
    pub train: f64,
    /// ONNX and the picture of the learning curves.
    pub export: f64,
    /// The card.
    pub check: f64,
}

impl Order<'_> {
    /// Bakes, saves, exports, draws the learning curves and checks.
    pub fn fill(self, stages: &Stages) -> Result<(Card, Took)> {
        let folder = self.folder;
        let work = folder.join(CHECKPOINTS);
        if !self.resume && work.exists() {
            std::fs::remove_dir_all(&work)
                .with_context(|| format!("{}: cannot start over", work.display()))?;
        }
        prepare_folder(&work)?;
        let effort = Effort::of(self.preset, self.material, self.quick);
        let baked = bake(
            self.material,
            self.preset,
            effort,
            self.seed,
            &work,
            &|stage, done, total| stages.report(stage.label(), done, total),
        )?;
        stages.finish();
        let counts = baked.cost.maps.fallback_maps;
        let fallbacks: usize = counts.iter().map(|(fallen, _)| fallen).sum();
        let maps: usize = counts.iter().map(|(_, all)| all).sum();
        if fallbacks > 0 {
            output::warn(&format!(
                "{fallbacks} of {maps} maps are marginal maps, because transport failed there"
            ));
        }
        let clock = Instant::now();
        baked.material.save(folder)?;
        bake_export::export(&baked.material, folder)?;
        curves::draw(&work, self.preset, folder)?;
        let export = clock.elapsed().as_secs_f64();

        let clock = Instant::now();
        let provenance = Provenance {
            seed: self.seed,
            command: self.command,
            training: Some(baked.cost.clone()),
        };
        let every = if self.quick { check::QUICK_EVERY } else { 1 };
        let card = check::measure(&baked.material, folder, provenance, every, stages)?;
        write_json(&folder.join(CARD_FILE), &card)?;
        let took = Took {
            maps: baked.cost.maps_seconds,
            train: baked.cost.seconds,
            export,
            check: clock.elapsed().as_secs_f64(),
        };
        Ok((card, took))
    }
}
