//! The oracle against differences and quadratures, on untrained networks.

use super::*;
use crate::anchor::Anchor;
use crate::bsdf::{direction, shifted_r2};
use crate::encoding::{Encoding, Quantity, Scale};
use crate::random::Rng;
use crate::spec::{FORMAT, Input, NetworkSpec, Role, Roughness, Symmetry};
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
        mean +=
            eval(&eval_network, &[], wo, drawn.wi)[1] * jacobian(&drawn, &pdf_network, &[], wo) / n as f64;
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
