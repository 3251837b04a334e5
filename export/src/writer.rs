//! Whole models: one graph per role, from raw inputs to finished outputs.

use crate::features::{CENTRED_SLOPE, encode};
use crate::frame::Frame;
use crate::graph::{Graph, Value};
use crate::layers::{Affine, Dual, forward, hidden_dual};
use crate::proto::{ModelProto, OperatorSetIdProto, StringStringEntryProto};
use crate::query::{above_horizon, answer, fold, limit_u};
use crate::warp::warp;
use bake_runtime::encoding::{Encoding, Quantity};
use bake_runtime::network::write_atomically;
use bake_runtime::spec::{EXPONENT_MAX, FORMAT, SPEC_KEY};
use bake_runtime::{BakedMaterial, Network, Result, Role};
use prost::Message;
use std::path::Path;

/// Version of the ONNX file format: the oldest that has opset 17, so that old runtimes read the models too.
const IR_VERSION: i64 = 8;
/// Version of the operators.
const OPSET: i64 = 17;

/// Number of outputs of a sampling network that steer the warp; the learned weight follows.
const WARP_OUTPUTS: usize = 2;

/// Writes `sample.onnx`, `eval.onnx` and `pdf.onnx` of `material` into `folder`, each under a temporary name first.
///
/// # Errors
/// [`bake_runtime::Error::Io`] naming the file.
pub fn export(material: &BakedMaterial, folder: &Path) -> Result<()> {
    for network in [&material.sample, &material.eval, &material.pdf] {
        let path = folder.join(network.spec.role.name()).with_extension("onnx");
        write_atomically(&path, &to_onnx(network))?;
    }
    Ok(())
}

/// The ONNX file of `network` as bytes; the same network always gives the same bytes.
///
/// Inputs and outputs are those of [`Role::graph_inputs`] and [`Role::graph_outputs`], f32 `[N, width]` with N
/// free. An invalid query (a direction that is not finite or not above the horizon) gives zeros and
/// `wi` = (0, 0, 1); outputs are always finite. The specification stands in `metadata_props` under [`SPEC_KEY`].
///
/// # Panics
/// When the specification gives a network an input that its role does not have, which
/// [`bake_runtime::network::parse_spec`] refuses in every file.
pub fn to_onnx(network: &Network) -> Vec<u8> {
    model(network).encode_to_vec()
}

fn model(network: &Network) -> ModelProto {
    let spec = &network.spec;
    let mut g = Graph::default();
    let doc = match spec.role {
        Role::Sample => {
            sample(&mut g, network);
            "Draws wi for wo and u, with the learned weight and the Jacobian of the map."
        }
        Role::Eval => {
            density(&mut g, network);
            "Evaluates f·cos θ_i, RGB, at wo and wi."
        }
        Role::Pdf => {
            density(&mut g, network);
            "Density of wi at wo, learned."
        }
    };
    let json = serde_json::to_string(spec).expect("a specification is plain data");
    ModelProto {
        ir_version: Some(IR_VERSION),
        producer_name: Some(env!("CARGO_PKG_NAME").into()),
        producer_version: Some(env!("CARGO_PKG_VERSION").into()),
        model_version: Some(i64::from(FORMAT)),
        doc_string: Some(format!("Material `{}`. {doc}", spec.material.name)),
        graph: Some(g.finish(spec.role.name(), doc)),
        opset_import: vec![OperatorSetIdProto {
            domain: Some(String::new()),
            version: Some(OPSET),
        }],
        metadata_props: vec![StringStringEntryProto {
            key: Some(SPEC_KEY.into()),
            value: Some(json),
        }],
    }
}

/// (wo, u) ↦ wi, weight, jacobian.
fn sample(g: &mut Graph, network: &Network) {
    let spec = &network.spec;
    let [wo, u] = spec.role.graph_inputs().each_ref().map(|port| g.input(port));
    g.scope("query");
    let valid = above_horizon(g, wo);
    let (folded, signs) = fold(g, spec.symmetry, wo);
    let u = limit_u(g, u);

    g.scope("net");
    let features = sample_features(g, network, folded, u);
    let (last, hidden) = network
        .net
        .split_last()
        .expect("a network has at least its last layer");
    let trunk = hidden_dual(g, "net", hidden, spec.activation, features);
    let name = format!("net.{}", hidden.len());
    let shift_head = Affine::new(g, &format!("{name}.shift"), last, 0..WARP_OUTPUTS);
    let weight_head = Affine::new(g, &format!("{name}.weight"), last, WARP_OUTPUTS..last.outputs);
    let shift = shift_head.dual(g, trunk);
    let log_weight = weight_head.value(g, trunk.value);
    let weight = bounded_exp(g, log_weight);

    let (square, det) = warp(g, u, shift);
    let frame = Frame::predict(g, network, folded);
    let (direction, solid_angle) = frame.square_to_direction(g, &square);

    g.scope("answer");
    let wi = g.mul(direction, signs);
    let jacobian = g.mul(solid_angle, det);
    let zero = g.scalar(0.0);
    let normal = g.constant(&[1, 3], &[0.0, 0.0, 1.0]);
    let fallbacks = [normal, zero, zero];
    for ((port, value), fallback) in spec
        .role
        .graph_outputs()
        .iter()
        .zip([wi, weight, jacobian])
        .zip(fallbacks)
    {
        let value = answer(g, valid, value, fallback);
        g.output(port, value);
    }
}

/// (wo, wi) ↦ frame density · e^output.
fn density(g: &mut Graph, network: &Network) {
    let spec = &network.spec;
    let [wo, wi] = spec.role.graph_inputs().each_ref().map(|port| g.input(port));
    g.scope("query");
    let (wo_valid, wi_valid) = (above_horizon(g, wo), above_horizon(g, wi));
    let valid = g.and(wo_valid, wi_valid);
    let (folded, signs) = fold(g, spec.symmetry, wo);
    let wi = g.mul(wi, signs);

    let frame = Frame::predict(g, network, folded);
    let (local, frame_density) = frame.to_local(g, wi);
    g.scope("net");
    let parts: Vec<Value> = spec
        .inputs
        .iter()
        .map(|input| match input.quantity {
            Quantity::Local => encode(g, input.encoding, local),
            Quantity::Wo => encode(g, input.encoding, folded),
            Quantity::U => unreachable!("networks that evaluate have no random numbers"),
        })
        .collect();
    let features = g.concat(&parts);
    let logs = forward(g, "net", &network.net, spec.activation, features);
    let ratio = bounded_exp(g, logs);

    g.scope("answer");
    let value = g.mul(frame_density, ratio);
    let zero = g.scalar(0.0);
    let value = answer(g, valid, value, zero);
    for port in spec.role.graph_outputs() {
        g.output(port, value);
    }
}

/// Features of a sampling network, with their constant tangents along u.
fn sample_features(g: &mut Graph, network: &Network, folded: Value, u: Value) -> Dual {
    let mut parts = Vec::new();
    let mut tangents = [Vec::new(), Vec::new()];
    for input in &network.spec.inputs {
        let start = tangents[0].len();
        let end = start + input.encoding.features(input.quantity.scalars());
        tangents.iter_mut().for_each(|t| t.resize(end, 0.0));
        parts.push(match (input.quantity, input.encoding) {
            (Quantity::U, Encoding::Centred) => {
                tangents[0][start] = CENTRED_SLOPE;
                tangents[1][start + 1] = CENTRED_SLOPE;
                encode(g, Encoding::Centred, u)
            }
            (Quantity::Wo, encoding) => encode(g, encoding, folded),
            (Quantity::U, Encoding::Identity | Encoding::Grazing) => {
                unreachable!("random numbers enter a warp centred")
            }
            (Quantity::Local, Encoding::Centred | Encoding::Identity | Encoding::Grazing) => {
                unreachable!("a sampling network has no direction to the light yet")
            }
        });
    }
    let value = g.concat(&parts);
    Dual {
        value,
        tangents: g.constant(&[2, 1, tangents[0].len()], &tangents.concat()),
    }
}

/// e^x with |x| limited to [`EXPONENT_MAX`].
fn bounded_exp(g: &mut Graph, x: Value) -> Value {
    let limited = g.clip(x, EXPONENT_MAX as f32);
    g.unary("Exp", limited)
}
