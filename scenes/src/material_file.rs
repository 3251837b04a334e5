//! Material files: a family, its parameters, each fixed or free over a range.

use crate::error::{Error, Result};
use crate::toml_file;
use bake_runtime::Material;
use bake_runtime::material::{Family, Scalar};
use serde::de::{Deserializer, IgnoredAny, MapAccess, Visitor};
use std::fmt;
use std::path::Path;

/// Reads and validates the material file `path`; its stem becomes the material's name.
///
/// # Errors
/// [`Error::Io`], [`Error::Syntax`], [`Error::Key`] or [`Error::Material`], each naming file and key.
pub fn load_material(path: &Path) -> Result<Material> {
    let file: MaterialFile = toml_file::read(path)?;
    let material = Material {
        name: path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned(),
        family: file.family,
        alpha: file.alpha.map(|s| s.0),
        reflectance: file.reflectance.map(|s| s.0),
    };
    material.validate().map_err(|source| Error::Material {
        path: path.into(),
        source,
    })?;
    Ok(material)
}

/// The file as it is written; every key must be there, none is defaulted.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct MaterialFile {
    family: Family,
    alpha: [ScalarField; 2],
    reflectance: [ScalarField; 3],
}

/// A [`Scalar`] read by hand, because serde's untagged enums cannot say what is wrong with a value.
struct ScalarField(Scalar);

impl<'de> serde::Deserialize<'de> for ScalarField {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        deserializer.deserialize_any(ScalarVisitor).map(ScalarField)
    }
}

struct ScalarVisitor;

impl<'de> Visitor<'de> for ScalarVisitor {
    type Value = Scalar;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a number or a range { min = number, max = number }")
    }

    fn visit_f64<E>(self, value: f64) -> std::result::Result<Scalar, E> {
        Ok(Scalar::Fixed(value))
    }

    fn visit_i64<E>(self, value: i64) -> std::result::Result<Scalar, E> {
        Ok(Scalar::Fixed(value as f64))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<Scalar, A::Error> {
        use serde::de::Error as _;
        let (mut min, mut max) = (None, None);
        while let Some(key) = map.next_key::<String>()? {
            match key.as_str() {
                "min" => min = Some(map.next_value()?),
                "max" => max = Some(map.next_value()?),
                _ => {
                    map.next_value::<IgnoredAny>()?;
                    return Err(A::Error::unknown_field(&key, &["min", "max"]));
                }
            }
        }
        let min = min.ok_or_else(|| A::Error::missing_field("min"))?;
        let max = max.ok_or_else(|| A::Error::missing_field("max"))?;
        Ok(Scalar::Free { min, max })
    }
}
