//! Single questions to a reference model or to a baked one: values, densities, samples and albedos at given
//! directions, as `bake query` answers them.

mod baked;
mod echo;
mod row;

pub use baked::Baked;
pub use echo::answered;
pub use row::{Ask, Row};

use crate::batch::{keyed_sample, mean_eval};
use crate::bsdf::Bsdf;
use crate::error::Result;
use crate::family::Family;
use crate::material::Material;
use crate::random::Rng;
use crate::reference::Reference;
use crate::setting::Setting;
use serde::Serialize;
use std::path::Path;

/// Evaluations behind a value of a stochastic model, and walks behind an albedo, where a row does not say.
pub const DEFAULT_SAMPLES: u64 = 1 << 14;

/// Key of what stands for the parameters in the keys of random numbers.
const PARAMS_KEY: u64 = 0x9a4a;

/// Who is asked.
pub enum Subject {
    /// A reference model; rows give all of its parameters that have no default.
    Family(Family),
    /// A material's reference model; rows give what the material leaves free.
    Material(Material),
    /// Baked networks; rows give what their material leaves free.
    Baked(Box<Baked>),
}

/// The answer to one row. In JSON an object with these keys.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Answer {
    /// To [`Ask::Eval`]. All zero where either direction is not above the horizon.
    Eval {
        /// f(wo, wi)·cos θ_i, RGB, sr⁻¹.
        f_cos: [f64; 3],
        /// Its standard error, RGB; zeros where nothing is random.
        se: [f64; 3],
        /// Density of `wi`, sr⁻¹.
        pdf: f64,
    },
    /// To [`Ask::Sample`]. No `wi` and zeros where nothing was drawn.
    Sample {
        /// Unit vector to the light.
        wi: Option<[f64; 3]>,
        /// f_cos / pdf, RGB, dimensionless; of one random walk where the model is stochastic.
        weight: [f64; 3],
        /// [`Bsdf::pdf`] of `wi`, sr⁻¹; only near the density of a random walk, see there.
        pdf: f64,
        /// Baked networks only: signed determinant of u ↦ solid angle, sr.
        #[serde(skip_serializing_if = "Option::is_none")]
        jacobian: Option<f64>,
    },
    /// To [`Ask::Albedo`].
    Albedo {
        /// ∫ f_cos dω_i, RGB.
        albedo: [f64; 3],
        /// Its standard error, RGB.
        se: [f64; 3],
    },
}

impl Subject {
    /// Answers `row` with random numbers that are keyed by `seed` and by the row itself: the same row has the same
    /// answer anywhere.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] for parameters that are unknown, missing, out of range, or contradict what is
    /// fixed; whatever a backend reports.
    pub fn answer(&self, row: &Row, seed: u64) -> Result<Answer> {
        let here = Path::new("");
        let material = match self {
            Subject::Baked(baked) => return baked.answer(row, seed),
            Subject::Family(family) => Material::assign(family.name(), *family, row.params.clone(), here)?,
            Subject::Material(material) => material.narrowed(row.params.clone(), here)?,
        };
        let seed = Rng::new(&[PARAMS_KEY, seed, key(&material)]).bits();
        Ok(ask_reference(&material.reference()?, row, seed))
    }
}

fn ask_reference(bsdf: &Reference, row: &Row, seed: u64) -> Answer {
    let samples = row.samples.unwrap_or(DEFAULT_SAMPLES);
    match row.ask {
        Ask::Eval { wi } => {
            let f_cos = mean_eval(bsdf, row.wo, wi, samples, seed);
            Answer::Eval {
                f_cos: f_cos.mean.to_array(),
                se: f_cos.se.to_array(),
                pdf: bsdf.pdf(row.wo, wi),
            }
        }
        Ask::Sample { u } => match keyed_sample(bsdf, row.wo, u, seed) {
            Some(sample) => Answer::Sample {
                wi: Some(sample.wi.to_array()),
                weight: sample.weight.to_array(),
                pdf: bsdf.pdf(row.wo, sample.wi),
                jacobian: None,
            },
            None => Answer::Sample {
                wi: None,
                weight: [0.0; 3],
                pdf: 0.0,
                jacobian: None,
            },
        },
        Ask::Albedo => {
            let albedo = bsdf.albedo(row.wo, samples, seed);
            Answer::Albedo {
                albedo: albedo.mean.to_array(),
                se: albedo.se.to_array(),
            }
        }
    }
}

/// A number that belongs to the values of the parameters, however they are written.
fn key(material: &Material) -> u64 {
    let mut bits = vec![material.family as u64];
    for (_, setting) in &material.parameters {
        match setting {
            Setting::Numbers(scalars) => bits.extend(
                scalars
                    .iter()
                    .map(|s| s.fixed().map_or(0, |value| value.to_bits())),
            ),
            Setting::Ior { eta, k } => bits.extend(eta.iter().chain(k).map(|v| v.to_bits())),
            // The same table may lie anywhere.
            Setting::File(_) => {}
        }
    }
    Rng::new(&bits).bits()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;

    fn ask(subject: &Subject, line: &str) -> Result<Answer> {
        subject.answer(&Row::parse(line)?, 1)
    }

    fn conductor(rest: &str) -> Result<Answer> {
        let params = r#""params": {"alpha": [0.3, 0.1], "reflectance": [1, 0.782, 0.344]}"#;
        ask(
            &Subject::Family(Family::Conductor),
            &format!("{{{params}, {rest}}}"),
        )
    }

    #[test]
    fn below_the_horizon_everything_is_zero() {
        for angles in [
            r#""wo": [91, 0], "wi": [30, 0]"#,
            r#""wo": [30, 0], "wi": [90, 7]"#,
        ] {
            let zero = Answer::Eval {
                f_cos: [0.0; 3],
                se: [0.0; 3],
                pdf: 0.0,
            };
            assert_eq!(conductor(angles).expect("a valid row"), zero);
        }
        let nothing = Answer::Sample {
            wi: None,
            weight: [0.0; 3],
            pdf: 0.0,
            jacobian: None,
        };
        assert_eq!(
            conductor(r#""wo": [120, 0], "u": [0.5, 0.5]"#).expect("a valid row"),
            nothing
        );
        let black = Answer::Albedo {
            albedo: [0.0; 3],
            se: [0.0; 3],
        };
        assert_eq!(
            conductor(r#""wo": [120, 0], "albedo": true"#).expect("a valid row"),
            black
        );
    }

    #[test]
    fn answers_belong_to_the_row() {
        let line = r#""wo": [45, 0], "wi": [30, 180], "samples": 100"#;
        let first = conductor(line).expect("a valid row");
        assert_eq!(conductor(line).expect("a valid row"), first);
        // The same parameters given by a material, and in another order.
        let given: &[(&str, &[f64])] = &[("reflectance", &[1.0, 0.782, 0.344]), ("alpha", &[0.3, 0.1])];
        let gold = Material::fixed("gold", Family::Conductor, given).expect("valid parameters");
        let gold = Subject::Material(gold);
        assert_eq!(ask(&gold, &format!("{{{line}}}")).expect("a valid row"), first);
        assert_ne!(
            gold.answer(&Row::parse(&format!("{{{line}}}")).expect("valid"), 2)
                .expect("valid"),
            first
        );
        let error = ask(
            &gold,
            &format!(r#"{{{line}, "params": {{"alpha": [0.3, 0.2]}}}}"#),
        );
        assert!(matches!(error, Err(Error::Parameter { name, .. }) if name == "alpha[1]"));
    }

    #[test]
    fn answers_are_json_objects_with_their_keys() {
        let json = |rest: &str| serde_json::to_value(conductor(rest).expect("a valid row")).expect("numbers");
        let keys = |value: serde_json::Value| {
            value
                .as_object()
                .expect("an object")
                .keys()
                .cloned()
                .collect::<Vec<_>>()
        };
        assert_eq!(
            keys(json(r#""wo": [45, 0], "wi": [30, 180]"#)),
            ["f_cos", "pdf", "se"]
        );
        assert_eq!(
            keys(json(r#""wo": [45, 0], "u": [0.1, 0.9]"#)),
            ["pdf", "weight", "wi"]
        );
        assert_eq!(keys(json(r#""wo": [45, 0], "albedo": true"#)), ["albedo", "se"]);
    }
}
