//! The paper's preset: the encodings of Table 1, six hidden layers, ReLU, positions on the disk (Bai et al. 2023).
//!
//! Table 1 is not in the paper's text layer; `findings` of a third party give it. Ours, because it does not say: directions
//! enter as (x, y) on the disk carried to [0, 1]; frequencies are multiplied by π; the Gaussians of one-blob encodings are
//! as wide as a bin; every scalar is carried to [0, 1] over the domain's range first. Table 1 has no colour for Disney's
//! materials, whose domains here leave it free: it enters as it is, as the layered materials' albedo does.

use super::symmetry;
use crate::error::Result;
use bake_runtime::encoding::{Encoding, Quantity, Scale};
use bake_runtime::spec::{Activation, FORMAT, Geometry, Input};
use bake_runtime::{Family, Material, NetworkSpec, Role};

/// Hidden layers of the sampling network.
const SAMPLE_LAYERS: usize = 6;
/// Hidden layers of the evaluation and pdf networks.
const DENSITY_HIDDEN: [usize; 6] = [64, 32, 32, 32, 32, 32];
/// Bins, and frequencies, of each direction and random number.
const DIRECTION_CHANNELS: usize = 12;

/// The specification of `role` for `material`.
///
/// # Errors
/// As [`symmetry`].
pub fn spec(role: Role, material: &Material) -> Result<NetworkSpec> {
    let direction = match material.family {
        Family::Conductor | Family::Imported => Encoding::Frequency(DIRECTION_CHANNELS),
        Family::Layered | Family::Principled => Encoding::OneBlob(DIRECTION_CHANNELS),
    };
    let mut inputs: Vec<Input> = material
        .free()
        .iter()
        .enumerate()
        .map(|(i, (label, min, max))| parameter_input(material.family, i, label, [*min, *max]))
        .collect();
    let disk = |quantity| Input {
        quantity,
        scale: Scale::Linear([-1.0, 1.0]),
        encoding: direction,
    };
    inputs.push(disk(Quantity::WoDisk));
    inputs.push(match role {
        Role::Sample => Input::plain(Quantity::U, direction),
        Role::Eval | Role::Pdf => disk(Quantity::WiDisk),
    });
    let width = if material.family == Family::Layered {
        128
    } else {
        64
    };
    Ok(NetworkSpec {
        format: FORMAT,
        role,
        material: material.clone(),
        symmetry: symmetry(material)?,
        inputs,
        hidden: match role {
            Role::Sample => vec![width; SAMPLE_LAYERS],
            Role::Eval | Role::Pdf => DENSITY_HIDDEN.to_vec(),
        },
        activation: Activation::Relu,
        geometry: Geometry::Disk,
    })
}

/// A row of Table 1.
fn parameter_input(family: Family, index: usize, label: &str, range: [f64; 2]) -> Input {
    let (scale, encoding) = match (family, label.split('[').next().unwrap_or(label)) {
        (Family::Conductor, _) => (Scale::Linear(range), Encoding::Frequency(4)),
        (Family::Layered, "alpha") => (Scale::Decay(range), Encoding::OneBlob(4)),
        (Family::Layered, "eta") => (Scale::Linear(range), Encoding::OneBlob(4)),
        (Family::Layered, "sigma_t") => (Scale::Linear(range), Encoding::OneBlob(5)),
        (Family::Principled, "roughness") => (Scale::Decay(range), Encoding::OneBlob(8)),
        (Family::Principled, "metallic") => (Scale::Linear(range), Encoding::OneBlob(8)),
        _ => (Scale::Linear(range), Encoding::Identity),
    };
    Input {
        quantity: Quantity::Parameter(index),
        scale,
        encoding,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::field::Fields;
    use std::path::Path;

    fn features(json: &str, role: Role) -> usize {
        let fields: Fields = serde_json::from_str(json).expect("valid JSON");
        let material = Material::read("m", fields, Path::new("")).expect("known parameters");
        let spec = spec(role, &material).expect("can be baked");
        spec.validate().expect("sound");
        spec.input_features()
    }

    /// The widths that Table 1 states.
    #[test]
    fn inputs_are_as_wide_as_in_table_1() {
        let free = r#"{"min":0.01,"max":1}"#;
        let conductor = format!(
            r#"{{"family":"conductor","alpha":[{free},{free}],"reflectance":[{free},{free},{free}]}}"#
        );
        assert_eq!(features(&conductor, Role::Sample), 136);
        assert_eq!(features(&conductor, Role::Eval), 136);
        let eta = r#"{"min":1.05,"max":2.5}"#;
        let layered = format!(
            r#"{{"family":"layered","alpha":{free},"eta":{eta},"sigma_t":{free},"albedo":[{free},{free},{free}],"base":[1,1,1]}}"#
        );
        assert_eq!(features(&layered, Role::Sample), 64);
        let disney = format!(r#"{{"family":"principled","metallic":{free},"roughness":{free}}}"#);
        assert_eq!(features(&disney, Role::Pdf), 64);
    }
}
