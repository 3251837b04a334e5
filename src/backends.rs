//! Baked materials by name, and the backends that run them.

use crate::arguments::BackendName;
use anyhow::{Result, bail};
use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::onnxruntime::OrtBackend;
use bake_runtime::{Backend, BakedMaterial, Role};
use bake_scenes::Scene;
use bake_train::card::Mixture;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The baked materials of a scene.
pub struct Backends {
    kind: BackendName,
    materials: BTreeMap<String, (PathBuf, BakedMaterial)>,
}

impl Backends {
    /// Loads the baked folder of every material of `scene` that has one in `folders`, and tries the backend once,
    /// so that what is missing, or was baked from other parameters, is said before the work begins.
    pub fn load(kind: BackendName, folders: &BTreeMap<String, PathBuf>, scene: &Scene) -> Result<Backends> {
        let mut materials = BTreeMap::new();
        for wanted in scene.materials() {
            let Some(folder) = folders.get(&wanted.name) else {
                continue;
            };
            let baked = BakedMaterial::load(folder)?;
            if baked.sample.spec.material != *wanted {
                bail!(
                    "{}: it was baked from other parameters than material `{}` has now; bake the scene again",
                    folder.display(),
                    wanted.name
                );
            }
            materials.insert(wanted.name.clone(), (folder.clone(), baked));
            let models = Role::ALL.map(|role| folder.join(role.name()).with_extension("onnx"));
            if let Some(missing) = models
                .iter()
                .find(|file| kind == BackendName::Ort && !file.exists())
            {
                bail!(
                    "{}: there is no such file; write it with `bake export {}`",
                    missing.display(),
                    folder.display()
                );
            }
        }
        let backends = Backends { kind, materials };
        for name in folders.keys() {
            backends.make(name)?;
        }
        Ok(backends)
    }

    /// A backend for the material called `name`.
    pub fn make(&self, name: &str) -> bake_runtime::Result<Box<dyn Backend>> {
        let Some((folder, material)) = self.materials.get(name) else {
            return Err(bake_runtime::Error::network(name, "the material was not loaded"));
        };
        match self.kind {
            BackendName::Native => native(material),
            BackendName::Ort => ort(folder),
        }
    }
}

/// The native backend at the machine's best tier.
pub fn native(material: &BakedMaterial) -> bake_runtime::Result<Box<dyn Backend>> {
    Ok(Box::new(NativeBackend::new(material, Tier::best())?))
}

/// The onnxruntime backend on the ONNX files in `folder`.
pub fn ort(folder: &Path) -> bake_runtime::Result<Box<dyn Backend>> {
    Ok(Box::new(OrtBackend::new(folder)?))
}

/// Draws from two charts by their exact mixture, by the native backend.
pub fn mixture(material: &BakedMaterial) -> bake_runtime::Result<Mixture<'static>> {
    let backend = NativeBackend::new(material, Tier::best())?;
    Ok(Box::new(move |points, u, wi, jacobian| {
        let inversions = backend.sample_mixture(points, u, wi, jacobian)?;
        Ok(inversions.unconverged as usize)
    }))
}
