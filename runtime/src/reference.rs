//! The reference model of any family, behind one name.

use crate::bsdf::{Bsdf, BsdfSample, Estimate, Slice};
use crate::conductor::Conductor;
use crate::error::{Error, Result};
use crate::family::Family;
use crate::imported::{Imported, ImportedTable};
use crate::layered::Layered;
use crate::material::Material;
use crate::principled::{Principled, PrincipledParameters};
use crate::random::Rng;
use crate::real::{Real, Vec3};
use crate::setting::Setting;

/// A reference model with its parameters bound; cheap to clone.
#[derive(Clone, Debug)]
pub enum Reference {
    /// [`Family::Conductor`].
    Conductor(Conductor),
    /// [`Family::Layered`].
    Layered(Layered),
    /// [`Family::Principled`].
    Principled(Principled),
    /// [`Family::Imported`].
    Imported(Imported),
}

impl Reference {
    /// Binds a `material` that [`Material::validate`] accepts and that leaves nothing free.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a free parameter, and what the model itself refuses.
    pub(crate) fn new(material: &Material) -> Result<Reference> {
        let number = |name: &str| material.numbers::<1>(name).map(|[value]| value);
        match material.family {
            Family::Conductor => {
                let alpha = material.numbers("alpha")?;
                let conductor = match material.get("ior") {
                    Some(Setting::Ior { eta, k }) => Conductor::with_ior(alpha, *eta, *k)?,
                    _ => Conductor::new(alpha, material.numbers("reflectance")?)?,
                };
                Ok(Reference::Conductor(conductor))
            }
            Family::Layered => {
                let layered = Layered::new(
                    number("alpha")?,
                    number("eta")?,
                    number("sigma_t")?,
                    material.numbers("albedo")?,
                    material.numbers("base")?,
                    number("g")?,
                )?;
                Ok(Reference::Layered(layered))
            }
            Family::Principled => {
                let principled = Principled::new(PrincipledParameters {
                    base_color: Vec3::from_array(material.numbers("base_color")?),
                    metallic: number("metallic")?,
                    roughness: number("roughness")?,
                    specular: number("specular")?,
                    specular_tint: number("specular_tint")?,
                    anisotropic: number("anisotropic")?,
                    sheen: number("sheen")?,
                    sheen_tint: number("sheen_tint")?,
                    clearcoat: number("clearcoat")?,
                    clearcoat_gloss: number("clearcoat_gloss")?,
                    flatness: number("flatness")?,
                })?;
                Ok(Reference::Principled(principled))
            }
            Family::Imported => {
                let Some(Setting::File(path)) = material.get("file") else {
                    return Err(Error::parameter("file", "missing field"));
                };
                let imported =
                    ImportedTable::bind_file(path, |name, [lowest, highest]| match material.get(name) {
                        Some(_) => number(name),
                        None => {
                            let reason = format!("missing field, the table covers {lowest}..{highest}");
                            Err(Error::parameter(name, reason))
                        }
                    })?;
                // A parameter that the table does not have would be passed over in silence.
                let table = imported.table().clone();
                for (name, _) in material.parameters.iter().filter(|(name, _)| name != "file") {
                    if !table.param_names().contains(name) {
                        let names = table.param_names().join("`, `");
                        return Err(Error::parameter(
                            name,
                            format!("{} has no such parameter, only `{names}`", path.display()),
                        ));
                    }
                }
                Ok(Reference::Imported(imported))
            }
        }
    }

    /// The model of a conductor.
    pub fn as_conductor(&self) -> Option<&Conductor> {
        match self {
            Reference::Conductor(conductor) => Some(conductor),
            _ => None,
        }
    }

    /// The colour that a picture's auxiliary image shows for it, linear RGB in `[0, 1]`: a conductor's reflectance at
    /// normal incidence, a layered material's base, an imported table's albedo at normal incidence.
    pub fn base_color(&self) -> Vec3 {
        match self {
            Reference::Conductor(conductor) => conductor.fresnel.normal(),
            Reference::Layered(layered) => layered.base(),
            Reference::Principled(principled) => principled.parameters().base_color,
            Reference::Imported(imported) => imported.albedo(Vec3::Z, 1 << 10, 0).mean.min(Vec3::ONE),
        }
    }

    /// The model behind the name.
    fn model(&self) -> &dyn Bsdf {
        match self {
            Reference::Conductor(conductor) => conductor,
            Reference::Layered(layered) => layered,
            Reference::Principled(principled) => principled,
            Reference::Imported(imported) => imported,
        }
    }
}

impl Bsdf for Reference {
    fn eval(&self, wo: Vec3, wi: Vec3, rng: &mut Rng) -> Vec3 {
        self.model().eval(wo, wi, rng)
    }

    fn eval_lobes(&self, wo: Vec3, wi: Vec3, rng: &mut Rng) -> [Vec3; 2] {
        self.model().eval_lobes(wo, wi, rng)
    }

    fn sample(&self, wo: Vec3, u: [Real; 2], rng: &mut Rng) -> Option<BsdfSample> {
        self.model().sample(wo, u, rng)
    }

    fn pdf(&self, wo: Vec3, wi: Vec3) -> Real {
        self.model().pdf(wo, wi)
    }

    fn propose(&self, wo: Vec3, u: [Real; 2]) -> Option<Vec3> {
        self.model().propose(wo, u)
    }

    fn is_stochastic(&self) -> bool {
        self.model().is_stochastic()
    }

    fn slice(&self, wo: Vec3, walks: usize, seed: u64) -> Box<dyn Slice + '_> {
        self.model().slice(wo, walks, seed)
    }

    fn albedo(&self, wo: Vec3, samples: u64, seed: u64) -> Estimate {
        self.model().albedo(wo, samples, seed)
    }
}
