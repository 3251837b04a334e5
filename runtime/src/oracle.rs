//! The slow, obvious evaluation of a network in f64, one query at a time: what every fast path is tested
//! against, and never optimised.

use crate::encoding::{Encoding, Quantity};
use crate::frame::{FRAME_OUTPUTS, Frame, mirror_anchor};
use crate::network::{Dense, Network};
use crate::spec::{Activation, EXPONENT_MAX, Symmetry, U_MIN, WARP_SHIFT_MAX};

/// A sampled direction with everything the two estimators need.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OracleSample {
    /// Unit direction to the light.
    pub wi: [f64; 3],
    /// Learned weight, RGB.
    pub weight: [f64; 3],
    /// Signed determinant of u ↦ solid angle, sr.
    pub jacobian: f64,
    /// Signed determinant of u ↦ the frame's square.
    pub det: f64,
    /// Position in the frame's square.
    pub square: [f64; 2],
}

/// Whether `w` is finite and above the horizon.
pub fn above_horizon(w: [f64; 3]) -> bool {
    w.iter().all(|c| c.is_finite()) && w[2] > 0.0
}

/// `wo` folded by `symmetry`, and the signs that unfold `wi`.
pub fn fold(symmetry: Symmetry, wo: [f64; 3]) -> ([f64; 3], [f64; 2]) {
    match symmetry {
        Symmetry::Quadrant => {
            let sign = |v: f64| if v < 0.0 { -1.0 } else { 1.0 };
            ([wo[0].abs(), wo[1].abs(), wo[2]], [sign(wo[0]), sign(wo[1])])
        }
    }
}

/// The lobe frame that `network` predicts for a folded `wo`.
pub fn frame_of(network: &Network, wo: [f64; 3]) -> Frame {
    predict_frame(
        &network.frame,
        network.spec.activation,
        network.spec.frame.anchor_alpha,
        wo,
    )
}

/// The lobe frame that the layers of a frame network predict for a folded `wo`.
pub fn predict_frame(
    layers: &[Dense],
    activation: Activation,
    anchor_alpha: [f64; 2],
    wo: [f64; 3],
) -> Frame {
    let mut features = Vec::new();
    Encoding::Grazing.append(&wo, &mut features);
    let outputs = forward(layers, activation, &[features]);
    let outputs: [f64; FRAME_OUTPUTS] = std::array::from_fn(|i| outputs[0][i]);
    Frame::from_outputs(outputs, mirror_anchor(wo, anchor_alpha))
}

/// Draws `wi` for `wo` (above the horizon) and `u` in `[0,1)²` with a sampling network.
pub fn sample(network: &Network, wo: [f64; 3], u: [f64; 2]) -> OracleSample {
    let (wo, signs) = fold(network.spec.symmetry, wo);
    let u = u.map(|v| v.max(U_MIN));
    let mut value = Vec::new();
    let mut tangents = [Vec::new(), Vec::new()];
    for input in &network.spec.inputs {
        match (input.quantity, input.encoding) {
            (Quantity::U, Encoding::Centred) => {
                input.encoding.append(&u, &mut value);
                tangents[0].extend([2.0, 0.0]);
                tangents[1].extend([0.0, 2.0]);
            }
            (_, encoding) => {
                encoding.append(&wo, &mut value);
                tangents.iter_mut().for_each(|t| t.resize(value.len(), 0.0));
            }
        }
    }
    let [tx, ty] = tangents;
    let out = forward(&network.net, network.spec.activation, &[value, tx, ty]);
    let mut h = [0.0; 2];
    let mut complement = [0.0; 2];
    let mut gradient = [[0.0; 2]; 2];
    for c in 0..2 {
        let g = out[0][c].clamp(-WARP_SHIFT_MAX, WARP_SHIFT_MAX);
        let clamped = g != out[0][c];
        let (a, b) = (u[c], (1.0 - u[c]) * (-g).exp());
        h[c] = a / (a + b);
        complement[c] = b / (a + b);
        for (j, row) in gradient[c].iter_mut().enumerate() {
            let direct = if j == c { 1.0 / (u[c] * (1.0 - u[c])) } else { 0.0 };
            let shift = if clamped { 0.0 } else { out[1 + j][c] };
            *row = h[c] * complement[c] * (direct + shift);
        }
    }
    let det = gradient[0][0] * gradient[1][1] - gradient[0][1] * gradient[1][0];
    let (w, jacobian_cos) = frame_of(network, wo).square_to_direction(h, complement);
    OracleSample {
        wi: [signs[0] * w[0], signs[1] * w[1], w[2]],
        weight: std::array::from_fn(|c| out[0][2 + c].clamp(-EXPONENT_MAX, EXPONENT_MAX).exp()),
        jacobian: jacobian_cos / w[2] * det,
        det,
        square: h,
    }
}

/// `f_cos` (eval network, RGB) or pdf (pdf network, first element) at `wo`, `wi`, both above the horizon; sr⁻¹.
pub fn density(network: &Network, wo: [f64; 3], wi: [f64; 3]) -> Vec<f64> {
    let (wo, signs) = fold(network.spec.symmetry, wo);
    let wi = [signs[0] * wi[0], signs[1] * wi[1], wi[2]];
    let (local, frame_density) = frame_of(network, wo).to_local(wi);
    let mut features = Vec::new();
    for input in &network.spec.inputs {
        let values = if input.quantity == Quantity::Local {
            local
        } else {
            wo
        };
        input.encoding.append(&values, &mut features);
    }
    let out = forward(&network.net, network.spec.activation, &[features]);
    out[0]
        .iter()
        .map(|v| frame_density * v.clamp(-EXPONENT_MAX, EXPONENT_MAX).exp())
        .collect()
}

/// Layers on a value and its tangents: `columns[0]` is the value, the rest are directional derivatives.
fn forward(layers: &[Dense], activation: Activation, columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut columns = columns.to_vec();
    for (i, layer) in layers.iter().enumerate() {
        let mut next: Vec<Vec<f64>> = Vec::new();
        for (c, column) in columns.iter().enumerate() {
            let rows = layer.weight.chunks_exact(layer.inputs);
            let dot = rows.map(|row| {
                row.iter()
                    .zip(column)
                    .map(|(&w, x)| f64::from(w) * x)
                    .sum::<f64>()
            });
            next.push(match c {
                0 => dot.zip(&layer.bias).map(|(v, &b)| v + f64::from(b)).collect(),
                _ => dot.collect(),
            });
        }
        if i + 1 < layers.len() {
            let slopes: Vec<(f64, f64)> = next[0].iter().map(|&x| activate(activation, x)).collect();
            for (c, column) in next.iter_mut().enumerate() {
                for (v, (value, slope)) in column.iter_mut().zip(&slopes) {
                    *v = if c == 0 { *value } else { *v * slope };
                }
            }
        }
        columns = next;
    }
    columns
}

/// Value and derivative of the activation.
fn activate(activation: Activation, x: f64) -> (f64, f64) {
    match activation {
        Activation::Silu => {
            let sigmoid = 1.0 / (1.0 + (-x).exp());
            (x * sigmoid, sigmoid * (1.0 + x * (1.0 - sigmoid)))
        }
    }
}
