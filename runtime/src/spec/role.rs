//! What networks are for, and the inputs and outputs that an exported graph has.

use serde::{Deserialize, Serialize};

/// What a network is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// (parameters, wo, u) ↦ wi, learned weight RGB, signed Jacobian: see [`super::Geometry`] for the outputs.
    Sample,
    /// (parameters, wo, wi) ↦ f_cos RGB.
    Eval,
    /// (parameters, wo, wi) ↦ pdf.
    Pdf,
}

impl Role {
    /// All roles, in the order in which a material's files are listed.
    pub const ALL: [Role; 3] = [Role::Sample, Role::Eval, Role::Pdf];

    /// Stem of the files.
    pub fn name(self) -> &'static str {
        match self {
            Role::Sample => "sample",
            Role::Eval => "eval",
            Role::Pdf => "pdf",
        }
    }

    /// Inputs of the exported graph after the parameters, in order; each is a float tensor `[N, width]`. Where parameters
    /// are free, `params` `[N, number of free scalars]` ([`params_port`]) comes before them.
    pub fn graph_inputs(self) -> &'static [Port; 2] {
        match self {
            Role::Sample => &[WO_PORT, U_PORT],
            Role::Eval | Role::Pdf => &[WO_PORT, WI_PORT],
        }
    }

    /// Outputs of the exported graph, in order; each is a float tensor `[N, width]`.
    pub fn graph_outputs(self) -> &'static [Port] {
        match self {
            Role::Sample => &[WI_PORT, WEIGHT_PORT, JACOBIAN_PORT],
            Role::Eval => &[F_COS_PORT],
            Role::Pdf => &[PDF_PORT],
        }
    }
}

/// The graph input that holds `count` free parameters.
pub fn params_port(count: usize) -> Port {
    Port {
        name: "params",
        width: count,
        doc: "Values of the free parameters, in the order of the specification's material.",
    }
}

/// One input or output of an exported graph.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Port {
    /// Name of the tensor.
    pub name: &'static str,
    /// Number of columns.
    pub width: usize,
    /// What it holds, with its unit; stands in the ONNX file.
    pub doc: &'static str,
}

const WO_PORT: Port = Port {
    name: "wo",
    width: 3,
    doc: "Unit direction to the camera, shading frame (z = normal), away from the surface.",
};
const WI_PORT: Port = Port {
    name: "wi",
    width: 3,
    doc: "Unit direction to the light, shading frame (z = normal), away from the surface.",
};
const U_PORT: Port = Port {
    name: "u",
    width: 2,
    doc: "Two uniform numbers in [0, 1).",
};
const WEIGHT_PORT: Port = Port {
    name: "weight",
    width: 3,
    doc: "Learned f·cos θ_i / pdf of wi, RGB, dimensionless, not negative.",
};
const JACOBIAN_PORT: Port = Port {
    name: "jacobian",
    width: 1,
    doc: "Signed, sr; f·cos θ_i times this is an unbiased weight. With one chart, or on the disk, the determinant of u ↦ \
          solid angle of wi; with two charts that of the drawn one, times the share of its learned density in the pdf.",
};
const F_COS_PORT: Port = Port {
    name: "f_cos",
    width: 3,
    doc: "BSDF times cos θ_i, RGB, per steradian.",
};
const PDF_PORT: Port = Port {
    name: "pdf",
    width: 1,
    doc: "Learned density of wi per steradian, for weights of multiple importance sampling; never divide by it.",
};
