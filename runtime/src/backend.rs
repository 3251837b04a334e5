//! The interface of everything that runs a baked material: native SIMD, or onnxruntime.

use crate::error::{Error, Result};
use crate::network::Network;
use crate::spec::Role;
use std::path::{Path, PathBuf};

/// The three networks of one baked material.
#[derive(Clone, Debug, PartialEq)]
pub struct BakedMaterial {
    /// (parameters, wo, u) ↦ wi, weight, jacobian.
    pub sample: Network,
    /// (parameters, wo, wi) ↦ f_cos.
    pub eval: Network,
    /// (parameters, wo, wi) ↦ pdf.
    pub pdf: Network,
}

impl BakedMaterial {
    /// Reads `sample.safetensors`, `eval.safetensors` and `pdf.safetensors` from `folder`.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Network`], naming the file; also when the three disagree about role or material.
    pub fn load(folder: &Path) -> Result<BakedMaterial> {
        let load = |role: Role| Network::load(&file_of(role, folder));
        BakedMaterial::agreed(load(Role::Sample)?, load(Role::Eval)?, load(Role::Pdf)?, folder)
    }

    /// The same from the bytes of the three files, which may lie anywhere; errors name them as files of `folder`.
    ///
    /// # Errors
    /// [`Error::Network`], as [`BakedMaterial::load`] has it.
    pub fn from_bytes(sample: &[u8], eval: &[u8], pdf: &[u8], folder: &Path) -> Result<BakedMaterial> {
        let parse = |role: Role, bytes: &[u8]| {
            Network::from_bytes(bytes).map_err(|reason| Error::network(file_of(role, folder), reason))
        };
        BakedMaterial::agreed(
            parse(Role::Sample, sample)?,
            parse(Role::Eval, eval)?,
            parse(Role::Pdf, pdf)?,
            folder,
        )
    }

    /// The material of three networks, where they agree about role, material and charts.
    fn agreed(sample: Network, eval: Network, pdf: Network, folder: &Path) -> Result<BakedMaterial> {
        let refuse = |role: Role, reason: String| Err(Error::network(file_of(role, folder), reason));
        for (role, network) in [(Role::Sample, &sample), (Role::Eval, &eval), (Role::Pdf, &pdf)] {
            if network.spec.role != role {
                return refuse(role, format!("it is a {} network", network.spec.role.name()));
            }
            if network.spec.material != sample.spec.material {
                let reason = "it was baked from another material than sample.safetensors";
                return refuse(role, reason.to_string());
            }
        }
        let charts = |network: &Network| network.spec.charts().map_or(0, |c| c.anchors.len());
        if charts(&pdf) != charts(&sample) {
            let reason = "it has another number of charts than sample.safetensors";
            return refuse(Role::Pdf, reason.to_string());
        }
        Ok(BakedMaterial { sample, eval, pdf })
    }

    /// Writes the three files into `folder`.
    ///
    /// # Errors
    /// [`Error::Io`] naming the file.
    pub fn save(&self, folder: &Path) -> Result<()> {
        for network in [&self.sample, &self.eval, &self.pdf] {
            network.save(&file_of(network.spec.role, folder))?;
        }
        Ok(())
    }
}

/// Where `folder` holds the network of `role`.
fn file_of(role: Role, folder: &Path) -> PathBuf {
    folder.join(role.name()).with_extension("safetensors")
}

/// The shading points of a batch.
#[derive(Clone, Copy, Debug)]
pub struct Points<'a> {
    /// Values of the free parameters, in the order of [`crate::Material::free`]: a column each, as long as the batch, or of
    /// length 1 where the whole batch has the same.
    pub params: &'a [&'a [f32]],
    /// Camera directions, one column per component.
    pub wo: [&'a [f32]; 3],
}

impl<'a> Points<'a> {
    /// Points of a material that leaves nothing free.
    pub fn fixed(wo: [&'a [f32]; 3]) -> Points<'a> {
        Points { params: &[], wo }
    }

    /// Number of queries.
    pub fn len(&self) -> usize {
        self.wo[0].len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Checks the lengths of all columns, and that there are `free` parameters.
    ///
    /// # Errors
    /// [`Error::BatchLength`] naming what does not fit.
    pub fn check(&self, free: usize) -> Result<()> {
        let n = self.len();
        check_lengths(free, &[("params", self.params.len())])?;
        for column in self.params.iter().filter(|column| column.len() != 1) {
            check_lengths(n, &[("params", column.len())])?;
        }
        check_lengths(n, &self.wo.map(|column| ("wo", column.len())))
    }
}

/// Runs the networks of one material on batches. Each array is a structure of arrays: one slice per
/// component, all of the same length. Any number of threads may call one backend at once. Directions are unit vectors of the
/// shading frame, away from the surface.
///
/// A query whose `wo` (or `wi`) is not finite or not above the horizon, or one of whose parameters is not finite, gives zeros
/// and `wi` = (0, 0, 1). Outputs are always finite, also for finite parameters outside of their ranges and for any u.
///
/// # Errors
/// Every method returns [`Error::BatchLength`] when slices differ in length; onnxruntime may add its own.
pub trait Backend: Send + Sync {
    /// Learned estimator: `wi`, and the regressed `weight` (RGB, ≥ 0). One pass.
    fn sample_learned(
        &self,
        points: Points,
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        weight: [&mut [f32]; 3],
    ) -> Result<()>;

    /// Exact estimators: `wi`, and the signed `jacobian` (sr) that makes `f_cos · jacobian` an unbiased weight. About three
    /// passes.
    ///
    /// With one chart it is the determinant of u ↦ solid angle, and 1/|jacobian| is the density of `wi` where the map does
    /// not fold; with two it is [`crate::oracle::jacobian`], which takes the pdf network as well. Negative where the map turns
    /// over, told before `wi` is unfolded by the material's symmetry: mirroring does not change the sign.
    fn sample_jacobian(
        &self,
        points: Points,
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        jacobian: &mut [f32],
    ) -> Result<()>;

    /// `f_cos` RGB, sr⁻¹.
    fn eval(&self, points: Points, wi: [&[f32]; 3], f_cos: [&mut [f32]; 3]) -> Result<()>;

    /// Learned density of `wi`, sr⁻¹: for weights of multiple importance sampling, never to divide by.
    fn pdf(&self, points: Points, wi: [&[f32]; 3], pdf: &mut [f32]) -> Result<()>;
}

/// Checks that the named slices all have `expected` elements.
///
/// # Errors
/// [`Error::BatchLength`] naming the first that has not.
pub fn check_lengths(expected: usize, slices: &[(&'static str, usize)]) -> Result<()> {
    match slices.iter().find(|(_, found)| *found != expected) {
        Some(&(name, found)) => Err(Error::BatchLength {
            name,
            expected,
            found,
        }),
        None => Ok(()),
    }
}
