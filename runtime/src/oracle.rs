//! The slow, obvious evaluation of networks in f64, one query at a time: what every fast path is tested
//! against, and never optimised.

mod invert;

pub use invert::{DET_MIN, Inverted, STEP_MAX, exact_pdf, mixture_jacobian};

use crate::chart::Chart;
use crate::features::Point;
use crate::frame::{FRAME_OUTPUTS, Frame};
use crate::network::{Dense, Network};
use crate::spec::{
    Activation, ChartsSpec, DISK_HEIGHT_MIN, EXPONENT_MAX, Geometry, SHARE_MIN, Symmetry, U_MIN,
    WARP_SHIFT_MAX,
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

/// `wo` folded by `symmetry`, and the columns of the orthogonal matrix M with x, y of `wi` = M·(x, y of folded `wi`).
pub fn fold(symmetry: Symmetry, wo: [f64; 3]) -> ([f64; 3], [[f64; 2]; 2]) {
    let [x, y, z] = wo;
    match symmetry {
        Symmetry::Quadrant => {
            let sign = |v: f64| if v < 0.0 { -1.0 } else { 1.0 };
            ([x.abs(), y.abs(), z], [[sign(x), 0.0], [0.0, sign(y)]])
        }
        Symmetry::Rotation => {
            let sin = x.hypot(y);
            let [c, s] = if sin > 0.0 { [x / sin, y / sin] } else { [1.0, 0.0] };
            ([sin, 0.0, z], [[c, s], [-s, c]])
        }
    }
}

/// The direction whose fold is `w`.
pub fn unfold([first, second]: [[f64; 2]; 2], w: [f64; 3]) -> [f64; 3] {
    [
        first[0] * w[0] + second[0] * w[1],
        first[1] * w[0] + second[1] * w[1],
        w[2],
    ]
}

/// `w` folded with the matrix of [`fold`].
pub fn folded([first, second]: [[f64; 2]; 2], w: [f64; 3]) -> [f64; 3] {
    [
        first[0] * w[0] + first[1] * w[1],
        second[0] * w[0] + second[1] * w[1],
        w[2],
    ]
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

/// Layers on a value and its tangents: `columns[0]` is the value, the rest are directional derivatives.
pub fn forward(layers: &[Dense], activation: Activation, columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
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
        Activation::Relu => match x > 0.0 {
            true => (x, 1.0),
            false => (0.0, 0.0),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::anchor::Anchor;
    use crate::bsdf::{direction, shifted_r2};
    use crate::encoding::{Encoding, Quantity, Scale};
    use crate::random::Rng;
    use crate::spec::{FORMAT, Input, NetworkSpec, Role, Roughness};
    use crate::{Family, Material};

    /// Central differences with step 1e-6.
    const DIFFERENCE_TOL: f64 = 1e-5;
    /// The mean over 2¹⁶ R2 points of a weight that varies by a factor of a few.
    const MEAN_TOL: f64 = 3e-3;
    /// Two quadratures of one smooth function.
    const QUADRATURE_TOL: f64 = 2e-3;

    pub fn random(spec: NetworkSpec, seed: u64) -> Network {
        let mut rng = Rng::new(&[0x0ac1e, seed]);
        let mut layers = |shapes: Vec<(usize, usize)>| -> Vec<Dense> {
            let dense = |(inputs, outputs): (usize, usize)| Dense {
                weight: (0..inputs * outputs)
                    .map(|_| ((rng.uniform() - 0.5) * 2.5 / (inputs as f64).sqrt()) as f32)
                    .collect(),
                bias: vec![0.05; outputs],
                inputs,
                outputs,
            };
            shapes.into_iter().map(dense).collect()
        };
        let (frame, net) = (layers(spec.frame_layers()), layers(spec.layers()));
        Network { spec, frame, net }
    }

    fn spec(role: Role, geometry: Geometry, inputs: Vec<Input>) -> NetworkSpec {
        let material = Material::fixed(
            "metal",
            Family::Conductor,
            &[("alpha", &[0.3; 2]), ("reflectance", &[0.9; 3])],
        );
        let spec = NetworkSpec {
            format: FORMAT,
            role,
            material: material.expect("valid parameters"),
            symmetry: Symmetry::Rotation,
            inputs,
            hidden: vec![8, 8],
            activation: Activation::Silu,
            geometry,
        };
        spec.validate().expect("a sound specification");
        spec
    }

    pub fn charts() -> Geometry {
        Geometry::Charts(ChartsSpec {
            anchors: vec![Anchor::Mirror, Anchor::Diffuse],
            alpha: [Roughness::Fixed(0.3); 2],
            inputs: vec![
                Input::plain(Quantity::Wo, Encoding::Slant),
                Input::plain(Quantity::Anchor, Encoding::Identity),
            ],
            hidden: vec![6],
        })
    }

    pub fn sampler(geometry: Geometry, encoding: Encoding) -> Network {
        let chart = match &geometry {
            Geometry::Charts(charts) if charts.anchors.len() > 1 => Quantity::Chart,
            _ => Quantity::WoDisk,
        };
        let inputs = vec![
            Input::plain(Quantity::U, encoding),
            Input::plain(chart, Encoding::Identity),
            Input {
                quantity: Quantity::Wo,
                scale: Scale::Linear([-1.0, 1.0]),
                encoding: Encoding::Identity,
            },
        ];
        random(spec(Role::Sample, geometry, inputs), 1)
    }

    pub fn densities(role: Role) -> Network {
        let inputs = vec![
            Input::plain(Quantity::Local(0), Encoding::Identity),
            Input::plain(Quantity::Local(1), Encoding::Identity),
        ];
        random(spec(role, charts(), inputs), 2)
    }

    #[test]
    fn jacobians_are_those_of_the_directions() {
        let wo = direction(55.0, 130.0).to_array();
        for (geometry, encoding) in [
            (charts(), Encoding::Centred),
            (charts(), Encoding::OneBlob(4)),
            (Geometry::Disk, Encoding::Frequency(2)),
        ] {
            let network = sampler(geometry, encoding);
            for k in 0..200 {
                let u = shifted_r2(k, [0.0; 2]).map(|v| 0.02 + 0.96 * v);
                let here = sample(&network, &[], wo, u);
                let h = 1e-6;
                let at = |du: [f64; 2]| sample(&network, &[], wo, [u[0] + du[0], u[1] + du[1]]);
                let ends = [at([h, 0.0]), at([-h, 0.0]), at([0.0, h]), at([0.0, -h])];
                if ends.iter().any(|e| e.chart != here.chart) {
                    continue;
                }
                let difference = |a: &OracleSample, b: &OracleSample| {
                    [0, 1, 2].map(|c: usize| (a.wi[c] - b.wi[c]) / (2.0 * h))
                };
                let (x, y) = (difference(&ends[0], &ends[1]), difference(&ends[2], &ends[3]));
                let cross = [
                    x[1] * y[2] - x[2] * y[1],
                    x[2] * y[0] - x[0] * y[2],
                    x[0] * y[1] - x[1] * y[0],
                ];
                let found: f64 = cross.iter().zip(here.wi).map(|(a, b)| a * b).sum();
                let tol = DIFFERENCE_TOL * (1.0 + here.jacobian.abs());
                let inside = here.jacobian != 0.0;
                assert!(
                    !inside || (found - here.jacobian).abs() < tol,
                    "{encoding:?}: {found} {}",
                    here.jacobian
                );
            }
        }
    }

    /// Two charts with arbitrary weights: the partition by the learned densities makes the estimator unbiased.
    #[test]
    fn the_mixture_of_charts_is_unbiased() {
        let (sampler, pdf_network, eval_network) = (
            sampler(charts(), Encoding::Centred),
            densities(Role::Pdf),
            densities(Role::Eval),
        );
        let wo = direction(55.0, 130.0).to_array();
        let n = 1 << 16;
        let mut mean = 0.0;
        for k in 0..n {
            let drawn = sample(&sampler, &[], wo, shifted_r2(k, [0.0; 2]));
            mean += eval(&eval_network, &[], wo, drawn.wi)[1] * jacobian(&drawn, &pdf_network, &[], wo)
                / n as f64;
        }
        let side = 400;
        let mut truth = 0.0;
        for k in 0..side * side {
            let s = [(k % side) as f64 + 0.5, (k / side) as f64 + 0.5].map(|v| v / side as f64);
            let (wi, area) = Chart::IDENTITY.square_to_direction(s);
            truth += eval(&eval_network, &[], wo, wi)[1] * area / (side * side) as f64;
        }
        assert!((mean / truth - 1.0).abs() < MEAN_TOL, "{mean} {truth}");
        let (total, parts) = pdf(&pdf_network, &[], wo, direction(20.0, 40.0).to_array());
        assert!(parts.len() == 2 && (parts.iter().sum::<f64>() / total - 1.0).abs() < QUADRATURE_TOL);
    }

    #[test]
    fn turned_cameras_turn_the_light() {
        let network = sampler(charts(), Encoding::Centred);
        let at = |phi: f64| sample(&network, &[], direction(40.0, phi).to_array(), [0.3, 0.8]);
        let (a, b) = (at(0.0), at(200.0));
        let (sin, cos) = 200f64.to_radians().sin_cos();
        assert!((b.wi[0] - (cos * a.wi[0] - sin * a.wi[1])).abs() < DIFFERENCE_TOL);
        assert!((b.wi[1] - (sin * a.wi[0] + cos * a.wi[1])).abs() < DIFFERENCE_TOL);
        assert!((a.jacobian - b.jacobian).abs() < DIFFERENCE_TOL);
    }
}
