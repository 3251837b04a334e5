//! Material files: a family and its parameters, each fixed or free over a range, as [`bake_runtime::family`] lists them.

use crate::error::{Error, Result};
use crate::toml_file;
use bake_runtime::Material;
use std::path::Path;

/// Reads and validates the material file `path`; its stem becomes the material's name.
///
/// Parameters that have a default may be left out; files that it names lie relative to its own folder.
///
/// # Errors
/// [`Error::Io`], [`Error::Syntax`], [`Error::Key`] or [`Error::Material`], each naming file and key.
pub fn load_material(path: &Path) -> Result<Material> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let folder = path.parent().unwrap_or(Path::new(""));
    let material = Material::read(&name, toml_file::read(path)?, folder);
    let checked = material.and_then(|material| {
        material.validate()?;
        Ok(material)
    });
    checked.map_err(|source| Error::Material {
        path: path.into(),
        source,
    })
}
