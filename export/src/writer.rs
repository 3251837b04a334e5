//! Whole files: one graph per role, from raw inputs to finished outputs, with its specification.

use crate::density::density;
use crate::graph::Graph;
use crate::layers::forward;
use crate::proto::{GraphProto, ModelProto, OperatorSetIdProto, StringStringEntryProto};
use crate::sample::sample;
use bake_runtime::network::write_atomically;
use bake_runtime::spec::{Activation, FORMAT, Port, SPEC_KEY};
use bake_runtime::{BakedMaterial, Dense, Result, Role};
use prost::Message;
use std::path::Path;

/// Version of the ONNX file format: the oldest that has opset 17, so that old runtimes read the models too.
const IR_VERSION: i64 = 8;
/// Version of the operators.
const OPSET: i64 = 17;

/// Writes `sample.onnx`, `eval.onnx` and `pdf.onnx` of `material` into `folder`, each under a temporary name first.
///
/// # Errors
/// [`bake_runtime::Error::Io`] naming the file.
pub fn export(material: &BakedMaterial, folder: &Path) -> Result<()> {
    for role in Role::ALL {
        let path = folder.join(role.name()).with_extension("onnx");
        write_atomically(&path, &to_onnx(material, role))?;
    }
    Ok(())
}

/// The ONNX file of the network of this role as bytes; the same networks always give the same bytes.
///
/// Inputs are the free parameters, where there are any ([`bake_runtime::spec::params_port`]), and those of
/// [`Role::graph_inputs`]; outputs are those of [`Role::graph_outputs`]; all f32 `[N, width]` with N free. An invalid
/// query (a parameter that is not finite, a direction that is not finite or not above the horizon) gives zeros and
/// `wi` = (0, 0, 1); outputs are always finite. The specification stands in `metadata_props` under [`SPEC_KEY`].
///
/// The Jacobian of a sampling network with two charts takes the pdf network as well, so that one is in its file too.
///
/// # Panics
/// When a specification does not pass [`bake_runtime::NetworkSpec::validate`], which every file must.
pub fn to_onnx(material: &BakedMaterial, role: Role) -> Vec<u8> {
    model(material, role).encode_to_vec()
}

/// Dense `layers` alone as the bytes of an ONNX file, without encodings or heads: input `x` `[N, inputs]`, output `y`
/// `[N, outputs]`, for comparisons of engines.
pub fn layers_to_onnx(layers: &[Dense], activation: Activation) -> Vec<u8> {
    let port = |name, width| Port {
        name,
        width,
        doc: "Of the layers.",
    };
    let mut g = Graph::default();
    let x = g.input(&port("x", layers.first().map_or(0, |layer| layer.inputs)));
    let y = forward(&mut g, "net", layers, activation, x);
    g.output(&port("y", layers.last().map_or(0, |layer| layer.outputs)), y);
    plain(g.finish("layers", "Dense layers alone.")).encode_to_vec()
}

fn model(material: &BakedMaterial, role: Role) -> ModelProto {
    let mut g = Graph::default();
    let (spec, doc) = match role {
        Role::Sample => {
            sample(&mut g, material);
            let doc = "Draws wi for wo and u, with the learned weight and the Jacobian of the map.";
            (&material.sample.spec, doc)
        }
        Role::Eval => {
            density(&mut g, &material.eval);
            (&material.eval.spec, "Evaluates f·cos θ_i, RGB, at wo and wi.")
        }
        Role::Pdf => {
            density(&mut g, &material.pdf);
            (&material.pdf.spec, "Density of wi at wo, learned.")
        }
    };
    let json = serde_json::to_string(spec).expect("a specification is plain data");
    ModelProto {
        doc_string: Some(format!("Material `{}`. {doc}", spec.material.name)),
        metadata_props: vec![StringStringEntryProto {
            key: Some(SPEC_KEY.into()),
            value: Some(json),
        }],
        ..plain(g.finish(spec.role.name(), doc))
    }
}

/// A file with `graph` and nothing said of it.
fn plain(graph: GraphProto) -> ModelProto {
    ModelProto {
        ir_version: Some(IR_VERSION),
        producer_name: Some(env!("CARGO_PKG_NAME").into()),
        producer_version: Some(env!("CARGO_PKG_VERSION").into()),
        model_version: Some(i64::from(FORMAT)),
        graph: Some(graph),
        opset_import: vec![OperatorSetIdProto {
            domain: Some(String::new()),
            version: Some(OPSET),
        }],
        ..ModelProto::default()
    }
}
