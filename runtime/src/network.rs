//! A network with its weights, and its safetensors file.
//!
//! Tensors are `frame.{i}.weight` `[out, in]`, `frame.{i}.bias` `[out]`, `net.{i}.weight`, `net.{i}.bias`, all
//! little-endian f32; the specification stands under [`SPEC_KEY`] in `__metadata__`.

use crate::archive::Archive;
use crate::error::{Error, Result};
use crate::spec::{FORMAT, NetworkSpec, SPEC_KEY};
use safetensors::tensor::{Dtype, TensorView};
use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

/// One dense layer, y = W·x + b.
#[derive(Clone, Debug, PartialEq)]
pub struct Dense {
    /// Row-major `[outputs, inputs]`.
    pub weight: Vec<f32>,
    /// `[outputs]`.
    pub bias: Vec<f32>,
    /// Width of x.
    pub inputs: usize,
    /// Width of y.
    pub outputs: usize,
}

/// A network: its specification and its layers.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    /// The description.
    pub spec: NetworkSpec,
    /// Layers of the frame network; none without charts.
    pub frame: Vec<Dense>,
    /// Layers of the network.
    pub net: Vec<Dense>,
}

impl Network {
    /// Reads a safetensors file.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be read, [`Error::Network`] when it is not a network of this format.
    pub fn load(path: &Path) -> Result<Network> {
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
        Network::from_bytes(&bytes).map_err(|reason| Error::network(path, reason))
    }

    /// Writes a safetensors file: under a temporary name first, then renamed.
    ///
    /// # Errors
    /// [`Error::Io`] when the folder or the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<()> {
        write_atomically(path, &self.to_bytes())
    }

    /// The safetensors file as bytes; the same network always gives the same bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut tensors: Vec<(String, Vec<usize>, Vec<u8>)> = Vec::new();
        for (prefix, layers) in [("frame", &self.frame), ("net", &self.net)] {
            for (i, layer) in layers.iter().enumerate() {
                tensors.push((
                    format!("{prefix}.{i}.weight"),
                    vec![layer.outputs, layer.inputs],
                    bytes_of(&layer.weight),
                ));
                tensors.push((
                    format!("{prefix}.{i}.bias"),
                    vec![layer.outputs],
                    bytes_of(&layer.bias),
                ));
            }
        }
        let views = tensors.iter().map(|(name, shape, data)| {
            (
                name.as_str(),
                TensorView::new(Dtype::F32, shape.clone(), data).expect("shape matches data by construction"),
            )
        });
        let json = serde_json::to_string(&self.spec).expect("a specification is plain data");
        let metadata = HashMap::from([(SPEC_KEY.to_string(), json)]);
        safetensors::serialize(views, Some(metadata)).expect("tensor names are unique by construction")
    }

    /// Parses a safetensors file. Memory stays within a small multiple of its length, whatever it says.
    ///
    /// # Errors
    /// The reason alone, for the caller to name the file.
    pub fn from_bytes(bytes: &[u8]) -> std::result::Result<Network, String> {
        let file = Archive::open(bytes)?;
        let json = file
            .text(SPEC_KEY)
            .ok_or_else(|| format!("its metadata has no `{SPEC_KEY}`, so another program wrote it"))?;
        let spec: NetworkSpec = parse_spec(json)?;
        let read = |prefix: &str, shapes: Vec<(usize, usize)>| -> std::result::Result<Vec<Dense>, String> {
            shapes
                .into_iter()
                .enumerate()
                .map(|(i, (inputs, outputs))| {
                    let weight = read_tensor(&file, &format!("{prefix}.{i}.weight"), &[outputs, inputs])?;
                    let bias = read_tensor(&file, &format!("{prefix}.{i}.bias"), &[outputs])?;
                    Ok(Dense {
                        weight,
                        bias,
                        inputs,
                        outputs,
                    })
                })
                .collect()
        };
        let frame = read("frame", spec.frame_layers())?;
        let net = read("net", spec.layers())?;
        let (found, expected) = (file.data_len(), size_of::<f32>() * spec.parameters());
        if found != expected {
            return Err(format!(
                "its tensors have {found} bytes, its specification says {expected}"
            ));
        }
        Ok(Network { spec, frame, net })
    }
}

/// Longest specification, bytes: that of a network with all inputs that one may have takes half of it, those that ship
/// less than a tenth.
const SPEC_MAX: usize = 1 << 15;

/// Parses and checks a specification, from safetensors or ONNX metadata.
///
/// # Errors
/// The reason alone, for the caller to name the file.
pub fn parse_spec(json: &str) -> std::result::Result<NetworkSpec, String> {
    if json.len() > SPEC_MAX {
        return Err(format!(
            "its specification has {} bytes, more than {SPEC_MAX}",
            json.len()
        ));
    }
    let version: serde_json::Value =
        serde_json::from_str(json).map_err(|e| format!("its specification is not JSON ({e})"))?;
    let format = version.get("format").and_then(serde_json::Value::as_u64);
    if format != Some(u64::from(FORMAT)) {
        let found = format.map_or("none".to_string(), |f| f.to_string());
        return Err(format!(
            "its format version is {found}, this program reads {FORMAT}"
        ));
    }
    // From the text, which still has the keys that are given twice.
    let spec: NetworkSpec =
        serde_json::from_str(json).map_err(|e| format!("its specification is incomplete ({e})"))?;
    spec.validate()?;
    Ok(spec)
}

fn read_tensor(file: &Archive, name: &str, shape: &[usize]) -> std::result::Result<Vec<f32>, String> {
    let tensor = file
        .tensor(name)
        .ok_or_else(|| format!("tensor `{name}` is missing"))?;
    if tensor.dtype != Dtype::F32 || tensor.shape != shape {
        return Err(format!(
            "tensor `{name}` is {:?} {:?}, expected F32 {shape:?}",
            tensor.dtype, tensor.shape
        ));
    }
    let numbers = tensor.data.as_chunks().0;
    let values: Vec<f32> = numbers.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    match values.iter().all(|v| v.is_finite()) {
        true => Ok(values),
        false => Err(format!("tensor `{name}` holds values that are not finite")),
    }
}

fn bytes_of(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Writes `bytes` to `path` so that a reader sees the old file or the whole new one, never a part.
///
/// # Errors
/// [`Error::Io`] naming `path`.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    let folder = path
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let write = || -> std::io::Result<()> {
        std::fs::create_dir_all(folder)?;
        let mut builder = tempfile::Builder::new();
        builder.prefix(".bake-").suffix(".tmp");
        // Temporary files are private; this one becomes an ordinary file, which the umask rules.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let mut file = builder.tempfile_in(folder)?;
        file.write_all(bytes)?;
        file.as_file().sync_all()?;
        file.persist(path).map_err(|e| e.error)?;
        Ok(())
    };
    write().map_err(|e| Error::io(path, e))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn written_files_are_as_open_as_any_other() {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        let [ours, plain] = ["ours", "plain"].map(|name| folder.path().join(name));
        write_atomically(&ours, b"bytes").expect("a temporary folder can be written");
        std::fs::write(&plain, b"bytes").expect("a temporary folder can be written");
        let mode = |path: &Path| {
            std::fs::metadata(path)
                .expect("just written")
                .permissions()
                .mode()
        };
        assert_eq!(mode(&ours), mode(&plain));
    }
}
