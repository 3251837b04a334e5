//! A material: a family, its fixed parameters and its free ranges. The description that a bake starts from
//! and that every baked file carries.

use crate::conductor::Conductor;
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// The families of reference models.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// Multiple-scattering Smith GGX conductor (Heitz et al. 2016).
    Conductor,
}

impl Family {
    /// The name in material files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Family::Conductor => "conductor",
        }
    }
}

/// One scalar parameter: fixed, or free over a range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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

/// A named material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// The name that files and reports use.
    pub name: String,
    /// The reference model.
    pub family: Family,
    /// Roughness along x and y of the shading frame, in `[ALPHA_MIN, 1]`.
    pub alpha: [Scalar; 2],
    /// Schlick reflectance at normal incidence (F0), RGB, in `[0, 1]`.
    pub reflectance: [Scalar; 3],
}

impl Material {
    /// Checks every value and range.
    ///
    /// # Errors
    /// [`Error::Parameter`] with the first parameter that is not a number, out of range, or has min > max.
    pub fn validate(&self) -> Result<()> {
        for (i, scalar) in self.alpha.iter().enumerate() {
            scalar.check(&format!("alpha[{i}]"), Conductor::ALPHA_MIN, 1.0)?;
        }
        for (i, scalar) in self.reflectance.iter().enumerate() {
            scalar.check(&format!("reflectance[{i}]"), 0.0, 1.0)?;
        }
        Ok(())
    }

    /// The reference model with every parameter fixed.
    ///
    /// # Errors
    /// [`Error::Parameter`] where [`Material::validate`] fails or a parameter is free.
    pub fn reference(&self) -> Result<Conductor> {
        self.validate()?;
        let fixed = |name: String, scalar: &Scalar| match *scalar {
            Scalar::Fixed(value) => Ok(value),
            Scalar::Free { min, max } if min == max => Ok(min),
            Scalar::Free { min, max } => Err(Error::parameter(
                name,
                format!("is free over {min}..{max}; only wo may be free so far, so give it one value"),
            )),
        };
        Conductor::new(
            [
                fixed("alpha[0]".into(), &self.alpha[0])?,
                fixed("alpha[1]".into(), &self.alpha[1])?,
            ],
            [
                fixed("reflectance[0]".into(), &self.reflectance[0])?,
                fixed("reflectance[1]".into(), &self.reflectance[1])?,
                fixed("reflectance[2]".into(), &self.reflectance[2])?,
            ],
        )
    }
}

impl Scalar {
    fn check(&self, name: &str, lowest: f64, highest: f64) -> Result<()> {
        let inside = |value: f64| {
            if (lowest..=highest).contains(&value) {
                Ok(())
            } else {
                Err(Error::parameter(
                    name,
                    format!("is {value}, but must lie in {lowest}..{highest}"),
                ))
            }
        };
        match *self {
            Scalar::Fixed(value) => inside(value),
            Scalar::Free { min, max } => {
                inside(min)?;
                inside(max)?;
                if min > max {
                    return Err(Error::parameter(
                        name,
                        format!("range has min {min} > max {max}; swap them"),
                    ));
                }
                Ok(())
            }
        }
    }
}
