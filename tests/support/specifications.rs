//! Random specifications that together take every path through a graph: one chart, two and none, with and without free
//! parameters, every symmetry, activation, quantity, scale and encoding.

use crate::networks::untrained;
use bake_runtime::anchor::Anchor;
use bake_runtime::encoding::{Encoding, Quantity, Scale};
use bake_runtime::spec::{Activation, ChartsSpec, FORMAT, Geometry, Input, Roughness, Symmetry};
use bake_runtime::{BakedMaterial, Material, NetworkSpec, Rng, Role};

/// Where directions live.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Places {
    /// In one chart.
    OneChart,
    /// In two.
    TwoCharts,
    /// On the disk.
    Disk,
}

impl Places {
    /// All of them.
    pub const ALL: [Places; 3] = [Places::OneChart, Places::TwoCharts, Places::Disk];
}

/// Materials with free parameters, and the roughness along x and y that follows from these.
const FREE: [(&str, [Roughness; 2]); 3] = [
    (
        r#"{"name": "metal", "family": "conductor", "alpha": [{"min": 0.1, "max": 1.0}, {"min": 0.2, "max": 0.7}],
            "reflectance": [1.0, {"min": 0.0, "max": 1.0}, 0.3]}"#,
        [linear(0), linear(1)],
    ),
    (
        r#"{"name": "varnish", "family": "layered", "alpha": {"min": 0.1, "max": 0.6}, "eta": 1.4,
            "sigma_t": {"min": 0.0, "max": 4.0}, "albedo": [0.9, 0.6, 0.3], "base": [0.8, 0.5, 0.2],
            "g": {"min": -0.5, "max": 0.9}}"#,
        [linear(0), linear(0)],
    ),
    (
        r#"{"name": "paint", "family": "principled", "roughness": {"min": 0.3, "max": 1.0},
            "metallic": {"min": 0.0, "max": 1.0}}"#,
        [
            Roughness::Fixed(0.4),
            Roughness::Free {
                parameter: 1,
                factor: 0.9,
                power: 2,
            },
        ],
    ),
];

/// A material without.
const FIXED: (&str, [Roughness; 2]) = (
    r#"{"name": "gold", "family": "conductor", "alpha": [0.3, 0.1], "reflectance": [1.0, 0.782, 0.344]}"#,
    [Roughness::Fixed(0.3), Roughness::Fixed(0.1)],
);

const fn linear(parameter: usize) -> Roughness {
    Roughness::Free {
        parameter,
        factor: 1.0,
        power: 1,
    }
}

/// Untrained networks of random specifications, which differ from role to role. The outputs of some are so large that they
/// meet every bound: of shifts, exponents, frames and shares, and the rim of the disk.
pub fn random_networks(places: Places, free: bool, seed: u64) -> BakedMaterial {
    let mut rng = Rng::new(&[0x5bec, places as u64, free.into(), seed]);
    let (json, alpha) = if free {
        FREE[seed as usize % FREE.len()]
    } else {
        FIXED
    };
    let material: Material = serde_json::from_str(json).expect("a valid description");
    let symmetry = pick(&mut rng, &[Symmetry::Quadrant, Symmetry::Rotation]);
    let anchors = match places {
        Places::OneChart => vec![pick(&mut rng, &[Anchor::Mirror, Anchor::Diffuse])],
        Places::TwoCharts => vec![Anchor::Mirror, pick(&mut rng, &[Anchor::Mirror, Anchor::Diffuse])],
        Places::Disk => Vec::new(),
    };
    let mut network = |role: Role| {
        let geometry = match places {
            Places::Disk => Geometry::Disk,
            _ => Geometry::Charts(ChartsSpec {
                anchors: anchors.clone(),
                alpha,
                inputs: inputs(
                    &mut rng,
                    &material,
                    &[Quantity::Wo, Quantity::WoDisk, Quantity::Anchor],
                ),
                hidden: hidden(&mut rng, 2),
            }),
        };
        let quantities: &[Quantity] = match (role, places) {
            (Role::Sample, Places::OneChart) => &[Quantity::U, Quantity::Wo, Quantity::Anchor],
            (Role::Sample, Places::TwoCharts) => {
                &[Quantity::U, Quantity::Chart, Quantity::Wo, Quantity::Anchor]
            }
            (Role::Sample, Places::Disk) => &[Quantity::U, Quantity::WoDisk],
            (_, Places::OneChart) => &[Quantity::Local(0), Quantity::Wo, Quantity::Anchor],
            (_, Places::TwoCharts) => &[Quantity::Local(0), Quantity::Local(1), Quantity::WoDisk],
            (_, Places::Disk) => &[Quantity::WiDisk, Quantity::WoDisk],
        };
        let spec = NetworkSpec {
            format: FORMAT,
            role,
            material: material.clone(),
            symmetry,
            inputs: inputs(&mut rng, &material, quantities),
            hidden: hidden(&mut rng, 4),
            activation: pick(&mut rng, &[Activation::Silu, Activation::Relu]),
            geometry,
        };
        let mut network = untrained(spec, &mut rng);
        // Steering by more than 8 leaves little of u's digits to compare.
        let largest = if role == Role::Sample { 8.0 } else { 16.0 };
        let factors = [
            (&mut network.frame, [1.0, 1.0, 4.0]),
            (&mut network.net, [1.0, 4.0, largest]),
        ];
        for (layers, factors) in factors {
            let factor = pick(&mut rng, &factors);
            let last = layers.last_mut().map(|l| l.weight.iter_mut().chain(&mut l.bias));
            last.into_iter().flatten().for_each(|value| *value *= factor);
        }
        network
    };
    BakedMaterial {
        sample: network(Role::Sample),
        eval: network(Role::Eval),
        pdf: network(Role::Pdf),
    }
}

fn pick<T: Copy>(rng: &mut Rng, from: &[T]) -> T {
    from[(rng.bits() % from.len() as u64) as usize]
}

/// Up to `depth` hidden layers of 5 to 32.
fn hidden(rng: &mut Rng, depth: u64) -> Vec<usize> {
    let count = rng.bits() % (depth + 1);
    (0..count).map(|_| 5 + (rng.bits() % 28) as usize).collect()
}

/// Inputs of these quantities and of every free parameter, each scaled and encoded at random.
fn inputs(rng: &mut Rng, material: &Material, quantities: &[Quantity]) -> Vec<Input> {
    let of_quantities = quantities.iter().map(|&quantity| {
        let range = match quantity {
            Quantity::U => [0.0, 1.0],
            _ => [-1.0, 1.0],
        };
        (quantity, range)
    });
    let free = material.free().into_iter().enumerate();
    let of_parameters = free.map(|(i, (_, min, max))| (Quantity::Parameter(i), [min, max]));
    let all: Vec<_> = of_quantities.chain(of_parameters).collect();
    all.into_iter()
        .map(|(quantity, range)| input(rng, quantity, range))
        .collect()
}

fn input(rng: &mut Rng, quantity: Quantity, range: [f64; 2]) -> Input {
    let plain = [
        Encoding::Centred,
        Encoding::Identity,
        Encoding::Frequency(1 + (rng.bits() % 5) as usize),
        Encoding::OneBlob(1 + (rng.bits() % 24) as usize),
    ];
    let direction = [Encoding::Grazing, Encoding::Slant];
    let encoding = match quantity {
        Quantity::Wo | Quantity::Local(_) if rng.uniform() < 0.5 => pick(rng, &direction),
        _ => pick(rng, &plain),
    };
    let scales = [Scale::Linear(range), Scale::Decay(range), Scale::Sqrt(range)];
    let scale = match quantity {
        Quantity::U => Scale::None,
        _ if direction.contains(&encoding) => Scale::None,
        _ if range[0] < 0.0 => pick(rng, &[Scale::None, scales[0], scales[1]]),
        _ => pick(rng, &[Scale::None, scales[0], scales[1], scales[2]]),
    };
    Input {
        quantity,
        scale,
        encoding,
    }
}
