//! One file per subcommand, and what they share.

pub mod baking;
pub mod bench;
pub mod check;
pub mod converged;
pub mod curves;
pub mod export;
pub mod maps;
pub mod material;
pub mod query;
pub mod render;
pub mod rivals;
pub mod scene;
pub mod train;

use anyhow::{Context, Result, bail};
use bake_runtime::query::{Baked, Subject};
use bake_runtime::{BakedMaterial, Family, Material};
use bake_scenes::{Scene, load_material, load_scene};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// One rendered method, as `--json` prints it.
#[derive(Clone, Debug, Serialize)]
pub struct RenderEntry {
    /// Method.
    pub method: String,
    /// Estimator of a baked method.
    pub estimator: Option<String>,
    /// Samples per pixel.
    pub spp: u64,
    /// Seconds of one image.
    pub seconds: f64,
    /// Mean relative squared error against the converged reference.
    pub relmse: Option<f64>,
    /// Its systematic part, from several seeds; the converged reference's own noise is in it.
    pub bias2: Option<f64>,
    /// Its random part, from several seeds.
    pub variance: Option<f64>,
    /// FLIP.
    pub flip: Option<f64>,
    /// Path of the picture.
    pub image: PathBuf,
    /// Why a value is null.
    pub nulls: std::collections::BTreeMap<String, String>,
}

/// Reads the scene at `path`, a folder with scene.toml or that file, and makes sure that every material has the
/// reference model that the command `needs`.
pub fn load<T>(path: &Path, needs: fn(&Material) -> bake_runtime::Result<T>) -> Result<Scene> {
    let file = scene_file(path);
    if !file.is_file() {
        bail!(
            "{}: there is no such file; give a folder with scene.toml",
            file.display()
        );
    }
    let scene = load_scene(path)?;
    for material in scene.materials() {
        let file = materials_folder(path).join(&material.name).with_extension("toml");
        needs(material).with_context(|| file.display().to_string())?;
    }
    Ok(scene)
}

/// The file of the scene at `path`.
pub fn scene_file(path: &Path) -> PathBuf {
    if path.is_dir() {
        path.join("scene.toml")
    } else {
        path.to_path_buf()
    }
}

/// Where the material files of the scene at `path` are, and the baked folders that ship with them.
pub fn materials_folder(path: &Path) -> PathBuf {
    scene_file(path).with_file_name("..").join("materials")
}

/// Reads the baked material in `folder`.
pub fn load_model(folder: &Path) -> Result<BakedMaterial> {
    let file = folder.join("sample.safetensors");
    if !file.is_file() {
        bail!(
            "{}: there is no such file; give a folder that `bake scene` wrote",
            file.display()
        );
    }
    Ok(BakedMaterial::load(folder)?)
}

/// Where materials are sought by name.
const MATERIALS: &str = "scenes/materials";

/// The material called `name`: a `.toml` file, or the name of one in [`MATERIALS`].
pub fn find_material(name: &str) -> Result<Option<Material>> {
    let by_name = Path::new(MATERIALS).join(name).with_extension("toml");
    let file = match Path::new(name).extension() {
        Some(extension) if extension == "toml" => Path::new(name),
        _ if by_name.is_file() => &by_name,
        _ => return Ok(None),
    };
    Ok(Some(load_material(file)?))
}

/// Who `name` is: a family, which always means its reference model, a folder of networks, or a material.
pub fn find_subject(name: &str) -> Result<Subject> {
    if let Some(family) = Family::find(name) {
        return Ok(Subject::Family(family));
    }
    if Path::new(name).is_dir() {
        let networks = load_model(Path::new(name))?;
        return Ok(Subject::Baked(Box::new(Baked::new(networks)?)));
    }
    match find_material(name)? {
        Some(material) => Ok(Subject::Material(material)),
        None => bail!(
            "{name}: there is no such family, model or material; give one of {}, a folder that `bake scene` wrote, \
             a material file, or the name of one in {MATERIALS}",
            Family::names()
        ),
    }
}

/// Makes sure that files can be written into `folder` before any work begins.
pub fn prepare_folder(folder: &Path) -> Result<()> {
    let probe = || -> std::io::Result<()> {
        std::fs::create_dir_all(folder)?;
        tempfile::tempfile_in(folder).map(drop)
    };
    probe().with_context(|| {
        format!(
            "{}: cannot write there; choose another folder with --out",
            folder.display()
        )
    })
}

/// Writes `value` as JSON, whole or not at all.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let mut text = serde_json::to_string_pretty(value)?;
    text.push('\n');
    Ok(bake_runtime::network::write_atomically(path, text.as_bytes())?)
}
