//! A small sound network, to be spoiled before it is written.

use bake_runtime::spec::SPEC_KEY;
use bake_runtime::{Network, NetworkSpec, Role};
use safetensors::tensor::{Dtype, TensorView};
use serde_json::{Value, json};
use std::collections::{BTreeMap, HashMap};

/// The content of a network's file.
#[derive(Clone)]
pub struct File {
    /// The specification.
    pub spec: Value,
    /// Everything in `__metadata__` beside it.
    pub metadata: HashMap<String, String>,
    /// Tensors by their names.
    pub tensors: BTreeMap<String, (Dtype, Vec<usize>, Vec<u8>)>,
}

impl File {
    /// A network of two charts with one free parameter, `alpha[0]`; all weights are 1/4.
    pub fn sound(role: Role) -> File {
        let other = match role {
            Role::Sample => "u",
            Role::Eval | Role::Pdf => "wi_disk",
        };
        let spec = json!({
            "format": 2,
            "role": role.name(),
            "material": {"name": "rim", "family": "conductor", "alpha": [{"min": 0.1, "max": 0.5}, 0.2],
                "reflectance": [1, 0.8, 0.3]},
            "symmetry": "quadrant",
            "inputs": [
                {"quantity": other, "encoding": "identity"},
                {"quantity": {"parameter": 0}, "scale": {"sqrt": [0.1, 0.5]}, "encoding": {"one_blob": 3}},
            ],
            "hidden": [4],
            "activation": "silu",
            "geometry": {"charts": {
                "anchors": ["mirror", "diffuse"],
                "alpha": [{"free": {"parameter": 0, "factor": 1.0, "power": 1}}, {"fixed": 0.2}],
                "inputs": [{"quantity": "wo", "encoding": "grazing"}],
                "hidden": [3],
            }},
        });
        File::of(spec)
    }

    /// A file of the sound specification `spec`; all weights are 1/4.
    pub fn of(spec: Value) -> File {
        let sound: NetworkSpec = serde_json::from_value(spec.clone()).expect("a specification");
        let mut file = File {
            spec,
            metadata: HashMap::new(),
            tensors: BTreeMap::new(),
        };
        for (prefix, layers) in [("frame", sound.frame_layers()), ("net", sound.layers())] {
            for (i, (inputs, outputs)) in layers.into_iter().enumerate() {
                file.set(&format!("{prefix}.{i}.weight"), &[outputs, inputs]);
                file.set(&format!("{prefix}.{i}.bias"), &[outputs]);
            }
        }
        file
    }

    /// Adds a tensor of this shape, or replaces it.
    pub fn set(&mut self, name: &str, shape: &[usize]) {
        let count = shape.iter().product();
        let bytes = [0.25f32.to_le_bytes()].repeat(count).concat();
        self.tensors
            .insert(name.into(), (Dtype::F32, shape.to_vec(), bytes));
    }

    /// The whole file.
    pub fn bytes(&self) -> Vec<u8> {
        let mut metadata = self.metadata.clone();
        metadata.insert(SPEC_KEY.into(), self.spec.to_string());
        self.bytes_with(metadata)
    }

    /// The whole file with this `__metadata__`.
    pub fn bytes_with(&self, metadata: HashMap<String, String>) -> Vec<u8> {
        let views = self.tensors.iter().map(|(name, (dtype, shape, bytes))| {
            (
                name,
                TensorView::new(*dtype, shape.clone(), bytes).expect("shape and bytes agree"),
            )
        });
        safetensors::serialize(views, Some(metadata)).expect("names are distinct")
    }
}

/// A file of this header, whatever it says.
pub fn file_of(header: &[u8], data: &[u8]) -> Vec<u8> {
    [&(header.len() as u64).to_le_bytes(), header, data].concat()
}

/// Asserts that `bytes` are refused for a reason that holds all of `parts`.
pub fn refused(bytes: &[u8], parts: &[&str]) {
    let reason = match Network::from_bytes(bytes) {
        Err(reason) => reason,
        Ok(network) => panic!("expected {parts:?}, but got {:?}", network.spec),
    };
    for part in parts {
        assert!(reason.contains(part), "`{part}` is not in: {reason}");
    }
}

/// Asserts that `file` is refused once `spoil` has been at it.
pub fn spoiled(spoil: impl Fn(&mut File), parts: &[&str]) {
    for role in Role::ALL {
        let mut file = File::sound(role);
        spoil(&mut file);
        refused(&file.bytes(), parts);
    }
}
