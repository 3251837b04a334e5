//! The structure of exported files. That their numbers are right is shown by `tests/parity.rs` of the workspace.

use crate::graph::BATCH_AXIS;
use crate::proto::{DataType, Extent, ModelProto, ValueInfoProto};
use crate::{export, to_onnx};
use bake_runtime::network::parse_spec;
use bake_runtime::spec::{Port, SPEC_KEY};
use bake_runtime::{BakedMaterial, Dense, Family, Material, Network, NetworkSpec, Role};
use prost::Message;
use std::collections::HashSet;

#[test]
fn inputs_and_outputs_are_those_of_the_role() {
    for role in Role::ALL {
        let graph = decode(&to_onnx(&network(role)))
            .graph
            .expect("a model has a graph");
        assert_ports(&graph.input, role.graph_inputs());
        assert_ports(&graph.output, role.graph_outputs());
    }
}

#[test]
fn the_specification_travels_in_the_metadata() {
    for role in Role::ALL {
        let network = network(role);
        let model = decode(&to_onnx(&network));
        let entry = model
            .metadata_props
            .iter()
            .find(|entry| entry.key() == SPEC_KEY)
            .expect("the key is there");
        assert_eq!(
            parse_spec(entry.value()).expect("what is written can be read"),
            network.spec
        );
        assert_eq!(
            (model.producer_name(), model.producer_version()),
            ("bake-export", env!("CARGO_PKG_VERSION"))
        );
        assert!(model.doc_string().contains("vase"), "{}", model.doc_string());
    }
}

#[test]
fn nodes_are_sorted_and_every_name_is_defined_once() {
    for role in Role::ALL {
        let graph = decode(&to_onnx(&network(role)))
            .graph
            .expect("a model has a graph");
        let mut defined = HashSet::new();
        let constants = graph.initializer.iter().map(|tensor| tensor.name());
        for name in graph.input.iter().map(|input| input.name()).chain(constants) {
            assert!(defined.insert(name), "{name} twice");
        }
        for node in &graph.node {
            assert!(
                node.input.iter().all(|name| defined.contains(name.as_str())),
                "{node:?} reads what is not there yet"
            );
            for name in &node.output {
                assert!(defined.insert(name), "{name} twice");
            }
        }
        assert!(graph.output.iter().all(|output| defined.contains(output.name())));
    }
}

#[test]
fn constants_have_the_size_they_declare_and_are_stored_once() {
    for role in Role::ALL {
        let network = network(role);
        let graph = decode(&to_onnx(&network)).graph.expect("a model has a graph");
        let mut weights = 0;
        let mut shared = HashSet::new();
        for tensor in &graph.initializer {
            let elements = tensor.dims.iter().product::<i64>() as usize;
            let width = if tensor.data_type() == DataType::Float {
                size_of::<f32>()
            } else {
                size_of::<i64>()
            };
            assert_eq!(tensor.raw_data().len(), elements * width, "{}", tensor.name());
            let name = tensor.name();
            if name.starts_with("net.") || name.starts_with("frame.") {
                weights += elements;
            } else if name.starts_with("constant.") {
                assert!(
                    shared.insert((tensor.dims.clone(), tensor.raw_data())),
                    "{name} is stored twice"
                );
            }
        }
        assert_eq!(weights, network.spec.parameters());
    }
}

#[test]
fn export_writes_the_same_bytes_every_time_and_nothing_else() {
    let material = BakedMaterial {
        sample: network(Role::Sample),
        eval: network(Role::Eval),
        pdf: network(Role::Pdf),
    };
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    for _ in 0..2 {
        export(&material, folder.path()).expect("a temporary folder can be written");
        for network in [&material.sample, &material.eval, &material.pdf] {
            let path = folder
                .path()
                .join(network.spec.role.name())
                .with_extension("onnx");
            assert_eq!(std::fs::read(&path).expect("just written"), to_onnx(network));
        }
        assert_eq!(
            std::fs::read_dir(folder.path()).expect("just written").count(),
            Role::ALL.len()
        );
    }
}

#[test]
fn an_unwritable_folder_is_named() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let file = folder.path().join("file");
    std::fs::write(&file, "in the way").expect("a temporary folder can be written");
    let material = BakedMaterial {
        sample: network(Role::Sample),
        eval: network(Role::Eval),
        pdf: network(Role::Pdf),
    };
    let error = export(&material, &file)
        .expect_err("a file is no folder")
        .to_string();
    assert!(
        error.contains(&file.join("sample.onnx").display().to_string()),
        "{error}"
    );
}

fn decode(bytes: &[u8]) -> ModelProto {
    ModelProto::decode(bytes).expect("what is written can be read")
}

fn assert_ports(infos: &[ValueInfoProto], ports: &[Port]) {
    assert_eq!(infos.len(), ports.len());
    for (info, port) in infos.iter().zip(ports) {
        assert_eq!((info.name(), info.doc_string()), (port.name, port.doc));
        let tensor = info
            .r#type
            .as_ref()
            .and_then(|t| t.tensor_type.as_ref())
            .expect("it is a tensor");
        assert_eq!(tensor.elem_type(), DataType::Float);
        let extents: Vec<Extent> = tensor
            .shape
            .iter()
            .flat_map(|shape| &shape.dim)
            .filter_map(|dim| dim.value.clone())
            .collect();
        assert_eq!(
            extents,
            [Extent::Param(BATCH_AXIS.into()), Extent::Value(port.width as i64)]
        );
    }
}

fn network(role: Role) -> Network {
    let given: &[(&str, &[f64])] = &[("alpha", &[0.3, 0.1]), ("reflectance", &[1.0, 0.782, 0.344])];
    let material = Material::fixed("vase", Family::Conductor, given).expect("valid parameters");
    let spec = NetworkSpec::warp(role, material, [0.3, 0.1], vec![6, 5], vec![4]);
    let layer = |(inputs, outputs): (usize, usize)| Dense {
        weight: (0..inputs * outputs).map(|i| (i as f32).sin()).collect(),
        bias: (0..outputs).map(|i| (i as f32).cos()).collect(),
        inputs,
        outputs,
    };
    let frame = spec.frame_layers().into_iter().map(layer).collect();
    let net = spec.layers().into_iter().map(layer).collect();
    Network { spec, frame, net }
}
