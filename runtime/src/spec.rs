//! The one description of a network: input order, encodings, widths, activations, heads, frame and metadata.
//! It travels as JSON in the safetensors `__metadata__` and in the ONNX `metadata_props`.

mod role;
mod validation;

pub use role::{Port, Role, params_port};

use crate::anchor::Anchor;
use crate::encoding::{Encoding, Quantity, Scale};
use crate::frame::FRAME_OUTPUTS;
use crate::material::Material;
use serde::{Deserialize, Serialize};

/// Version of [`NetworkSpec`] and of the tensor names; a file of another version is refused.
pub const FORMAT: u32 = 2;

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

/// Most charts that a network may have.
pub const CHARTS_MAX: usize = 2;

/// Smallest share of the samples that a chart gets: each must be able to draw what the others hardly do.
pub const SHARE_MIN: f64 = 1.0 / 64.0;

/// Smallest height of a direction that a disk head gives: positions on the rim of the disk and outside of it go there.
pub const DISK_HEIGHT_MIN: f64 = 1e-3;

/// Nonlinearity of the hidden layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Activation {
    /// x·σ(x).
    Silu,
    /// max(x, 0), with slope 0 at 0.
    Relu,
}

/// How queries are reduced before anything else. Jacobians are those of the folded map, whose orientation is positive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Symmetry {
    /// The BSDF is mirror-symmetric in x and in y: `wo` is folded to x, y ≥ 0, and `wi` carries the same signs
    /// (sign of 0 is +).
    Quadrant,
    /// The BSDF has no direction: `wo` is turned around the normal to y = 0, x ≥ 0, and `wi` with it (by nothing where
    /// `wo` is the normal).
    Rotation,
}

/// One quantity with its scale and encoding.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Input {
    /// What enters.
    pub quantity: Quantity,
    /// What is done to its scalars first.
    #[serde(default)]
    pub scale: Scale,
    /// How they become features.
    pub encoding: Encoding,
}

impl Input {
    /// `quantity` in this encoding, its scalars as they are.
    pub fn plain(quantity: Quantity, encoding: Encoding) -> Input {
        Input {
            quantity,
            scale: Scale::None,
            encoding,
        }
    }

    /// Number of features.
    pub fn features(self) -> usize {
        self.encoding.features(self.quantity.scalars())
    }
}

/// One axis of the roughness that a mirror chart starts from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Roughness {
    /// The material fixes it; [`Roughness::MIN`] to [`Roughness::MAX`].
    Fixed(f64),
    /// max([`Roughness::MIN`], factor·pᵖᵒʷᵉʳ) of the free parameter of this number; `power` is 1 or 2.
    Free {
        /// Number of the free parameter.
        parameter: usize,
        /// What its power is multiplied by; > 0, at most [`Roughness::MAX`].
        factor: f64,
        /// 1 or 2.
        power: u8,
    },
}

impl Roughness {
    /// Smallest roughness that a start has.
    pub const MIN: f64 = 1e-4;

    /// Largest fixed roughness and largest factor: anisotropy stretches a principled roughness of 1 to 3.2.
    pub const MAX: f64 = 10.0;

    /// Its value where the free parameters are `params`.
    pub fn at(self, params: &[f64]) -> f64 {
        match self {
            Roughness::Fixed(value) => value,
            Roughness::Free {
                parameter,
                factor,
                power,
            } => (factor * params[parameter].powi(power.into())).max(Roughness::MIN),
        }
    }
}

/// The charts of a network, predicted by a small network of their own from the parameters and `wo`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChartsSpec {
    /// Where each chart starts from; 1 to [`CHARTS_MAX`].
    pub anchors: Vec<Anchor>,
    /// Roughness along x and y.
    pub alpha: [Roughness; 2],
    /// Inputs of the frame network.
    pub inputs: Vec<Input>,
    /// Its hidden widths; its outputs are [`FRAME_OUTPUTS`] per chart and, with two charts, the logit of the first one's
    /// share.
    pub hidden: Vec<usize>,
}

impl ChartsSpec {
    /// Number of outputs of the frame network.
    pub fn outputs(&self) -> usize {
        FRAME_OUTPUTS * self.anchors.len() + self.anchors.len().saturating_sub(1)
    }
}

/// Where directions live, and with it what the outputs of a network mean.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Geometry {
    /// In the squares of charts (the warp preset).
    ///
    /// Sample: g_x, g_y, ln weight RGB. The position is h = u / (u + (1 − u)·e^(−g)), so every edge of the square stays on
    /// itself. With two charts, the one whose share u₀ falls into is drawn, and u₀ is stretched over it.
    /// Eval: f_cos = Σ over charts of the chart's density · e^output, RGB per chart.
    /// Pdf: the density of chart i is that of its frame · e^output; the pdf is their sum weighted by the shares.
    Charts(ChartsSpec),
    /// On the disk [−1, 1]² of (x, y) (the paper preset).
    ///
    /// Sample: (x, y) = 2σ(output) − 1, ln weight RGB. Eval and pdf: e^output.
    Disk,
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
    /// Where directions live.
    pub geometry: Geometry,
}

impl NetworkSpec {
    /// The charts, where there are any.
    pub fn charts(&self) -> Option<&ChartsSpec> {
        match &self.geometry {
            Geometry::Charts(charts) => Some(charts),
            Geometry::Disk => None,
        }
    }

    /// Number of features that enter the first layer.
    pub fn input_features(&self) -> usize {
        self.inputs.iter().map(|i| i.features()).sum()
    }

    /// Number of outputs of the last layer.
    pub fn outputs(&self) -> usize {
        let charts = self.charts().map_or(1, |c| c.anchors.len());
        match self.role {
            Role::Sample => 5,
            Role::Eval => 3 * charts,
            Role::Pdf => charts,
        }
    }

    /// (inputs, outputs) of each layer of the network.
    pub fn layers(&self) -> Vec<(usize, usize)> {
        chain(self.input_features(), &self.hidden, self.outputs())
    }

    /// (inputs, outputs) of each layer of the frame network; empty where there is none.
    pub fn frame_layers(&self) -> Vec<(usize, usize)> {
        self.charts().map_or(Vec::new(), |charts| {
            let features = charts.inputs.iter().map(|i| i.features()).sum();
            chain(features, &charts.hidden, charts.outputs())
        })
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
