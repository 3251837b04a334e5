//! What loading takes of the memory: a small multiple of the file, whatever it says.

use crate::peak;
use bake_runtime::imported::{FORMAT, FORMAT_KEY, ImportedTable};
use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::network::parse_spec;
use bake_runtime::spec::SPEC_KEY;
use bake_runtime::{BakedMaterial, Dense, Network, NetworkSpec, Role};
use serde_json::json;
use std::path::Path;

/// Bytes per byte of a file: its weights once, packed once, and once more while a vector grows.
const MULTIPLE: usize = 4;
/// The same of tables, whose rows are sorted.
const MULTIPLE_OF_ROWS: usize = 6;
/// Bytes that the longest header or specification may cost on top.
const OF_HEADER: usize = 4 << 20;
/// Bytes that the tiles of three networks may take on top, of any width.
const OF_TILES: usize = 4 << 20;

fn file_of(header: &str, data: usize) -> Vec<u8> {
    let length = (header.len() as u64).to_le_bytes();
    [&length[..], header.as_bytes(), &vec![0; data]].concat()
}

/// `unit` again and again, `length` bytes at most.
fn filled(before: &str, unit: &str, after: &str, length: usize) -> String {
    let room = length - before.len() - after.len() - 1;
    let units = unit.repeat(room / unit.len());
    format!("{before}{}{after}", units.trim_end_matches(','))
}

/// Headers that promise much.
pub fn hostile_headers() {
    let longest = 1 << 17;
    let numbered = |of: &dyn Fn(usize) -> String| {
        let mut entries = String::from("{");
        for i in 0.. {
            let entry = of(i);
            if entries.len() + entry.len() >= longest {
                break;
            }
            entries += &entry;
        }
        entries.trim_end_matches(',').to_string() + "}"
    };
    let shape = r#"{"a":{"dtype":"U8","shape":["#;
    for (what, header) in [
        (
            "shapes",
            filled(shape, "0,", r#"],"data_offsets":[0,0]}}"#, longest),
        ),
        ("lists", filled(r#"{"a":["#, "[],", "]}", longest)),
        ("tables", filled(r#"{"a":["#, "{},", "]}", longest)),
        (
            "tensors",
            numbered(&|i| format!(r#""{i}":{{"dtype":"U8","shape":[0],"data_offsets":[0,0]}},"#)),
        ),
        ("entries", numbered(&|i| format!(r#""{i}":0,"#))),
        (
            "texts",
            numbered(&|i| format!(r#""{i}":"","#)).replacen('{', r#"{"__metadata__":{"#, 1) + "}",
        ),
        (
            "a huge tensor",
            r#"{"a":{"dtype":"F32","shape":[1000000000000],"data_offsets":[0,4000000000000]}}"#.into(),
        ),
    ] {
        let file = file_of(&header, 0);
        let (taken, result) = peak(|| Network::from_bytes(&file));
        assert!(result.is_err(), "{what}");
        assert!(taken <= OF_HEADER, "{what}: {taken} bytes");
        let (taken, result) = peak(|| ImportedTable::from_bytes(&file, Path::new("table")));
        assert!(result.is_err(), "{what}");
        assert!(taken <= OF_HEADER, "{what}: {taken} bytes");
    }
    // A longer header is not read at all.
    let file = file_of(&filled(shape, "0,", r#"],"data_offsets":[0,0]}}"#, 16 << 20), 0);
    let (taken, result) = peak(|| Network::from_bytes(&file));
    assert!(result.is_err() && taken < 4096, "{taken} bytes");
    let (taken, result) = peak(|| Network::from_bytes(&u64::MAX.to_le_bytes()));
    assert!(result.is_err() && taken < 4096, "{taken} bytes");

    // Rows of a table that agree with the file, with slices of one pixel: most memory per byte.
    let rows = 50_000;
    let [wo, f_cos] = [8 * rows, 20 * rows];
    let header = format!(
        r#"{{"__metadata__":{{"{FORMAT_KEY}":"{FORMAT}"}},"params":{{"dtype":"F32","shape":[{rows},0],"data_offsets":[0,0]}},"wo":{{"dtype":"F32","shape":[{rows},2],"data_offsets":[0,{wo}]}},"f_cos":{{"dtype":"F32","shape":[{rows},1,1,3],"data_offsets":[{wo},{f_cos}]}}}}"#
    );
    let file = file_of(&header, f_cos);
    let (taken, result) = peak(|| ImportedTable::from_bytes(&file, Path::new("table")));
    assert!(result.is_err(), "all rows are for the same direction");
    assert!(
        taken <= MULTIPLE_OF_ROWS * file.len(),
        "{taken} bytes of {}",
        file.len()
    );
}

/// Specifications that promise much.
pub fn hostile_specifications() {
    let longest = 1 << 15;
    for (what, json) in [
        ("widths", filled(r#"{"format":2,"hidden":["#, "1,", "]}", longest)),
        (
            "lists",
            filled(r#"{"format":2,"material":["#, "[],", "]}", longest),
        ),
        (
            "parameters",
            filled(
                r#"{"format":2,"material":{"name":"a","family":"imported","file":["#,
                "{},",
                "]}}",
                longest,
            ),
        ),
    ] {
        let (taken, result) = peak(|| parse_spec(&json));
        assert!(result.is_err(), "{what}");
        assert!(taken <= OF_HEADER, "{what}: {taken} bytes");
    }
    let (taken, result) = peak(|| parse_spec(&"[".repeat(16 << 20)));
    assert!(result.is_err() && taken <= (16 << 20) + 4096, "{taken} bytes");
    for hidden in [json!([1_000_000_000]), json!(vec![1_000_000_000; 1000])] {
        let file = file_of_spec(&spec(Role::Sample, hidden, 1));
        let (taken, result) = peak(|| Network::from_bytes(&file));
        assert!(result.is_err() && taken < 1 << 20, "{taken} bytes");
    }
}

/// A specification with `inputs` inputs as wide as they may be.
fn spec(role: Role, hidden: serde_json::Value, inputs: usize) -> serde_json::Value {
    let wo = json!({"quantity": "wo", "encoding": {"one_blob": 64}});
    json!({
        "format": 2, "role": role.name(), "symmetry": "quadrant", "activation": "relu", "geometry": "disk",
        "material": {"name": "rim", "family": "conductor", "alpha": [0.1, 0.2], "reflectance": [1, 0.8, 0.3]},
        "inputs": vec![wo; inputs], "hidden": hidden,
    })
}

/// A file that has nothing but this specification.
fn file_of_spec(spec: &serde_json::Value) -> Vec<u8> {
    let header = json!({"__metadata__": {SPEC_KEY: spec.to_string()}});
    file_of(&header.to_string(), 0)
}

/// Networks with most rows per weight: what tiles take of memory grows with rows alone.
pub fn widest_networks() {
    let network = |role: Role, hidden: serde_json::Value, inputs: usize| {
        let spec: NetworkSpec = serde_json::from_value(spec(role, hidden, inputs)).expect("a specification");
        let layer = |(inputs, outputs)| Dense {
            weight: vec![0.5; inputs * outputs],
            bias: vec![0.0; outputs],
            inputs,
            outputs,
        };
        let net = spec.layers().into_iter().map(layer).collect();
        let file = Network {
            spec,
            frame: Vec::new(),
            net,
        }
        .to_bytes();
        let (taken, network) = peak(|| Network::from_bytes(&file));
        assert!(
            taken <= MULTIPLE * file.len() + (1 << 17),
            "{taken} bytes of {}",
            file.len()
        );
        (file.len(), network.expect("a sound file"))
    };
    for (hidden, inputs) in [(json!([1024, 1]), 1), (json!([1]), 5), (json!([1024, 1024]), 5)] {
        let [(a, sample), (b, eval), (c, pdf)] = Role::ALL.map(|role| network(role, hidden.clone(), inputs));
        let material = BakedMaterial { sample, eval, pdf };
        for tier in Tier::available() {
            let (taken, backend) = peak(|| NativeBackend::new(&material, tier));
            assert!(backend.is_ok());
            let allowed = MULTIPLE * (a + b + c) + OF_TILES;
            assert!(taken <= allowed, "{taken} bytes of {allowed}, {hidden}, {tier:?}");
        }
    }
}
