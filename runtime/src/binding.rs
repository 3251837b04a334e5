//! From a material with free ranges to one whose every parameter has a value, and to its reference model.

use crate::error::{Error, Result, check, component};
use crate::family::Kind;
use crate::field::Fields;
use crate::material::Material;
use crate::reference::Reference;
use crate::setting::{Scalar, Setting};
use std::path::Path;

impl Material {
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

    /// This material with the values `given` for its free scalars; fixed ones may be given again, but not changed.
    /// Names of files are relative to `folder`.
    ///
    /// # Errors
    /// [`Error::Parameter`] for an unknown parameter, one that is no number or leaves its free range, and one that
    /// contradicts what the material fixes.
    pub fn narrowed(&self, given: Fields, folder: &Path) -> Result<Material> {
        let mut narrowed = self.clone();
        for (key, field) in given.0 {
            let setting = Setting::read(&key, self.kind(&key)?, field, folder)?;
            let own = narrowed.parameters.iter_mut().find(|(name, _)| *name == key);
            let Some((_, own)) = own else {
                let reason = format!("material `{}` gives another parameter in its place", self.name);
                return Err(Error::parameter(key, reason));
            };
            if own.scalars().is_empty() && *own != setting {
                let reason = format!("differs from what material `{}` fixes", self.name);
                return Err(Error::parameter(key, reason));
            }
            for (i, (own, scalar)) in own.scalars_mut().iter_mut().zip(setting.scalars()).enumerate() {
                let label = || setting.label(&key, i);
                let value = scalar
                    .fixed()
                    .map_err(|reason| Error::parameter(label(), reason))?;
                match own {
                    Scalar::Free { min, max } => check(&label(), &[value], *min, *max)?,
                    Scalar::Fixed(fixed) if *fixed == value => {}
                    Scalar::Fixed(fixed) => {
                        let reason = format!("is {value}, but material `{}` fixes it at {fixed}", self.name);
                        return Err(Error::parameter(label(), reason));
                    }
                }
                *own = Scalar::Fixed(value);
            }
        }
        Ok(narrowed)
    }

    /// This material with the values `given` in place of its own, fixed or free. Names of files are relative to
    /// `folder`.
    ///
    /// # Errors
    /// [`Error::Parameter`] for an unknown parameter and for values of a wrong type or number; ranges are left to
    /// [`Material::validate`].
    pub fn replaced(&self, given: Fields, folder: &Path) -> Result<Material> {
        let mut replaced = self.clone();
        for (key, field) in given.0 {
            let setting = Setting::read(&key, self.kind(&key)?, field, folder)?;
            let other = self.family.parameter(&key).and_then(|p| p.instead_of);
            let own = replaced
                .parameters
                .iter_mut()
                .find(|(name, _)| *name == key || Some(name.as_str()) == other);
            match own {
                Some(own) => *own = (key, setting),
                None => replaced.parameters.push((key, setting)),
            }
        }
        Ok(replaced)
    }

    /// This material with everything free that may be, over the family's whole ranges.
    pub fn widest(&self) -> Material {
        let mut widest = self.clone();
        for (name, setting) in &mut widest.parameters {
            let kind = self.family.parameter(name).map(|p| p.kind);
            if let Some(Kind::Numbers { lowest, highest, .. }) = kind {
                let free = Scalar::Free {
                    min: lowest,
                    max: highest,
                };
                setting.scalars_mut().fill(free);
            }
        }
        widest
    }

    /// This material with the middle of its range for every free scalar.
    pub fn middle(&self) -> Material {
        let mut middle = self.clone();
        for scalar in middle.parameters.iter_mut().flat_map(|(_, s)| s.scalars_mut()) {
            if let Some((min, max)) = scalar.range() {
                *scalar = Scalar::Fixed(0.5 * (min + max));
            }
        }
        middle
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

    /// The `N` fixed values of the parameter called `name`.
    ///
    /// # Errors
    /// [`Error::Parameter`] when it is free or not there.
    pub(crate) fn numbers<const N: usize>(&self, name: &str) -> Result<[f64; N]> {
        let scalars = self.get(name).map_or(&[][..], Setting::scalars);
        let mut values = [0.0; N];
        for (i, value) in values.iter_mut().enumerate() {
            let label = || component(name, i, N);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::family::Family;

    fn conductor(alpha: [Scalar; 2], reflectance: [Scalar; 3]) -> Material {
        Material {
            name: "metal".into(),
            family: Family::Conductor,
            parameters: vec![
                ("alpha".into(), Setting::Numbers(alpha.to_vec())),
                ("reflectance".into(), Setting::Numbers(reflectance.to_vec())),
            ],
        }
    }

    /// Free in `alpha[0]` and `reflectance[2]`.
    fn gold() -> Material {
        let [y, r, g] = [0.1, 1.0, 0.782].map(Scalar::Fixed);
        let (x, b) = (
            Scalar::Free { min: 0.01, max: 0.5 },
            Scalar::Free { min: 0.2, max: 0.4 },
        );
        conductor([x, y], [r, g, b])
    }

    fn fields(json: &str) -> Fields {
        serde_json::from_str(json).expect("valid JSON")
    }

    fn refused<T: std::fmt::Debug>(result: Result<T>, parts: &[&str]) {
        let error = result.expect_err("it must be refused").to_string();
        for part in parts {
            assert!(error.contains(part), "`{part}` is not in: {error}");
        }
    }

    #[test]
    fn free_ranges_are_bound_in_order() {
        let material = gold();
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
        refused(material.reference(), &["`alpha[0]`: is free over 0.01..0.5"]);
    }

    #[test]
    fn rows_give_what_is_free_and_may_repeat_what_is_fixed() {
        let whole = fields(r#"{"alpha": [0.2, 0.1], "reflectance": [1, 0.782, 0.3]}"#);
        let narrowed = gold().narrowed(whole, Path::new("")).expect("within the ranges");
        let bound = gold().bind(&[0.2, 0.3]).expect("within the ranges");
        let reference = narrowed.reference().expect("nothing is free");
        assert_eq!(reference.as_conductor(), bound.as_conductor());
        for (json, parts) in [
            (
                r#"{"alpha": [0.6, 0.1]}"#,
                &["`alpha[0]`", "is 0.6", "0.01..0.5"][..],
            ),
            (
                r#"{"alpha": [0.2, 0.2]}"#,
                &["`alpha[1]`", "is 0.2", "`metal` fixes it at 0.1"],
            ),
            (r#"{"alpha": [0.2]}"#, &["`alpha`", "length 2"]),
            (r#"{"roughness": 0.2}"#, &["`roughness`", "unknown", "`alpha`"]),
            (r#"{"ior": "gold"}"#, &["`ior`", "another parameter in its place"]),
            (
                r#"{"alpha": [{"min": 0.1, "max": 0.2}, 0.1]}"#,
                &["`alpha[0]`", "give it one value"],
            ),
        ] {
            refused(gold().narrowed(fields(json), Path::new("")), parts);
        }
        let partly = gold().narrowed(fields(r#"{"alpha": [0.2, 0.1]}"#), Path::new(""));
        refused(
            partly.and_then(|m| m.reference()),
            &["`reflectance[2]`", "is free"],
        );
    }

    #[test]
    fn replacing_changes_fixed_and_free_values() {
        let given = fields(r#"{"alpha": [1, 1], "ior": "silver"}"#);
        let replaced = gold().replaced(given, Path::new("")).expect("known parameters");
        let reference = replaced.reference().expect("nothing is free");
        assert_eq!(reference.as_conductor().expect("a conductor").alpha, [1.0; 2]);
        assert!(replaced.get("reflectance").is_none());
        refused(
            gold().replaced(fields(r#"{"metallic": 1}"#), Path::new("")),
            &["`metallic`", "unknown"],
        );
        let beyond = gold().replaced(fields(r#"{"alpha": [2, 1]}"#), Path::new(""));
        refused(beyond.and_then(|m| m.validate()), &["`alpha[0]`", "is 2"]);
    }

    #[test]
    fn the_middle_of_every_range() {
        let middle = gold().middle();
        assert!(middle.free().is_empty());
        let alpha = Setting::Numbers(vec![Scalar::Fixed(0.255), Scalar::Fixed(0.1)]);
        assert_eq!(middle.get("alpha"), Some(&alpha));
    }
}
