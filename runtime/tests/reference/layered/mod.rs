//! The layered reference against tables of independent implementations, against its own integrals, and at the inputs
//! where such code usually breaks.

mod edges;
mod integrals;
mod tables;

use bake_runtime::layered::Layered;

/// A layered material over a wide choice of settings: name, alpha, eta, sigma_t, albedo, base, g.
struct Setting(&'static str, f64, f64, f64, [f64; 3], [f64; 3], f64);

impl Setting {
    fn layered(&self) -> Layered {
        let Setting(name, alpha, eta, sigma_t, albedo, base, g) = *self;
        Layered::new(alpha, eta, sigma_t, albedo, base, g).unwrap_or_else(|e| panic!("{name}: {e}"))
    }
}

/// Smooth to rough, thin to thick, black to white, scattering back and ahead, denser and thinner than air.
const SETTINGS: [Setting; 12] = [
    Setting("varnish", 0.02, 1.5, 0.8, [0.9, 0.6, 0.3], [0.8, 0.5, 0.2], 0.0),
    Setting("smooth", 0.001, 1.5, 0.8, [0.9, 0.6, 0.3], [0.8, 0.5, 0.2], 0.0),
    Setting("rough", 0.3, 1.5, 0.8, [0.9, 0.6, 0.3], [0.8, 0.5, 0.2], 0.0),
    Setting(
        "very rough",
        1.0,
        1.8,
        2.0,
        [0.5, 0.9, 0.99],
        [0.1, 0.4, 0.8],
        0.0,
    ),
    Setting("thick", 0.6, 1.5, 20.0, [0.99, 0.9, 0.5], [0.5; 3], 0.0),
    Setting("clear", 0.2, 1.5, 0.0, [0.0; 3], [1.0, 0.5, 0.0], 0.0),
    Setting(
        "no interface",
        0.3,
        1.0,
        1.0,
        [0.9, 0.6, 0.3],
        [0.8, 0.5, 0.2],
        0.0,
    ),
    Setting(
        "thinner than air",
        0.2,
        0.7,
        1.0,
        [0.9, 0.6, 0.3],
        [0.8, 0.5, 0.2],
        0.0,
    ),
    Setting("ahead", 0.1, 1.3, 2.0, [0.95, 0.8, 0.5], [0.8, 0.5, 0.2], 0.8),
    Setting("back", 0.1, 1.3, 2.0, [0.95, 0.8, 0.5], [0.8, 0.5, 0.2], -0.6),
    Setting("white", 0.3, 1.5, 1.0, [1.0; 3], [1.0; 3], 0.3),
    Setting("black", 0.1, 1.5, 1.0, [0.0; 3], [0.0; 3], 0.0),
];
