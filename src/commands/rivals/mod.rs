//! `bake rivals`: a baked material beside other samplers at the same held-out places.

mod flow;
mod picture;
mod report;

use super::check::{CARD_FILE, QUICK_EVERY, read_card};
use super::{load_model, prepare_folder, write_json};
use crate::arguments::RivalsOptions;
use crate::progress::Stages;
use crate::{backends, output};
use anyhow::{Context, Result, bail};
use bake_runtime::BakedMaterial;
use bake_train::card::Card;
use bake_train::card::heldout::{self, HeldOut, PER_STRATUM};
use bake_train::card::truth::Truth;
use bake_train::comparators::baked::BakedSlice;
use bake_train::comparators::blinn_phong::BlinnPhong;
use bake_train::comparators::realnvp::RealNvp;
use bake_train::comparators::standings::{Contender, standings};
use bake_train::comparators::{SliceSampler, figure};
use bake_train::presets::Preset;
use report::{Report, Row};
use std::path::{Path, PathBuf};

/// Where the table goes, as JSON.
const REPORT_FILE: &str = "rivals.json";
/// The slice as everyone draws it.
const PICTURE_FILE: &str = "rivals.png";

/// A baked folder.
struct Model {
    folder: PathBuf,
    networks: BakedMaterial,
    card: Option<Card>,
}

impl Model {
    fn load(folder: &Path) -> Result<Model> {
        Ok(Model {
            networks: load_model(folder)?,
            card: read_card(&folder.join(CARD_FILE))?,
            folder: folder.to_path_buf(),
        })
    }

    fn preset(&self) -> Preset {
        Preset::of(&self.networks.sample.spec)
    }
}

/// Makes the samplers of places, as [`Contender`] says.
type Maker<'a> = Box<dyn Fn(&HeldOut, &Truth) -> bake_train::Result<Box<dyn SliceSampler>> + Sync + 'a>;

/// Runs the command.
pub fn run(options: &RivalsOptions) -> Result<()> {
    let model = Model::load(&options.model)?;
    let paper = options.paper.as_deref().map(Model::load).transpose()?;
    if let Some(paper) = &paper {
        refuse_strangers(&model, paper)?;
    }
    let material = &model.networks.sample.spec.material;
    heldout::places(material).with_context(|| options.model.display().to_string())?;
    let out = match &options.out {
        Some(folder) => folder.clone(),
        None => Path::new("out/rivals").join(&material.name),
    };
    let wanted = flow::wanted(&model, options, &out)?;
    prepare_folder(&out)?;
    let stages = Stages::new();
    let trained = flow::train(&model, wanted, &out, options, &stages)?;

    let mut rows = vec![Row::baked(&model)];
    let mut makers = vec![baked(&model)];
    if let Some(paper) = &paper {
        rows.push(Row::baked(paper));
        makers.push(baked(paper));
    }
    rows.extend([Row::flow(&trained), Row::blinn_phong()]);
    makers.extend([realnvp(&trained.flow), blinn_phong()]);
    let contenders: Vec<Contender> = makers.iter().map(|maker| &**maker as Contender).collect();
    let every = if options.quick { QUICK_EVERY } else { 1 };
    let found = standings(material, &contenders, every, &|done, total| {
        stages.report("held-out places", done, total)
    })?;
    for (row, found) in rows.iter_mut().zip(found) {
        row.standings = Some(found);
    }
    stages.finish();

    let place = figure::place(material)?;
    let drawn = figure::figure(material, &place, &contenders)?;
    let picture = out.join(PICTURE_FILE);
    picture::write(&picture, &model, &place, &drawn, &rows)?;
    let report = Report {
        material: material.name.clone(),
        heldout_per_stratum: PER_STRATUM.div_ceil(every),
        threads: rayon::current_num_threads(),
        flow: trained.budget,
        rows,
        picture,
    };
    write_json(&out.join(REPORT_FILE), &report)?;
    if options.json {
        return output::json(&report);
    }
    report.print();
    Ok(())
}

/// Refuses as `paper` what is of another preset or material than it should be.
fn refuse_strangers(model: &Model, paper: &Model) -> Result<()> {
    let folder = paper.folder.display();
    if paper.preset() != Preset::Paper {
        bail!(
            "--paper {folder}: its networks are of the {} preset; bake them with `bake train {} --preset paper`",
            paper.preset(),
            model.networks.sample.spec.material.name
        );
    }
    if paper.networks.sample.spec.material != model.networks.sample.spec.material {
        bail!(
            "--paper {folder}: it was baked from another material than {}",
            model.folder.display()
        );
    }
    Ok(())
}

fn baked(model: &Model) -> Maker<'_> {
    Box::new(|place, _| {
        Ok(Box::new(BakedSlice::new(
            Box::new(backends::native(&model.networks)?),
            place,
        )))
    })
}

fn realnvp(flow: &RealNvp) -> Maker<'_> {
    Box::new(|place, _| Ok(Box::new(flow.bind(&place.params, place.wo))))
}

fn blinn_phong() -> Maker<'static> {
    Box::new(|_, truth| Ok(Box::new(BlinnPhong::fit(&truth.lobes))))
}
