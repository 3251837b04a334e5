//! The slow, obvious evaluation of networks in f64, one query at a time: what every fast path is tested
//! against, and never optimised.

mod folding;
mod invert;
mod layers;
#[cfg(test)]
mod tests;

pub use folding::{fold, folded, unfold};
pub use invert::{DET_MIN, Inverted, STEP_MAX, exact_pdf, mixture_jacobian};
pub use layers::forward;

use crate::chart::Chart;
use crate::features::Point;
use crate::frame::{FRAME_OUTPUTS, Frame};
use crate::network::{Dense, Network};
use crate::spec::{
    Activation, ChartsSpec, DISK_HEIGHT_MIN, EXPONENT_MAX, Geometry, SHARE_MIN, U_MIN, WARP_SHIFT_MAX,
};

/// Charts with the share of the samples that each gets; the shares add up to 1.
pub type Charts = Vec<(f64, Chart)>;

/// A sampled direction with everything the two estimators need.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OracleSample {
    /// Unit direction to the light.
    pub wi: [f64; 3],
    /// Learned weight, RGB.
    pub weight: [f64; 3],
    /// Signed determinant of u ↦ solid angle, sr, of the drawn chart alone: its share divides it already.
    pub jacobian: f64,
    /// Signed determinant of the drawn chart's own u ↦ its square.
    pub det: f64,
    /// Position in the chart's square, or in that around the disk.
    pub square: [f64; 2],
    /// The drawn chart.
    pub chart: usize,
}

/// Whether `w` is finite and above the horizon.
pub fn above_horizon(w: [f64; 3]) -> bool {
    w.iter().all(|c| c.is_finite()) && w[2] > 0.0
}

/// The charts that the layers of a frame network predict at `params` and a folded `wo`.
pub fn predict_charts(
    spec: &ChartsSpec,
    layers: &[Dense],
    activation: Activation,
    params: &[f64],
    wo: [f64; 3],
) -> Charts {
    let mut features = Vec::new();
    Point::new(params, wo, Some(spec)).append(&spec.inputs, &mut features);
    let outputs = forward(layers, activation, &[features]).swap_remove(0);
    let alpha = spec.alpha_at(params);
    let (frames, logits) = outputs.split_at(FRAME_OUTPUTS * spec.anchors.len());
    let first = match logits {
        [logit] => (1.0 / (1.0 + (-logit).exp())).clamp(SHARE_MIN, 1.0 - SHARE_MIN),
        _ => 1.0,
    };
    let shares = [first, 1.0 - first];
    let outputs = frames.as_chunks::<FRAME_OUTPUTS>().0.iter();
    outputs
        .zip(&spec.anchors)
        .zip(shares)
        .map(|((outputs, anchor), share)| {
            let start = anchor.chart(wo, alpha);
            let frame = Frame::from_outputs(*outputs, &start.frame);
            (share, Chart { frame, ..start })
        })
        .collect()
}

/// The charts that `network` predicts at `params` and a folded `wo`; none without charts.
pub fn charts_of(network: &Network, params: &[f64], wo: [f64; 3]) -> Charts {
    match network.spec.charts() {
        Some(spec) => predict_charts(spec, &network.frame, network.spec.activation, params, wo),
        None => Vec::new(),
    }
}

/// Draws `wi` at `params`, `wo` (above the horizon) and `u` in `[0,1)²` with a sampling network.
pub fn sample(network: &Network, params: &[f64], wo: [f64; 3], u: [f64; 2]) -> OracleSample {
    let (wo, turn) = fold(network.spec.symmetry, wo);
    let charts = charts_of(network, params, wo);
    let mut point = Point::new(params, wo, network.spec.charts());
    let mut u = u.map(|v| v.max(U_MIN));
    let mut share = 1.0;
    if let [(first, _), _] = charts[..] {
        (point.chart, share, u[0]) = match u[0] < first {
            true => (0, first, u[0] / first),
            false => (1, 1.0 - first, (u[0] - first) / (1.0 - first)),
        };
        u[0] = u[0].clamp(U_MIN, 1.0 - U_MIN);
    }
    point.u = u;
    let (out, shift) = shift(network, &point);
    let weight = std::array::from_fn(|c| out[2 + c].clamp(-EXPONENT_MAX, EXPONENT_MAX).exp());
    let mut h = [0.0; 2];
    let mut complement = [0.0; 2];
    let mut gradient = [[0.0; 2]; 2];
    for c in 0..2 {
        let [g, by_u @ ..] = shift[c];
        let (a, b, direct) = match network.spec.geometry {
            Geometry::Charts(_) => (u[c], (1.0 - u[c]) * (-g).exp(), 1.0 / (u[c] * (1.0 - u[c]))),
            Geometry::Disk => (1.0, (-g).exp(), 0.0),
        };
        h[c] = a / (a + b);
        complement[c] = b / (a + b);
        for (j, slope) in gradient[c].iter_mut().enumerate() {
            let direct = if j == c { direct } else { 0.0 };
            *slope = h[c] * complement[c] * (direct + by_u[j]);
        }
    }
    let det = gradient[0][0] * gradient[1][1] - gradient[0][1] * gradient[1][0];
    let (w, area) = match charts.get(point.chart) {
        Some((_, chart)) => chart.square_to_direction(h),
        None => disk_direction(h, complement),
    };
    OracleSample {
        wi: unfold(turn, w),
        weight,
        jacobian: area * det / share,
        det,
        square: h,
        chart: point.chart,
    }
}

/// Outputs of a sampling network, and of its first two g, limited, with its derivatives by u₀ and u₁.
fn shift(network: &Network, point: &Point) -> (Vec<f64>, [[f64; 3]; 2]) {
    let inputs = &network.spec.inputs;
    let mut value = Vec::new();
    point.append(inputs, &mut value);
    let [tx, ty] = point.slopes(inputs);
    let mut out = forward(&network.net, network.spec.activation, &[value, tx, ty]);
    let shift = [0, 1].map(|c: usize| {
        let g = out[0][c].clamp(-WARP_SHIFT_MAX, WARP_SHIFT_MAX);
        let inside = if g == out[0][c] { 1.0 } else { 0.0 };
        [g, inside * out[1][c], inside * out[2][c]]
    });
    (out.swap_remove(0), shift)
}

/// Unit direction over the position `h` of the square around the disk, and dω/dh (sr), 0 outside of the disk.
fn disk_direction(h: [f64; 2], complement: [f64; 2]) -> ([f64; 3], f64) {
    let [x, y] = [0, 1].map(|c: usize| h[c] - complement[c]);
    let z2 = 1.0 - x * x - y * y;
    let least = DISK_HEIGHT_MIN * DISK_HEIGHT_MIN;
    let z = z2.max(least).sqrt();
    let length = (x * x + y * y + z * z).sqrt();
    let area = if z2 > least { 4.0 / z } else { 0.0 };
    ([x / length, y / length, z / length], area)
}

/// What an evaluation or pdf network makes of `params`, `wo`, `wi` (both above the horizon), per output: f_cos of each
/// chart or its density, sr⁻¹, times nothing.
fn parts(network: &Network, params: &[f64], wo: [f64; 3], wi: [f64; 3]) -> (Charts, Vec<f64>) {
    let (wo, turn) = fold(network.spec.symmetry, wo);
    let charts = charts_of(network, params, wo);
    let mut point = Point::new(params, wo, network.spec.charts());
    point.wi = folded(turn, wi);
    for (local, (_, chart)) in point.local.iter_mut().zip(&charts) {
        *local = chart.to_local(point.wi).0;
    }
    let mut features = Vec::new();
    point.append(&network.spec.inputs, &mut features);
    let out = forward(&network.net, network.spec.activation, &[features]).swap_remove(0);
    let per_chart = out.len() / charts.len().max(1);
    let values = out.iter().enumerate().map(|(i, v)| {
        let density = charts
            .get(i / per_chart)
            .map_or(1.0, |(_, chart)| chart.density(point.wi));
        density * v.clamp(-EXPONENT_MAX, EXPONENT_MAX).exp()
    });
    let values = values.collect();
    (charts, values)
}

/// `f_cos` of an evaluation network at `params`, `wo`, `wi`, both above the horizon; RGB, sr⁻¹.
pub fn eval(network: &Network, params: &[f64], wo: [f64; 3], wi: [f64; 3]) -> [f64; 3] {
    let (_, values) = parts(network, params, wo, wi);
    std::array::from_fn(|c| values.iter().skip(c).step_by(3).sum())
}

/// The pdf of a pdf network at `params`, `wo`, `wi`, both above the horizon, sr⁻¹; and of every chart the part of it
/// that is its own, share times density.
pub fn pdf(network: &Network, params: &[f64], wo: [f64; 3], wi: [f64; 3]) -> (f64, Vec<f64>) {
    let (charts, mut values) = parts(network, params, wo, wi);
    for (value, (share, _)) in values.iter_mut().zip(&charts) {
        *value *= share;
    }
    (values.iter().sum(), values)
}

/// The Jacobian that makes `f_cos · jacobian` an unbiased weight: that of the drawn chart, times the share that its
/// learned density has in the pdf at `wi`. Signed, sr.
///
/// The shares of all charts add up to 1 at every `wi` and depend on it alone, so the mean is the albedo whatever the
/// networks learned; they are those of the balance heuristic (Veach and Guibas 1995) for the learned densities.
pub fn jacobian(sample: &OracleSample, pdf_network: &Network, params: &[f64], wo: [f64; 3]) -> f64 {
    match pdf(pdf_network, params, wo, sample.wi) {
        (total, parts) if parts.len() > 1 => sample.jacobian * parts[sample.chart] / total,
        _ => sample.jacobian,
    }
}
