//! The families of reference models, and what parameters each has: the one table that material files, queries,
//! error messages and the help of the command line are made from.

use crate::conductor::Conductor;
use crate::layered::Layered;
use crate::metals;
use serde::{Deserialize, Serialize};
use std::fmt;

/// The families of reference models.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// Multiple-scattering Smith GGX conductor (Heitz et al. 2016).
    Conductor,
    /// A rough dielectric over a homogeneous slab over a diffuse base (Guo et al. 2018).
    Layered,
    /// The Disney BRDF as Mitsuba 3.9.1's `principled` has it, reflection only.
    Principled,
    /// Tabulated slices from a file.
    Imported,
}

/// What values a parameter takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Numbers, each in `lowest..=highest`; one number stands alone, several in a list. Each may be left free.
    Numbers {
        /// How many.
        components: usize,
        /// Smallest value.
        lowest: f64,
        /// Largest value.
        highest: f64,
    },
    /// A complex index of refraction: the name of a metal, or `{ eta = [r, g, b], k = [r, g, b] }`. Always fixed.
    Ior,
    /// The name of a file, relative to the material file. Always fixed.
    File,
}

/// One parameter of a family.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// The name in files, rows and errors.
    pub name: &'static str,
    /// What values it takes.
    pub kind: Kind,
    /// The values of what is not given; a parameter without them must be given.
    pub default: Option<&'static [f64]>,
    /// Another parameter that may be given instead: exactly one of the two must be.
    pub instead_of: Option<&'static str>,
    /// Meaning and unit, a phrase without a full stop.
    pub doc: &'static str,
}

impl Family {
    /// All families.
    pub const ALL: [Family; 4] = [
        Family::Conductor,
        Family::Layered,
        Family::Principled,
        Family::Imported,
    ];

    /// The name in material files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Family::Conductor => "conductor",
            Family::Layered => "layered",
            Family::Principled => "principled",
            Family::Imported => "imported",
        }
    }

    /// The family called `name`.
    pub fn find(name: &str) -> Option<Family> {
        Family::ALL.into_iter().find(|family| family.name() == name)
    }

    /// What it models and after whom, a phrase without a full stop.
    pub fn doc(self) -> &'static str {
        match self {
            Family::Conductor => "multiple-scattering anisotropic Smith GGX metal (Heitz et al. 2016)",
            Family::Layered => {
                "rough dielectric interface over a homogeneous slab over a diffuse base, position-free Monte Carlo \
                 (Guo et al. 2018)"
            }
            Family::Principled => "Disney's BRDF as Mitsuba 3.9.1 has it, reflection only (Burley 2012)",
            Family::Imported => "slices of any renderer's or measured BSDF, read from a safetensors file",
        }
    }

    /// Its parameters, in the order in which files and networks have them.
    ///
    /// [`Family::Imported`] takes those that its file names besides.
    pub fn parameters(self) -> &'static [Parameter] {
        match self {
            Family::Conductor => &CONDUCTOR,
            Family::Layered => &LAYERED,
            Family::Principled => &PRINCIPLED,
            Family::Imported => &IMPORTED,
        }
    }

    /// The parameter called `name`.
    pub fn parameter(self, name: &str) -> Option<&'static Parameter> {
        self.parameters().iter().find(|p| p.name == name)
    }

    /// Whether a file names parameters that the table does not.
    pub fn is_open(self) -> bool {
        self == Family::Imported
    }

    /// The names of all families, for errors: `` `conductor`, `layered`, … ``.
    pub fn names() -> String {
        Family::ALL.map(|f| format!("`{}`", f.name())).join(", ")
    }
}

impl Parameter {
    /// What it may be, with its default: `2 numbers in 0.0001..1, must be given`.
    pub fn domain(&self) -> String {
        let default = match (self.default, self.instead_of) {
            (Some([one]), _) => format!("default {one}"),
            (Some(several), _) => format!("default {several:?}"),
            (None, Some(other)) => format!("or `{other}` in its place"),
            (None, None) => "must be given".into(),
        };
        format!("{}, {default}", self.kind)
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match *self {
            Kind::Numbers {
                components,
                lowest,
                highest,
            } => match components {
                1 => write!(f, "a number in {lowest}..{highest}"),
                n => write!(f, "{n} numbers in {lowest}..{highest}"),
            },
            Kind::Ior => write!(
                f,
                "{{ eta = [r, g, b] in {}..{m}, k = [r, g, b] in 0..{m} }} or one of {}",
                Conductor::IOR_MIN,
                metals::names(),
                m = Conductor::IOR_MAX
            ),
            Kind::File => f.write_str("the name of a file"),
        }
    }
}

/// `components` numbers in `lowest..=highest`, without a default.
const fn required(
    name: &'static str,
    components: usize,
    [lowest, highest]: [f64; 2],
    doc: &'static str,
) -> Parameter {
    Parameter {
        name,
        kind: Kind::Numbers {
            components,
            lowest,
            highest,
        },
        default: None,
        instead_of: None,
        doc,
    }
}

/// Numbers in `lowest..=highest`, as many as their defaults.
const fn optional(
    name: &'static str,
    default: &'static [f64],
    range: [f64; 2],
    doc: &'static str,
) -> Parameter {
    Parameter {
        default: Some(default),
        ..required(name, default.len(), range, doc)
    }
}

const CONDUCTOR: [Parameter; 3] = [
    required(
        "alpha",
        2,
        [Conductor::ALPHA_MIN, 1.0],
        "GGX roughness along x and y of the shading frame, as the microfacet model takes it",
    ),
    Parameter {
        instead_of: Some("ior"),
        ..required(
            "reflectance",
            3,
            [0.0, 1.0],
            "Schlick reflectance at normal incidence (F0), linear RGB",
        )
    },
    Parameter {
        name: "ior",
        kind: Kind::Ior,
        default: None,
        instead_of: Some("reflectance"),
        doc: "complex index of refraction eta + i·k, linear RGB, or the name of a metal; always fixed",
    },
];

const LAYERED: [Parameter; 6] = [
    required(
        "alpha",
        1,
        [Layered::ALPHA_MIN, 1.0],
        "GGX roughness of the interface, as the microfacet model takes it",
    ),
    optional(
        "eta",
        &[1.5],
        [Layered::ETA_MIN, Layered::ETA_MAX],
        "index of refraction of the slab over that of what is above it; 1 means no interface",
    ),
    required(
        "sigma_t",
        1,
        [0.0, Layered::SIGMA_T_MAX],
        "vertical optical depth of the slab, mean free paths",
    ),
    required(
        "albedo",
        3,
        [0.0, 1.0],
        "single-scattering albedo of the slab, linear RGB",
    ),
    required(
        "base",
        3,
        [0.0, 1.0],
        "reflectance of the diffuse base, linear RGB",
    ),
    optional(
        "g",
        &[0.0],
        [-Layered::G_MAX, Layered::G_MAX],
        "mean cosine of scattering in the slab (Henyey–Greenstein)",
    ),
];

/// The range of nearly all of Disney's parameters.
const UNIT: [f64; 2] = [0.0, 1.0];

/// Defaults are those of Mitsuba 3.9.1.
const PRINCIPLED: [Parameter; 11] = [
    optional(
        "base_color",
        &[0.5, 0.5, 0.5],
        UNIT,
        "colour of the surface, linear RGB",
    ),
    optional(
        "metallic",
        &[0.0],
        UNIT,
        "share of metal in the mix with a dielectric",
    ),
    optional(
        "roughness",
        &[0.5],
        UNIT,
        "perceptual roughness; alpha is its square",
    ),
    optional(
        "specular",
        &[0.5],
        UNIT,
        "strength of the dielectric reflection; 0.5 is an index of 1.5",
    ),
    optional(
        "specular_tint",
        &[0.0],
        UNIT,
        "share of the base colour in the dielectric reflection",
    ),
    optional(
        "anisotropic",
        &[0.0],
        UNIT,
        "how much longer highlights are along x than along y",
    ),
    optional(
        "sheen",
        &[0.0],
        UNIT,
        "strength of the retroreflection at grazing angles",
    ),
    optional(
        "sheen_tint",
        &[0.0],
        UNIT,
        "share of the base colour in the sheen",
    ),
    optional(
        "clearcoat",
        &[0.0],
        UNIT,
        "strength of a second, clear reflection",
    ),
    optional("clearcoat_gloss", &[0.0], UNIT, "gloss of the clear coat"),
    optional(
        "flatness",
        &[0.0],
        UNIT,
        "share of the subsurface approximation in the diffuse reflection",
    ),
];

const IMPORTED: [Parameter; 1] = [Parameter {
    name: "file",
    kind: Kind::File,
    default: None,
    instead_of: None,
    doc: "safetensors file with the slices, relative to the material file; its own parameters are numbers beside it",
}];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_consistent() {
        for family in Family::ALL {
            assert_eq!(Family::find(family.name()), Some(family));
            for parameter in family.parameters() {
                let what = format!("{} of {}", parameter.name, family.name());
                assert_eq!(
                    family.parameter(parameter.name),
                    Some(parameter),
                    "{what} is there twice"
                );
                assert!(
                    !parameter.doc.is_empty() && !parameter.doc.ends_with('.'),
                    "{what}"
                );
                if let (
                    Kind::Numbers {
                        components,
                        lowest,
                        highest,
                    },
                    Some(default),
                ) = (parameter.kind, parameter.default)
                {
                    assert_eq!(default.len(), components, "{what}");
                    assert!(default.iter().all(|v| (lowest..=highest).contains(v)), "{what}");
                }
                if let Some(other) = parameter.instead_of {
                    let other = family.parameter(other).expect("in the same table");
                    assert_eq!(other.instead_of, Some(parameter.name), "{what}");
                }
            }
        }
        assert_eq!(Family::find("plastic"), None);
    }
}
