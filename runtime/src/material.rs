//! A material: a family, its fixed parameters and its free ranges. The description that a bake starts from
//! and that every baked file carries.

use crate::conductor::Conductor;
use crate::error::{Error, Result, check};
use crate::family::{Family, Kind};
use crate::field::{Field, Fields};
use crate::reference::Reference;
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

    /// Checks that everything is there, and every value and range.
    ///
    /// # Errors
    /// [`Error::Parameter`] with the first parameter that is missing, unknown, not a number, out of range, or has
    /// min > max.
    pub fn validate(&self) -> Result<()> {
        for (name, setting) in &self.parameters {
            let kind = match self.family.parameter(name) {
                Some(parameter) => parameter.kind,
                None if self.family.is_open() => OPEN,
                None => return Err(unknown(self.family, name, &[])),
            };
            setting.check(name, kind)?;
        }
        for parameter in self.family.parameters() {
            let other = parameter.instead_of.filter(|other| self.get(other).is_some());
            match (self.get(parameter.name), other) {
                (None, None) => {
                    let reason = format!("missing field, expected {}", parameter.domain());
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

    /// The free scalars in order, as `(name, min, max)`, e.g. `alpha[0]`.
    pub fn free(&self) -> Vec<(String, f64, f64)> {
        let mut free = Vec::new();
        for (name, setting) in &self.parameters {
            for (i, scalar) in setting.scalars().iter().enumerate() {
                if let Some((min, max)) = scalar.range() {
                    free.push((setting.label(name, i), min, max));
                }
            }
        }
        free
    }

    /// The reference model at one point of the free ranges: `values` in the order of [`Material::free`].
    ///
    /// # Errors
    /// [`Error::Parameter`] where [`Material::validate`] fails, a value leaves its range, or their number is wrong.
    pub fn bind(&self, values: &[f64]) -> Result<Reference> {
        let mut bound = self.clone();
        let mut values_left = values.iter();
        for (name, setting) in &mut bound.parameters {
            let labels: Vec<String> = (0..setting.scalars().len())
                .map(|i| setting.label(name, i))
                .collect();
            for (scalar, label) in setting.scalars_mut().iter_mut().zip(labels) {
                let Some((min, max)) = scalar.range() else {
                    continue;
                };
                let Some(&value) = values_left.next() else {
                    return Err(Error::parameter(label, "is free, but has no value"));
                };
                check(&label, &[value], min, max)?;
                *scalar = Scalar::Fixed(value);
            }
        }
        match values_left.len() {
            0 => bound.reference(),
            more => Err(Error::parameter(
                "values",
                format!("there are {more} more than free parameters"),
            )),
        }
    }

    /// The reference model with every parameter fixed.
    ///
    /// # Errors
    /// [`Error::Parameter`] where [`Material::validate`] fails or a parameter is free; an imported table's own.
    pub fn reference(&self) -> Result<Reference> {
        self.validate()?;
        Reference::new(self)
    }

    /// The reference model of a conductor with every parameter fixed: what can be baked so far.
    ///
    /// # Errors
    /// [`Error::Parameter`] for another family, and as [`Material::reference`].
    pub fn conductor(&self) -> Result<Conductor> {
        let refused = || {
            let reason = format!(
                "is \"{}\", but only materials of the family `conductor` can be baked so far",
                self.family.name()
            );
            Error::parameter("family", reason)
        };
        // The family first: other families may have ranges of their own to complain about.
        if self.family != Family::Conductor {
            return Err(refused());
        }
        match self.reference()? {
            Reference::Conductor(conductor) => Ok(conductor),
            _ => Err(refused()),
        }
    }

    /// The `N` fixed values of the parameter called `name`.
    ///
    /// # Errors
    /// [`Error::Parameter`] when it is free or not there.
    pub(crate) fn numbers<const N: usize>(&self, name: &str) -> Result<[f64; N]> {
        let scalars = self.get(name).map_or(&[][..], Setting::scalars);
        let mut values = [0.0; N];
        for (i, value) in values.iter_mut().enumerate() {
            let label = || {
                if N == 1 {
                    name.to_string()
                } else {
                    format!("{name}[{i}]")
                }
            };
            *value = match scalars.get(i) {
                None => return Err(Error::parameter(label(), "missing field")),
                Some(scalar) => scalar
                    .fixed()
                    .map_err(|reason| Error::parameter(label(), reason))?,
            };
        }
        Ok(values)
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
        assert_eq!(made.conductor().expect("fixed").alpha, [0.3, 0.1]);
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
    fn free_ranges_are_bound_in_order() {
        let text = VASE
            .replace("0.3,", r#"{"min":0.01,"max":0.5},"#)
            .replace("0.344", r#"{"min":0.2,"max":0.4}"#);
        let material = parse(&text).expect("a valid description");
        let names: Vec<String> = material.free().into_iter().map(|(name, ..)| name).collect();
        assert_eq!(names, ["alpha[0]", "reflectance[2]"]);
        let bound = material.bind(&[0.2, 0.3]).expect("within the ranges");
        let conductor = bound.as_conductor().expect("a conductor");
        assert_eq!((conductor.alpha, bound.base_color().z), ([0.2, 0.1], 0.3));
        for (values, name) in [
            (&[0.2][..], "reflectance[2]"),
            (&[0.6, 0.3], "alpha[0]"),
            (&[0.2, f64::NAN], "reflectance[2]"),
            (&[0.2, 0.3, 0.4], "values"),
        ] {
            match material.bind(values) {
                Err(Error::Parameter { name: found, .. }) => assert_eq!(found, name),
                other => panic!("{values:?} gave {other:?}"),
            }
        }
        let error = material.reference().expect_err("it has free ranges").to_string();
        assert!(error.contains("`alpha[0]`: is free over 0.01..0.5"), "{error}");
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

    #[test]
    fn only_conductors_can_be_baked() {
        let plastic = Material::fixed("plastic", Family::Principled, &[]).expect("all defaults");
        let error = plastic.conductor().expect_err("another family").to_string();
        assert!(error.contains("`family`: is \"principled\""), "{error}");
    }
}
