//! The values of one parameter of a material, how they are read, and what is said when they are wrong.

use crate::conductor::Conductor;
use crate::error::{Error, Result, check, component};
use crate::family::Kind;
use crate::field::{Field, Fields};
use crate::metals;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// One scalar: fixed, or free over a range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Scalar {
    /// The scene fixes it.
    Fixed(f64),
    /// The networks must cover `min..=max`.
    Free {
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
    },
}

/// The values of one parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Setting {
    /// Numbers, as many as the parameter has components.
    Numbers(Vec<Scalar>),
    /// A complex index of refraction, linear RGB.
    Ior {
        /// Real parts.
        eta: [f64; 3],
        /// Extinction coefficients.
        k: [f64; 3],
    },
    /// A file.
    File(PathBuf),
}

impl Scalar {
    /// The range of a free scalar; `None` where only one value is left.
    pub fn range(self) -> Option<(f64, f64)> {
        match self {
            Scalar::Free { min, max } if min != max => Some((min, max)),
            _ => None,
        }
    }

    /// The value of a fixed scalar, or what to say of a free one.
    pub fn fixed(self) -> std::result::Result<f64, String> {
        match (self, self.range()) {
            (_, Some((min, max))) => Err(format!("is free over {min}..{max}, so give it one value")),
            (Scalar::Fixed(value) | Scalar::Free { min: value, .. }, None) => Ok(value),
        }
    }

    fn check(self, name: &str, lowest: f64, highest: f64) -> Result<()> {
        match self {
            Scalar::Fixed(value) => check(name, &[value], lowest, highest),
            Scalar::Free { min, max } => {
                check(name, &[min], lowest, highest)?;
                check(name, &[max], lowest, highest)?;
                match min > max {
                    true => {
                        let reason = format!("range has min {min} > max {max}; swap them");
                        Err(Error::parameter(name, reason))
                    }
                    false => Ok(()),
                }
            }
        }
    }
}

impl Setting {
    /// Reads the value `field` of the parameter called `name`; names of files are relative to `folder`.
    pub(crate) fn read(name: &str, kind: Kind, field: Field, folder: &Path) -> Result<Setting> {
        match kind {
            Kind::Numbers { components: 1, .. } => Ok(Setting::Numbers(vec![read_scalar(name, field)?])),
            Kind::Numbers { components, .. } => match field {
                Field::List(items) if items.len() == components => {
                    let scalars = items
                        .into_iter()
                        .enumerate()
                        .map(|(i, item)| read_scalar(&format!("{name}[{i}]"), item));
                    Ok(Setting::Numbers(scalars.collect::<Result<_>>()?))
                }
                other => Err(wrong(name, &other, format!("an array of length {components}"))),
            },
            Kind::Ior => read_ior(name, field),
            Kind::File => match field {
                Field::Text(text) => Ok(Setting::File(folder.join(text))),
                other => Err(wrong(name, &other, kind)),
            },
        }
    }

    /// Checks the values of the parameter called `name` against its kind.
    pub(crate) fn check(&self, name: &str, kind: Kind) -> Result<()> {
        match (self, kind) {
            (
                Setting::Numbers(scalars),
                Kind::Numbers {
                    components,
                    lowest,
                    highest,
                },
            ) if scalars.len() == components => {
                let mut labelled = scalars.iter().enumerate();
                labelled.try_for_each(|(i, scalar)| scalar.check(&self.label(name, i), lowest, highest))
            }
            (Setting::Ior { eta, k }, Kind::Ior) => {
                check(
                    &format!("{name}.eta"),
                    eta,
                    Conductor::IOR_MIN,
                    Conductor::IOR_MAX,
                )?;
                check(&format!("{name}.k"), k, 0.0, Conductor::IOR_MAX)
            }
            (Setting::File(_), Kind::File) => Ok(()),
            _ => Err(Error::parameter(name, format!("expected {kind}"))),
        }
    }

    /// Its scalars; only numbers have any.
    pub fn scalars(&self) -> &[Scalar] {
        match self {
            Setting::Numbers(scalars) => scalars,
            Setting::Ior { .. } | Setting::File(_) => &[],
        }
    }

    /// Its scalars, to be replaced.
    pub(crate) fn scalars_mut(&mut self) -> &mut [Scalar] {
        match self {
            Setting::Numbers(scalars) => scalars,
            Setting::Ior { .. } | Setting::File(_) => &mut [],
        }
    }

    /// What errors call scalar `i` of this setting of the parameter `name`: `g`, `alpha[0]`.
    pub fn label(&self, name: &str, i: usize) -> String {
        component(name, i, self.scalars().len())
    }
}

impl Serialize for Setting {
    /// One number stands alone, several in a list; an index of refraction as its numbers.
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Ior<'a> {
            eta: &'a [f64; 3],
            k: &'a [f64; 3],
        }
        match self {
            Setting::Numbers(scalars) => match scalars.as_slice() {
                [one] => one.serialize(serializer),
                several => several.serialize(serializer),
            },
            Setting::Ior { eta, k } => Ior { eta, k }.serialize(serializer),
            Setting::File(path) => path.serialize(serializer),
        }
    }
}

fn wrong(name: &str, found: &Field, expected: impl std::fmt::Display) -> Error {
    Error::parameter(name, format!("is {found}, expected {expected}"))
}

fn read_scalar(name: &str, field: Field) -> Result<Scalar> {
    match field {
        Field::Number(value) => Ok(Scalar::Fixed(value)),
        Field::Table(mut range) => {
            let mut bound = |key: &str| match range.take(key) {
                Some(Field::Number(value)) => Ok(value),
                Some(other) => Err(wrong(&format!("{name}.{key}"), &other, "a number")),
                None => Err(Error::parameter(
                    name,
                    format!("missing field `{key}` of the range"),
                )),
            };
            let (min, max) = (bound("min")?, bound("max")?);
            nothing_left(name, &range, "`min` and `max`")?;
            Ok(Scalar::Free { min, max })
        }
        other => Err(wrong(
            name,
            &other,
            "a number or a range { min = number, max = number }",
        )),
    }
}

fn read_ior(name: &str, field: Field) -> Result<Setting> {
    match field {
        Field::Text(text) => match metals::find(&text) {
            Some(metal) => Ok(Setting::Ior {
                eta: metal.eta,
                k: metal.k,
            }),
            None => Err(wrong(name, &Field::Text(text), Kind::Ior)),
        },
        Field::Table(mut table) => {
            let mut rgb = |key: &str| -> Result<[f64; 3]> {
                let label = format!("{name}.{key}");
                match table.take(key) {
                    Some(Field::List(items)) if items.len() == 3 => {
                        let mut values = [0.0; 3];
                        for (i, (value, item)) in values.iter_mut().zip(items).enumerate() {
                            *value = match item {
                                Field::Number(number) => number,
                                other => {
                                    let expected = "a number; an index of refraction is always fixed";
                                    return Err(wrong(&format!("{label}[{i}]"), &other, expected));
                                }
                            };
                        }
                        Ok(values)
                    }
                    Some(other) => Err(wrong(&label, &other, "an array of length 3")),
                    None => Err(Error::parameter(label, "missing field, expected 3 numbers")),
                }
            };
            let (eta, k) = (rgb("eta")?, rgb("k")?);
            nothing_left(name, &table, "`eta` and `k`")?;
            Ok(Setting::Ior { eta, k })
        }
        other => Err(wrong(name, &other, Kind::Ior)),
    }
}

fn nothing_left(name: &str, Fields(left): &Fields, expected: &str) -> Result<()> {
    match left.first() {
        Some((key, _)) => {
            let reason = format!("unknown field `{key}`, expected {expected}");
            Err(Error::parameter(name, reason))
        }
        None => Ok(()),
    }
}
