//! Untrained networks: tests of what runs a material need no trained one.

use bake_runtime::anchor::Anchor;
use bake_runtime::encoding::{Encoding, Quantity};
use bake_runtime::spec::{Activation, ChartsSpec, FORMAT, Geometry, Input, Roughness, Symmetry};
use bake_runtime::{BakedMaterial, Dense, Family, Material, Network, NetworkSpec, Rng, Role};

/// Untrained networks of one chart for a fixed metal, with hidden layers of these widths.
pub fn random_material(hidden: &[usize], frame_hidden: &[usize], seed: u64) -> BakedMaterial {
    let material = Material::fixed(
        "random",
        Family::Conductor,
        &[("alpha", &[0.3, 0.1]), ("reflectance", &[1.0, 0.782, 0.344])],
    )
    .expect("valid parameters");
    let own = Input::plain(Quantity::Wo, Encoding::Grazing);
    let charts = ChartsSpec {
        anchors: vec![Anchor::Mirror],
        alpha: [0.3, 0.1].map(Roughness::Fixed),
        inputs: vec![own],
        hidden: frame_hidden.to_vec(),
    };
    let mut rng = Rng::new(&[0x6e65_7473, seed]);
    let mut network = |role: Role| {
        let first = match role {
            Role::Sample => Input::plain(Quantity::U, Encoding::Centred),
            Role::Eval | Role::Pdf => Input::plain(Quantity::Local(0), Encoding::Identity),
        };
        let spec = NetworkSpec {
            format: FORMAT,
            role,
            material: material.clone(),
            symmetry: Symmetry::Quadrant,
            inputs: vec![first, own],
            hidden: hidden.to_vec(),
            activation: Activation::Silu,
            geometry: Geometry::Charts(charts.clone()),
        };
        untrained(spec, &mut rng)
    };
    BakedMaterial {
        sample: network(Role::Sample),
        eval: network(Role::Eval),
        pdf: network(Role::Pdf),
    }
}

/// A network of this specification, with weights of the size that trained ones have.
pub fn untrained(spec: NetworkSpec, rng: &mut Rng) -> Network {
    spec.validate().expect("a sound specification");
    let mut layer = |(inputs, outputs): (usize, usize)| {
        let mut spread = |scale: f64| (scale * (2.0 * rng.uniform() - 1.0)) as f32;
        // Weights uniform in ±√(3/inputs) keep the variance from layer to layer.
        let scale = (3.0 / inputs as f64).sqrt();
        let weight = (0..inputs * outputs).map(|_| spread(scale)).collect();
        Dense {
            weight,
            bias: (0..outputs).map(|_| spread(0.3)).collect(),
            inputs,
            outputs,
        }
    };
    let frame = spec.frame_layers().into_iter().map(&mut layer).collect();
    let net = spec.layers().into_iter().map(&mut layer).collect();
    Network { spec, frame, net }
}
