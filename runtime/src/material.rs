//! A material: a family, its fixed parameters and its free ranges. The description that a bake starts from
//! and that every baked file carries.

use crate::error::{Error, Result};
use crate::family::{Family, Kind};
use crate::field::{Field, Fields};
use crate::setting::{Scalar, Setting};
use serde::de::Error as _;
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::path::Path;

/// A named material.
///
/// In JSON it is one object: `name`, `family`, and the parameters beside them, a number where it is fixed and
/// `{"min": …, "max": …}` where it is free.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// The name that files and reports use.
    pub name: String,
    /// The reference model.
    pub family: Family,
    /// Every parameter with its values, defaults included, in the order of [`Family::parameters`]; those that only
    /// the file of [`Family::Imported`] names come last.
    pub parameters: Vec<(String, Setting)>,
}

impl Material {
    /// A material of `family` with every parameter fixed; those that are not `given` have their defaults.
    ///
    /// # Errors
    /// [`Error::Parameter`] for an unknown or missing parameter, or values of a wrong number or out of range.
    pub fn fixed(name: &str, family: Family, given: &[(&str, &[f64])]) -> Result<Material> {
        let field = |values: &[f64]| match values {
            [one] => Field::Number(*one),
            several => Field::List(several.iter().copied().map(Field::Number).collect()),
        };
        let given = given.iter().map(|(key, values)| (key.to_string(), field(values)));
        let material = Material::assign(name, family, Fields(given.collect()), Path::new(""))?;
        material.validate()?;
        Ok(material)
    }

    /// Reads `given`, which has `family` and its parameters; names of files are relative to `folder`.
    ///
    /// Says nothing about ranges and about what is missing: see [`Material::validate`].
    ///
    /// # Errors
    /// [`Error::Parameter`] for an unknown family or key and for values of a wrong type or number.
    pub fn read(name: &str, mut given: Fields, folder: &Path) -> Result<Material> {
        let family = match given.take("family") {
            Some(Field::Text(text)) if Family::find(&text).is_some() => Family::find(&text),
            Some(other) => {
                let reason = format!("is {other}, expected one of {}", Family::names());
                return Err(Error::parameter("family", reason));
            }
            None => None,
        };
        let Some(family) = family else {
            let reason = format!("missing field, expected one of {}", Family::names());
            return Err(Error::parameter("family", reason));
        };
        known(family, &given, &["family"])?;
        Material::assign(name, family, given, folder)
    }

    /// Reads the parameters `given` of a material of `family`, as [`Material::read`] does.
    ///
    /// # Errors
    /// [`Error::Parameter`] for an unknown key and for values of a wrong type or number.
    pub fn assign(name: &str, family: Family, mut given: Fields, folder: &Path) -> Result<Material> {
        known(family, &given, &[])?;
        let mut parameters = Vec::with_capacity(family.parameters().len() + given.0.len());
        for parameter in family.parameters() {
            if let Some(field) = given.take(parameter.name) {
                let setting = Setting::read(parameter.name, parameter.kind, field, folder)?;
                parameters.push((parameter.name.to_string(), setting));
            } else if let Some(default) = parameter.default {
                let values = default.iter().copied().map(Scalar::Fixed).collect();
                parameters.push((parameter.name.to_string(), Setting::Numbers(values)));
            }
        }
        // What is left stands in the table of an imported file.
        for (key, field) in given.0 {
            let setting = Setting::read(&key, OPEN, field, folder)?;
            parameters.push((key, setting));
        }
        Ok(Material {
            name: name.to_string(),
            family,
            parameters,
        })
    }

    /// The values of the parameter called `name`.
    pub fn get(&self, name: &str) -> Option<&Setting> {
        self.parameters
            .iter()
            .find(|(key, _)| key == name)
            .map(|(_, s)| s)
    }

    /// What values its parameter called `name` takes.
    pub(crate) fn kind(&self, name: &str) -> Result<Kind> {
        match self.family.parameter(name) {
            Some(parameter) => Ok(parameter.kind),
            None if self.family.is_open() => Ok(OPEN),
            None => Err(unknown(self.family, name, &[])),
        }
    }

    /// Checks that everything is there, and every value and range.
    ///
    /// # Errors
    /// [`Error::Parameter`] with the first parameter that is missing, unknown, not a number, out of range, or has
    /// min > max.
    pub fn validate(&self) -> Result<()> {
        for (name, setting) in &self.parameters {
            setting.check(name, self.kind(name)?)?;
        }
        for parameter in self.family.parameters() {
            let other = parameter.instead_of.filter(|other| self.get(other).is_some());
            match (self.get(parameter.name), other) {
                (None, None) => {
                    let instead = parameter.instead_of.map(|o| format!(", or `{o}` in its place"));
                    let reason = format!(
                        "missing field, expected {}{}",
                        parameter.kind,
                        instead.unwrap_or_default()
                    );
                    return Err(Error::parameter(parameter.name, reason));
                }
                (Some(_), Some(other)) => {
                    let reason = format!("is given beside `{other}`; give one of the two");
                    return Err(Error::parameter(parameter.name, reason));
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// What the table of an imported file may name: any single number; the table knows its own ranges.
const OPEN: Kind = Kind::Numbers {
    components: 1,
    lowest: f64::MIN,
    highest: f64::MAX,
};

/// Checks that `family` has every key of `given`.
fn known(family: Family, given: &Fields, beside: &[&str]) -> Result<()> {
    let mut keys = given.0.iter().map(|(key, _)| key.as_str());
    match keys.find(|key| family.parameter(key).is_none()) {
        Some(key) if !family.is_open() => Err(unknown(family, key, beside)),
        _ => Ok(()),
    }
}

fn unknown(family: Family, key: &str, beside: &[&str]) -> Error {
    let names = family.parameters().iter().map(|p| p.name);
    let names = beside
        .iter()
        .copied()
        .chain(names)
        .map(|name| format!("`{name}`"));
    let reason = format!(
        "unknown field, expected one of {}",
        names.collect::<Vec<_>>().join(", ")
    );
    Error::parameter(key, reason)
}

impl Serialize for Material {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(2 + self.parameters.len()))?;
        map.serialize_entry("name", &self.name)?;
        map.serialize_entry("family", &self.family)?;
        for (name, setting) in &self.parameters {
            map.serialize_entry(name, setting)?;
        }
        map.end()
    }
}

impl<'de> Deserialize<'de> for Material {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let mut given = Fields::deserialize(deserializer)?;
        match given.take("name") {
            Some(Field::Text(name)) => Material::read(&name, given, Path::new("")).map_err(D::Error::custom),
            _ => Err(D::Error::missing_field("name")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The description in the networks that ship with version 0.1.0.
    const VASE: &str =
        r#"{"name":"vase","family":"conductor","alpha":[0.3,0.1],"reflectance":[1.0,0.782,0.344]}"#;

    fn parse(json: &str) -> Result<Material> {
        let material: Material =
            serde_json::from_str(json).map_err(|e| Error::parameter("JSON", e.to_string()))?;
        material.validate()?;
        Ok(material)
    }

    #[test]
    fn shipped_descriptions_load_and_come_back_byte_by_byte() {
        let free = VASE.replace("0.3,", r#"{"min":0.01,"max":1.0},"#);
        for text in [VASE, &free] {
            let material = parse(text).expect("a valid description");
            assert_eq!(serde_json::to_string(&material).expect("plain data"), text);
        }
        let made = Material::fixed(
            "vase",
            Family::Conductor,
            &[("alpha", &[0.3, 0.1]), ("reflectance", &[1.0, 0.782, 0.344])],
        )
        .expect("valid parameters");
        assert_eq!(parse(VASE).expect("a valid description"), made);
    }

    #[test]
    fn defaults_are_filled_in_and_order_does_not_matter() {
        let text =
            r#"{"roughness":0.25,"name":"plastic","metallic":{"min":0,"max":1},"family":"principled"}"#;
        let material = parse(text).expect("a valid description");
        let names: Vec<&str> = material
            .parameters
            .iter()
            .map(|(name, _)| name.as_str())
            .collect();
        let table: Vec<&str> = Family::Principled.parameters().iter().map(|p| p.name).collect();
        assert_eq!(names, table);
        assert_eq!(
            material.get("base_color"),
            Some(&Setting::Numbers(vec![Scalar::Fixed(0.5); 3]))
        );
        assert_eq!(material.free(), [("metallic".to_string(), 0.0, 1.0)]);
        let again = serde_json::to_string(&material).expect("plain data");
        assert_eq!(parse(&again).expect("its own output"), material);
    }

    #[test]
    fn metals_have_names_or_numbers() {
        let with = |ior: &str| VASE.replace(r#""reflectance":[1.0,0.782,0.344]"#, &format!(r#""ior":{ior}"#));
        let gold = parse(&with(r#""Au""#)).expect("a metal");
        let numbers = r#"{"eta":[0.143036,0.375307,1.442045],"k":[3.982997,2.385556,1.603359]}"#;
        assert_eq!(gold, parse(&with(numbers)).expect("its numbers"));
        assert_eq!(serde_json::to_string(&gold).expect("plain data"), with(numbers));
        let f0 = gold.reference().expect("fixed").base_color();
        assert!(f0.x > f0.y && f0.y > f0.z, "{f0}");
        for (ior, part) in [
            (r#""brass""#, "gold (Au)"),
            ("1.5", "is 1.5"),
            (r#"{"eta":[1,1,1]}"#, "`ior.k`"),
            (r#"{"eta":[1,1],"k":[1,1,1]}"#, "`ior.eta`"),
            (
                r#"{"eta":[0,1,1],"k":[1,1,1]}"#,
                "`ior.eta[0]`: is 0, but must lie in 0.001..100",
            ),
            (r#"{"eta":[1,{"min":1,"max":2},1],"k":[1,1,1]}"#, "`ior.eta[1]`"),
            (r#"{"eta":[1,1,1],"k":[1,1,1],"n":1}"#, "`ior`: unknown field `n`"),
        ] {
            let error = parse(&with(ior)).expect_err(ior).to_string();
            assert!(error.contains(part), "`{part}` is not in: {error}");
        }
        let both = parse(&with(r#""gold","reflectance":[1,1,1]"#))
            .expect_err("two")
            .to_string();
        assert!(both.contains("give one of the two"), "{both}");
        let neither = parse(&VASE.replace("reflectance", "unused"))
            .expect_err("none")
            .to_string();
        assert!(neither.contains("`unused`: unknown field"), "{neither}");
    }
}
