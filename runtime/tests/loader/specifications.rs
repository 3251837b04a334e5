//! Specifications that no program of this format wrote.

use crate::file::{File, spoiled};
use bake_runtime::Role;
use bake_runtime::network::parse_spec;
use serde_json::{Value, json};

/// Asserts that the specification of every role is refused once `value` stands at `pointer`.
fn refused(pointer: &str, value: Value, parts: &[&str]) {
    let spoil = |file: &mut File| {
        let place = file.spec.pointer_mut(pointer);
        *place.unwrap_or_else(|| panic!("{pointer} is there")) = value.clone();
    };
    spoiled(spoil, parts);
}

#[test]
fn other_versions() {
    for (version, shown) in [
        (json!(1), "1"),
        (json!(3), "3"),
        (json!(u64::MAX), "18446744073709551615"),
        (json!(-2), "none"),
        (json!("2"), "none"),
        (Value::Null, "none"),
    ] {
        let reason = format!("its format version is {shown}, this program reads 2");
        refused("/format", version, &[&reason]);
    }
    spoiled(|file| file.spec = json!([]), &["its format version is none"]);
}

#[test]
fn texts_that_are_no_specification() {
    let refused = |json: &str, part: &str| {
        let reason = parse_spec(json).expect_err(part);
        assert!(reason.contains(part), "`{part}` is not in: {reason}");
    };
    let sound = File::sound(Role::Sample).spec.to_string();
    assert!(parse_spec(&sound).is_ok());
    for end in 0..sound.len() {
        refused(&sound[..end], "not JSON");
    }
    refused(&"[".repeat(20_000), "not JSON");
    refused(&sound.replace("0.2", "1e999"), "not JSON");
    refused(&sound.replace("0.2", "NaN"), "not JSON");
    refused(
        &" ".repeat(1 << 20),
        "its specification has 1048576 bytes, more than 32768",
    );
    refused(r#"{"format": 2}"#, "its specification is incomplete");
}

#[test]
fn sizes_that_no_file_has_room_for() {
    for size in [0, 1025, 1_000_000_000, u64::MAX] {
        let wide = "layers are not 1..1024 wide and at most 64 deep";
        refused("/hidden", json!([size]), &["its hidden", wide]);
        refused(
            "/geometry/charts/hidden/0",
            json!(size),
            &["its frame network's", wide],
        );
        for encoding in ["one_blob", "frequency"] {
            let encoding = json!({encoding: size});
            let suits = "the encoding does not suit it";
            refused("/inputs/0/encoding", encoding.clone(), &[suits]);
            refused("/geometry/charts/inputs/0/encoding", encoding, &[suits]);
        }
    }
    refused("/hidden", json!(vec![1; 65]), &["at most 64 deep"]);
    refused("/hidden", json!(-1), &["incomplete"]);
    refused("/hidden", json!([1e9]), &["incomplete"]);
    let wo = json!({"quantity": "wo", "encoding": "identity"});
    refused(
        "/inputs",
        json!(vec![&wo; 65]),
        &["has 65 inputs, expected 1..64"],
    );
    refused("/inputs", json!([]), &["has 0 inputs"]);
    let anchor = json!({"quantity": "anchor", "encoding": {"one_blob": 64}});
    refused(
        "/inputs",
        json!(vec![&anchor; 3]),
        &["the inputs of its network have 1152 features, more than 1024"],
    );
    refused(
        "/geometry/charts/inputs",
        json!(vec![&anchor; 64]),
        &["the inputs of its frame network have 24576 features"],
    );
    for count in [0, 3, 2000] {
        refused(
            "/geometry/charts/anchors",
            json!(vec!["mirror"; count]),
            &[&format!("it has {count} charts, expected 1..2")],
        );
    }
}

#[test]
fn numbers_of_things_that_are_not_there() {
    for number in [1, 1_000_000_000, u64::MAX] {
        let parameter = json!({"parameter": number});
        refused(
            "/inputs/1/quantity",
            parameter.clone(),
            &["it is not asked for that"],
        );
        refused(
            "/geometry/charts/inputs/0/quantity",
            parameter,
            &["it is not asked for that"],
        );
        refused(
            "/geometry/charts/alpha/0/free/parameter",
            json!(number),
            &["its charts cannot start from the roughness"],
        );
    }
    for chart in [2, 1_000_000_000, u64::MAX] {
        refused(
            "/inputs/0/quantity",
            json!({"local": chart}),
            &["it is not asked for that"],
        );
    }
    refused(
        "/geometry/charts/inputs/0/quantity",
        json!("u"),
        &["it is not asked for that"],
    );
}

#[test]
fn numbers_that_single_precision_cannot_carry() {
    for range in [
        [0.5, 0.1],
        [0.1, 0.1],
        [0.0, 1e-300],
        [1e300, 2e300],
        [-1e308, 1e308],
    ] {
        for scale in ["linear", "sqrt", "decay"] {
            refused(
                "/inputs/1/scale",
                json!({scale: range}),
                &["the scale has no range"],
            );
        }
    }
    let start = "its charts cannot start from the roughness";
    for alpha in [0.0, -0.1, 1e-300, 9.9e-5, 10.1, 1e300] {
        refused("/geometry/charts/alpha/1/fixed", json!(alpha), &[start]);
    }
    for factor in [0.0, -1.0, 10.1, 1e300] {
        refused("/geometry/charts/alpha/0/free/factor", json!(factor), &[start]);
    }
    for power in [0, 3, 255] {
        refused("/geometry/charts/alpha/0/free/power", json!(power), &[start]);
    }
}

#[test]
fn materials_that_make_no_sense() {
    let reversed = json!({"min": 0.5, "max": 0.1});
    refused("/material/alpha/0", reversed, &["`alpha[0]`", "swap them"]);
    refused("/material/alpha/1", json!(1e-5), &["`alpha[1]`", "0.0001..1"]);
    refused(
        "/material/alpha",
        json!(vec![0.1; 5000]),
        &["`alpha`", "an array of length 2"],
    );
    refused("/material/family", json!("plastic"), &["`family`", "`conductor`"]);
    refused("/material/name", json!(5), &["`name`"]);
    refused("/material", json!([]), &["a table"]);
}

#[test]
fn keys_that_are_given_twice() {
    let sound = File::sound(Role::Eval).spec.to_string();
    for (key, part) in [
        (r#""alpha":[1,1],"reflectance":"#, "`alpha` is given twice"),
        (r#""name":"lid","reflectance":"#, "`name` is given twice"),
    ] {
        let twice = sound.replace(r#""reflectance":"#, key);
        let reason = parse_spec(&twice).expect_err(part);
        assert!(reason.contains(part), "`{part}` is not in: {reason}");
    }
    let twice = sound.replace(r#""hidden":"#, r#""hidden":[2],"hidden":"#);
    assert!(parse_spec(&twice).is_err_and(|reason| reason.contains("duplicate field `hidden`")));
}

#[test]
fn files_that_a_material_names_are_left_alone() {
    let mut spec = File::sound(Role::Pdf).spec;
    let missing = "/nowhere/at/all.safetensors";
    spec["material"] =
        json!({"name": "rim", "family": "imported", "file": missing, "p": {"min": 0, "max": 1}});
    let spec = parse_spec(&spec.to_string()).expect("its file is not looked for");
    assert!(spec.material.reference().is_err());
}
