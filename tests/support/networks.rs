//! Untrained networks: tests of what runs a material need no trained one.

use bake_runtime::{BakedMaterial, Dense, Family, Material, Network, NetworkSpec, Rng, Role};

/// Untrained networks with hidden layers of these widths, of the size that trained ones have.
pub fn random_material(hidden: &[usize], frame_hidden: &[usize], seed: u64) -> BakedMaterial {
    let material = Material::fixed(
        "random",
        Family::Conductor,
        &[("alpha", &[0.3, 0.1]), ("reflectance", &[1.0, 0.782, 0.344])],
    )
    .expect("valid parameters");
    let mut rng = Rng::new(&[0x6e65_7473, seed]);
    let mut network = |role: Role| {
        let spec = NetworkSpec::warp(
            role,
            material.clone(),
            [0.3, 0.1],
            hidden.to_vec(),
            frame_hidden.to_vec(),
        );
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
    };
    BakedMaterial {
        sample: network(Role::Sample),
        eval: network(Role::Eval),
        pdf: network(Role::Pdf),
    }
}
