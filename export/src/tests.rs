//! The structure of exported files. That their numbers are right is shown by `tests/onnxruntime` of the workspace.

use crate::graph::BATCH_AXIS;
use crate::proto::{DataType, Extent, GraphProto, ModelProto, ValueInfoProto};
use crate::{export, to_onnx};
use bake_runtime::anchor::Anchor;
use bake_runtime::encoding::{Encoding, Quantity};
use bake_runtime::network::parse_spec;
use bake_runtime::spec::{
    Activation, ChartsSpec, FORMAT, Geometry, Input, Port, Roughness, SPEC_KEY, Symmetry, params_port,
};
use bake_runtime::{BakedMaterial, Dense, Material, Network, NetworkSpec, Role};
use prost::Message;
use std::collections::HashSet;

#[test]
fn inputs_and_outputs_are_those_of_the_role() {
    for (material, role) in cases() {
        let graph = graph(&material, role);
        let free = material.sample.spec.material.free().len();
        let params = (free > 0).then(|| params_port(free));
        let inputs: Vec<Port> = params.into_iter().chain(*role.graph_inputs()).collect();
        assert_ports(&graph.input, &inputs);
        assert_ports(&graph.output, role.graph_outputs());
    }
}

#[test]
fn the_specification_travels_in_the_metadata() {
    for (material, role) in cases() {
        let model = decode(&to_onnx(&material, role));
        let entry = model
            .metadata_props
            .iter()
            .find(|entry| entry.key() == SPEC_KEY)
            .expect("the key is there");
        assert_eq!(
            parse_spec(entry.value()).expect("what is written can be read"),
            of_role(&material, role).spec
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
    for (material, role) in cases() {
        let graph = graph(&material, role);
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

/// Of two charts the Jacobian takes the densities of the pdf network; of one it does not.
#[test]
fn weights_are_those_of_the_networks_that_the_answers_take() {
    for (material, role) in cases() {
        let (mut own, mut of_pdf) = (0, 0);
        for tensor in &graph(&material, role).initializer {
            let elements = tensor.dims.iter().product::<i64>() as usize;
            match tensor.name().split('.').next() {
                Some("net" | "frame") => own += elements,
                Some("pdf") => of_pdf += elements,
                _ => {}
            }
        }
        let charts = material.sample.spec.charts().map_or(0, |c| c.anchors.len());
        assert_eq!(own, of_role(&material, role).spec.parameters());
        let expected = match role == Role::Sample && charts == 2 {
            true => material.pdf.spec.parameters(),
            false => 0,
        };
        assert_eq!(of_pdf, expected);
    }
}

#[test]
fn constants_have_the_size_they_declare_and_are_stored_once() {
    for (material, role) in cases() {
        let graph = graph(&material, role);
        let mut shared = HashSet::new();
        for tensor in &graph.initializer {
            let elements = tensor.dims.iter().product::<i64>() as usize;
            let width = if tensor.data_type() == DataType::Float {
                size_of::<f32>()
            } else {
                size_of::<i64>()
            };
            assert_eq!(tensor.raw_data().len(), elements * width, "{}", tensor.name());
            if tensor.name().starts_with("constant.") {
                assert!(
                    shared.insert((tensor.dims.clone(), tensor.raw_data())),
                    "{} is stored twice",
                    tensor.name()
                );
            }
        }
    }
}

#[test]
fn export_writes_the_same_bytes_every_time_and_nothing_else() {
    let material = material(2, true);
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    for _ in 0..2 {
        export(&material, folder.path()).expect("a temporary folder can be written");
        for role in Role::ALL {
            let path = folder.path().join(role.name()).with_extension("onnx");
            assert_eq!(
                std::fs::read(&path).expect("just written"),
                to_onnx(&material, role)
            );
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
    let error = export(&material(1, false), &file)
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

fn graph(material: &BakedMaterial, role: Role) -> GraphProto {
    decode(&to_onnx(material, role))
        .graph
        .expect("a model has a graph")
}

fn of_role(material: &BakedMaterial, role: Role) -> &Network {
    match role {
        Role::Sample => &material.sample,
        Role::Eval => &material.eval,
        Role::Pdf => &material.pdf,
    }
}

/// Every role of materials with no, one and two charts, with and without free parameters.
fn cases() -> impl Iterator<Item = (BakedMaterial, Role)> {
    let materials = (0..3).flat_map(|charts| [false, true].map(|free| material(charts, free)));
    materials.flat_map(|material| Role::ALL.map(|role| (material.clone(), role)))
}

/// Networks of the vase, with this number of charts.
fn material(charts: usize, free: bool) -> BakedMaterial {
    let alpha = if free {
        r#"{"min": 0.1, "max": 0.3}"#
    } else {
        "0.3"
    };
    let json = format!(
        r#"{{"name": "vase", "family": "conductor", "alpha": [{alpha}, 0.1], "reflectance": [1.0, 0.782, 0.344]}}"#
    );
    let material: Material = serde_json::from_str(&json).expect("a valid description");
    let network = |role| {
        let spec = spec(role, &material, charts, free);
        spec.validate().expect("a sound specification");
        let layer = |(inputs, outputs): (usize, usize)| Dense {
            weight: (0..inputs * outputs).map(|i| (i as f32).sin()).collect(),
            bias: (0..outputs).map(|i| (i as f32).cos()).collect(),
            inputs,
            outputs,
        };
        let frame = spec.frame_layers().into_iter().map(layer).collect();
        let net = spec.layers().into_iter().map(layer).collect();
        Network { spec, frame, net }
    };
    BakedMaterial {
        sample: network(Role::Sample),
        eval: network(Role::Eval),
        pdf: network(Role::Pdf),
    }
}

fn spec(role: Role, material: &Material, charts: usize, free: bool) -> NetworkSpec {
    let wo = Input::plain(Quantity::Wo, Encoding::Grazing);
    let other = match role {
        Role::Sample => Input::plain(Quantity::U, Encoding::Frequency(3)),
        Role::Eval | Role::Pdf => Input::plain(Quantity::WiDisk, Encoding::OneBlob(4)),
    };
    let parameter = free.then(|| Input::plain(Quantity::Parameter(0), Encoding::Centred));
    NetworkSpec {
        format: FORMAT,
        role,
        material: material.clone(),
        symmetry: Symmetry::Quadrant,
        inputs: [other, wo].into_iter().chain(parameter).collect(),
        hidden: vec![6, 5],
        activation: Activation::Silu,
        geometry: match charts {
            0 => Geometry::Disk,
            _ => Geometry::Charts(ChartsSpec {
                anchors: [Anchor::Mirror, Anchor::Diffuse][..charts].to_vec(),
                alpha: [0.3, 0.1].map(Roughness::Fixed),
                inputs: vec![wo],
                hidden: vec![4],
            }),
        },
    }
}
