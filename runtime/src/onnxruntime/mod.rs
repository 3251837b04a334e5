//! Runs the exported ONNX models through onnxruntime, on one thread (feature `ort`).
//!
//! Encodings, charts and Jacobian are inside the models, so this only packs raw queries into tensors and takes
//! the answers apart. The library is loaded when the first backend is made; see [`library_path`].

mod library;
mod model;

pub use library::{ONNXRUNTIME_PINNED, library_path};

use crate::backend::{Backend, Points};
use crate::error::{Error, Result};
use crate::spec::Role;
use library::environment;
use model::{Model, open};
use ort::session::Session;
use ort::value::TensorRef;
use std::path::Path;

/// Runs `sample.onnx`, `eval.onnx` and `pdf.onnx` of one folder, on the threads that call it: each of these has a session of
/// its own.
///
/// `sample.onnx` always computes weight and Jacobian together, so both `sample` methods cost the same. A parameter that is
/// not finite makes its query invalid.
pub struct OrtBackend {
    sample: Model,
    eval: Model,
    pdf: Model,
}

impl OrtBackend {
    /// Loads the three models of `folder`.
    ///
    /// # Errors
    /// [`Error::Onnxruntime`] when the library is missing, too old or not onnxruntime; [`Error::Io`] when a model
    /// cannot be read; [`Error::Network`] when it is truncated, of another program, role or material.
    pub fn new(folder: &Path) -> Result<OrtBackend> {
        let load = |role: Role| Model::load(folder.join(role.name()).with_extension("onnx"), role);
        let backend = OrtBackend {
            sample: load(Role::Sample)?,
            eval: load(Role::Eval)?,
            pdf: load(Role::Pdf)?,
        };
        for other in [&backend.eval, &backend.pdf] {
            if other.spec.material != backend.sample.spec.material {
                return Err(Error::network(
                    &other.path,
                    "it was baked from another material than sample.onnx",
                ));
            }
        }
        let charts = |model: &Model| model.spec.charts().map_or(0, |c| c.anchors.len());
        if charts(&backend.pdf) != charts(&backend.sample) {
            return Err(Error::network(
                &backend.pdf.path,
                "it has another number of charts than sample.onnx",
            ));
        }
        Ok(backend)
    }

    /// The same with `chunk` ≥ 1 queries per call of onnxruntime instead of 1024.
    pub fn with_chunk(mut self, chunk: usize) -> OrtBackend {
        for model in [&mut self.sample, &mut self.eval, &mut self.pdf] {
            model.chunk = chunk.max(1);
        }
        self
    }
}

/// Any ONNX model in one session on the caller's thread, for comparisons of engines.
pub struct PlainModel {
    session: Session,
}

impl PlainModel {
    /// A session of the model that `bytes` hold.
    ///
    /// # Errors
    /// [`Error::Onnxruntime`] when the library is missing or refuses the model.
    pub fn new(bytes: &[u8]) -> Result<PlainModel> {
        let refused = |e| Error::Onnxruntime(format!("onnxruntime refuses the model: {e}"));
        Ok(PlainModel {
            session: open(&environment()?, bytes).map_err(refused)?,
        })
    }

    /// Runs the model on its one input, called `input`, row-major `[rows, width]`, and gives what it made of it to `read`.
    ///
    /// # Errors
    /// [`Error::Onnxruntime`] when the model cannot run it.
    pub fn run(&mut self, input: &str, width: usize, rows: &[f32], read: impl FnOnce(&[f32])) -> Result<()> {
        let failed = |e: ort::Error| Error::Onnxruntime(format!("onnxruntime could not run the model: {e}"));
        let tensor =
            TensorRef::from_array_view(([rows.len() / width.max(1), width], rows)).map_err(failed)?;
        let answers = self.session.run(vec![(input, tensor)]).map_err(failed)?;
        let (_, values) = answers[0].try_extract_tensor::<f32>().map_err(failed)?;
        read(values);
        Ok(())
    }
}

impl Backend for OrtBackend {
    fn sample_learned(
        &self,
        points: Points,
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        weight: [&mut [f32]; 3],
    ) -> Result<()> {
        let outputs = &mut [("wi", wi.into()), ("weight", weight.into())];
        self.sample.run(points, &u, outputs)
    }

    fn sample_jacobian(
        &self,
        points: Points,
        u: [&[f32]; 2],
        wi: [&mut [f32]; 3],
        jacobian: &mut [f32],
    ) -> Result<()> {
        let outputs = &mut [("wi", wi.into()), ("jacobian", vec![jacobian])];
        self.sample.run(points, &u, outputs)
    }

    fn eval(&self, points: Points, wi: [&[f32]; 3], f_cos: [&mut [f32]; 3]) -> Result<()> {
        self.eval.run(points, &wi, &mut [("f_cos", f_cos.into())])
    }

    fn pdf(&self, points: Points, wi: [&[f32]; 3], pdf: &mut [f32]) -> Result<()> {
        self.pdf.run(points, &wi, &mut [("pdf", vec![pdf])])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Holds at compile time: the threads of a renderer share a backend.
    const _: fn() = || {
        fn is_shared<T: Send + Sync>() {}
        is_shared::<OrtBackend>();
    };

    #[test]
    fn a_folder_without_models_or_a_machine_without_onnxruntime_is_an_error() {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        match OrtBackend::new(folder.path()) {
            Err(Error::Io { path, .. }) => assert_eq!(path, folder.path().join("sample.onnx")),
            Err(Error::Onnxruntime(message)) => assert!(message.contains(ONNXRUNTIME_PINNED), "{message}"),
            Err(other) => panic!("unexpected error {other}"),
            Ok(_) => panic!("an empty folder has no models"),
        }
    }
}
