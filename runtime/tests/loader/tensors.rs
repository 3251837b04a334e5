//! Tensors that contradict the specification, and numbers that no network has.

use crate::file::{File, refused, spoiled};
use bake_runtime::Role;
use safetensors::tensor::Dtype;

#[test]
fn shapes_and_types_that_the_specification_does_not_have() {
    // Sampling networks have 2 + 3 features, four hidden rows and five outputs, as wide as charts need.
    spoiled(
        |f| f.set("net.0.weight", &[5, 4]),
        &["tensor `net.0.weight` is F32 [5, 4], expected F32 [4, 5]"],
    );
    spoiled(|f| f.set("net.0.bias", &[5]), &["`net.0.bias`", "[4]"]);
    spoiled(|f| f.set("net.0.bias", &[4, 1]), &["`net.0.bias` is F32 [4, 1]"]);
    spoiled(|f| f.set("net.0.bias", &[]), &["`net.0.bias` is F32 []"]);
    spoiled(
        |f| f.set("frame.1.weight", &[0, 3]),
        &["`frame.1.weight` is F32 [0, 3]"],
    );
    let halves = |file: &mut File| {
        let (dtype, shape, bytes) = file.tensors.get_mut("frame.0.weight").expect("it is there");
        *dtype = Dtype::F16;
        bytes.truncate(2 * shape.iter().product::<usize>());
    };
    spoiled(halves, &["tensor `frame.0.weight` is F16 [3, 7], expected F32"]);
    let whole = |file: &mut File| file.tensors.get_mut("net.1.bias").expect("it is there").0 = Dtype::I32;
    spoiled(whole, &["tensor `net.1.bias` is I32"]);
}

#[test]
fn tensors_that_are_missing_or_too_many() {
    for name in File::sound(Role::Sample).tensors.keys() {
        let missing = format!("tensor `{name}` is missing");
        spoiled(|file| drop(file.tensors.remove(name)), &[&missing]);
    }
    spoiled(
        |file| file.set("net.2.weight", &[4, 4]),
        &["its tensors have", "its specification says"],
    );
}

#[test]
fn a_specification_of_more_than_the_file_holds() {
    spoiled(
        |file| file.spec["hidden"] = serde_json::json!(vec![1024; 64]),
        &["`net.0.weight` is F32 [4, 5], expected F32 [1024, 5]"],
    );
}

#[test]
fn weights_that_are_not_finite() {
    for role in Role::ALL {
        let sound = File::sound(role);
        for (name, (.., bytes)) in &sound.tensors {
            for bad in [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                for at in [0, bytes.len() - 4] {
                    let mut file = sound.clone();
                    let (.., bytes) = file.tensors.get_mut(name).expect("it is there");
                    bytes[at..at + 4].copy_from_slice(&bad.to_le_bytes());
                    let reason = format!("tensor `{name}` holds values that are not finite");
                    refused(&file.bytes(), &[&reason]);
                }
            }
        }
    }
}
