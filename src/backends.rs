//! Baked materials by name, and the backends that run them.

use crate::arguments::BackendName;
use anyhow::{Result, bail};
use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::onnxruntime::OrtBackend;
use bake_runtime::{Backend, BakedMaterial, Role};
use bake_scenes::Scene;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// The baked materials of a scene, each with what runs it.
pub struct Backends {
    materials: BTreeMap<String, Arc<dyn Backend>>,
}

impl Backends {
    /// Loads the baked folder of every material of `scene` that has one in `folders`, and makes its backend, so that what is
    /// missing, or was baked from other parameters, is said before the work begins.
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
            let backend: Arc<dyn Backend> = match kind {
                BackendName::Native => Arc::new(native(&baked)?),
                BackendName::Ort => Arc::new(OrtBackend::new(folder)?),
            };
            materials.insert(wanted.name.clone(), backend);
        }
        Ok(Backends { materials })
    }

    /// The backend of the material called `name`.
    pub fn get(&self, name: &str) -> bake_runtime::Result<Arc<dyn Backend>> {
        let missing = || bake_runtime::Error::network(name, "the material was not loaded");
        self.materials.get(name).cloned().ok_or_else(missing)
    }
}

/// The native backend at the tier that the environment chooses.
pub fn native(material: &BakedMaterial) -> bake_runtime::Result<NativeBackend> {
    NativeBackend::new(material, Tier::chosen()?)
}
