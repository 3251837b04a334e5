//! The one description of a network: input order, encodings, widths, activations, heads, frame and metadata.
//! It travels as JSON in the safetensors `__metadata__` and in the ONNX `metadata_props`.

use crate::encoding::{Encoding, GRAZING_FEATURES, Quantity};
use crate::frame::FRAME_OUTPUTS;
use crate::material::Material;
use serde::{Deserialize, Serialize};

/// Version of [`NetworkSpec`] and of the tensor names; a file of another version is refused.
pub const FORMAT: u32 = 1;

/// Key of the specification in safetensors `__metadata__` and ONNX `metadata_props`.
pub const SPEC_KEY: &str = "bake.spec";

/// Bound of the warp head's g: the map's logit shift. e¹² spans the f32 mantissa twice over.
pub const WARP_SHIFT_MAX: f64 = 12.0;

/// Bound of every exponent in an exp head: e³⁰ ≈ 1e13 exceeds any f_cos a baked material reaches.
pub const EXPONENT_MAX: f64 = 30.0;

/// Smallest u a warp head uses; smaller ones, one in a million, count as this.
///
/// At the edge itself directions lie on the horizon, where dω/du grows as 1/√u while f_cos falls as √u: their
/// product tends to a constant, so the weight loses nothing, and the Jacobian alone stays within f32's means.
pub const U_MIN: f64 = 1.0 / (1u64 << 20) as f64;

/// What a network is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// (wo, u) ↦ position in the frame's square and learned weight: outputs g_x, g_y, ln weight RGB.
    /// The position is h = u / (u + (1 − u)·e^(−g)), so every edge of the square stays on itself.
    Sample,
    /// (wo, wi) ↦ f_cos RGB = frame density · e^output.
    Eval,
    /// (wo, wi) ↦ pdf = frame density · e^output.
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

    /// Number of outputs of the last layer.
    pub fn outputs(self) -> usize {
        match self {
            Role::Sample => 5,
            Role::Eval => 3,
            Role::Pdf => 1,
        }
    }

    /// Inputs of the exported graph, in order; each is a float tensor `[N, width]`.
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
    doc: "Signed determinant of u ↦ solid angle of wi, sr; f·cos θ_i times this is an unbiased weight.",
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

/// Nonlinearity of the hidden layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Activation {
    /// x·σ(x).
    Silu,
}

/// How queries are reduced before anything else.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Symmetry {
    /// The BSDF is mirror-symmetric in x and in y: `wo` is folded to x, y ≥ 0, and `wi` carries the same signs
    /// (sign of 0 is +). Jacobians are those of the folded map, whose orientation is positive.
    Quadrant,
}

/// One quantity with its encoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Input {
    /// What enters.
    pub quantity: Quantity,
    /// How.
    pub encoding: Encoding,
}

impl Input {
    /// Whether networks of `role` have this quantity, in an encoding whose derivatives they need and know.
    pub fn fits(self, role: Role) -> bool {
        match (role, self.quantity) {
            (Role::Sample, Quantity::U) => self.encoding == Encoding::Centred,
            (Role::Sample, Quantity::Wo) | (Role::Eval | Role::Pdf, Quantity::Local | Quantity::Wo) => true,
            (Role::Sample, Quantity::Local) | (Role::Eval | Role::Pdf, Quantity::U) => false,
        }
    }
}

/// The small network that predicts the lobe frame from `wo` alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameSpec {
    /// Hidden widths; input is the grazing encoding of `wo`, output the frame's five numbers.
    pub hidden: Vec<usize>,
    /// Roughness in the anchor of the frame's centre ([`crate::frame::mirror_anchor`]).
    pub anchor_alpha: [f64; 2],
}

/// A network, without its weights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NetworkSpec {
    /// [`FORMAT`].
    pub format: u32,
    /// What it is for.
    pub role: Role,
    /// What it was baked from.
    pub material: Material,
    /// How queries are folded.
    pub symmetry: Symmetry,
    /// Inputs in order.
    pub inputs: Vec<Input>,
    /// Hidden widths.
    pub hidden: Vec<usize>,
    /// Nonlinearity of hidden layers, of the network and of the frame's.
    pub activation: Activation,
    /// The lobe frame.
    pub frame: FrameSpec,
}

impl NetworkSpec {
    /// The warp preset of `role` for `material`.
    pub fn warp(
        role: Role,
        material: Material,
        anchor_alpha: [f64; 2],
        hidden: Vec<usize>,
        frame_hidden: Vec<usize>,
    ) -> Self {
        let wo = Input {
            quantity: Quantity::Wo,
            encoding: Encoding::Grazing,
        };
        let first = match role {
            Role::Sample => Input {
                quantity: Quantity::U,
                encoding: Encoding::Centred,
            },
            Role::Eval | Role::Pdf => Input {
                quantity: Quantity::Local,
                encoding: Encoding::Identity,
            },
        };
        NetworkSpec {
            format: FORMAT,
            role,
            material,
            symmetry: Symmetry::Quadrant,
            inputs: vec![first, wo],
            hidden,
            activation: Activation::Silu,
            frame: FrameSpec {
                hidden: frame_hidden,
                anchor_alpha,
            },
        }
    }

    /// Number of features that enter the first layer.
    pub fn input_features(&self) -> usize {
        self.inputs
            .iter()
            .map(|i| i.encoding.features(i.quantity.scalars()))
            .sum()
    }

    /// (inputs, outputs) of each layer of the network.
    pub fn layers(&self) -> Vec<(usize, usize)> {
        chain(self.input_features(), &self.hidden, self.role.outputs())
    }

    /// (inputs, outputs) of each layer of the frame network.
    pub fn frame_layers(&self) -> Vec<(usize, usize)> {
        chain(GRAZING_FEATURES, &self.frame.hidden, FRAME_OUTPUTS)
    }

    /// Multiply-adds of one query without tangents, frame network included.
    pub fn macs(&self) -> usize {
        self.layers()
            .iter()
            .chain(&self.frame_layers())
            .map(|(i, o)| i * o)
            .sum()
    }

    /// Number of weights and biases, frame network included.
    pub fn parameters(&self) -> usize {
        self.layers()
            .iter()
            .chain(&self.frame_layers())
            .map(|(i, o)| (i + 1) * o)
            .sum()
    }
}

fn chain(inputs: usize, hidden: &[usize], outputs: usize) -> Vec<(usize, usize)> {
    let mut widths = vec![inputs];
    widths.extend_from_slice(hidden);
    widths.push(outputs);
    widths.windows(2).map(|w| (w[0], w[1])).collect()
}
