//! Presets: which networks a material gets.

pub mod paper;
pub mod warp;

use crate::error::{Error, Result};
use crate::lobes::Lobe;
use crate::places::azimuths_deg;
use bake_runtime::spec::Symmetry;
use bake_runtime::{Family, Material, NetworkSpec, Role, Scalar};
use std::fmt;

/// The ways to bake.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// Ours: a warp of the squares of charts.
    Warp,
    /// The paper's: positions on the disk (Bai et al. 2023).
    Paper,
}

impl Preset {
    /// Both, the default first.
    pub const ALL: [Preset; 2] = [Preset::Warp, Preset::Paper];

    /// The name on the command line and on cards.
    pub fn name(self) -> &'static str {
        match self {
            Preset::Warp => "warp",
            Preset::Paper => "paper",
        }
    }

    /// The preset that networks of `spec` come from.
    pub fn of(spec: &NetworkSpec) -> Preset {
        match spec.charts() {
            Some(_) => Preset::Warp,
            None => Preset::Paper,
        }
    }

    /// The specification of `role` for `material`.
    ///
    /// # Errors
    /// [`Error::Runtime`] for a material that cannot be baked.
    pub fn spec(self, role: Role, material: &Material) -> Result<NetworkSpec> {
        let spec = match self {
            Preset::Warp => warp::spec(role, material)?,
            Preset::Paper => paper::spec(role, material)?,
        };
        spec.validate()
            .map_err(|reason| bake_runtime::Error::parameter("specification", reason))?;
        Ok(spec)
    }
}

impl fmt::Display for Preset {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The lobes that get charts of their own in the warp preset.
///
/// One for a conductor, whose orders all lie where the first does; two where a mirrored lobe lies over light that entered
/// the material.
pub fn lobes(family: Family) -> &'static [Lobe] {
    match family {
        Family::Conductor | Family::Imported => &[Lobe::Whole],
        Family::Layered | Family::Principled => &[Lobe::Sharp, Lobe::Smooth],
    }
}

/// How queries of `material` are folded.
///
/// # Errors
/// [`Error::Runtime`] for a material without symmetry: networks of such cannot be baked.
pub fn symmetry(material: &Material) -> Result<Symmetry> {
    match azimuths_deg(material) {
        0.0 => Ok(Symmetry::Rotation),
        90.0 => Ok(Symmetry::Quadrant),
        _ => Err(Error::Runtime(bake_runtime::Error::parameter(
            "family",
            format!(
                "is \"{}\", which has no symmetry to fold queries by; networks are baked of conductors, layered and \
                 principled materials",
                material.family.name()
            ),
        ))),
    }
}

/// Where the scalar `index` of the parameter `name` comes from: the number among the free ones, or its fixed value.
pub(crate) fn source(
    material: &Material,
    name: &str,
    index: usize,
) -> Option<std::result::Result<usize, f64>> {
    let setting = material.get(name)?;
    let scalar: &Scalar = setting.scalars().get(index)?;
    match scalar.fixed() {
        Ok(value) => Some(Err(value)),
        Err(_) => {
            let label = setting.label(name, index);
            let position = material.free().iter().position(|(free, ..)| *free == label);
            position.map(Ok)
        }
    }
}
