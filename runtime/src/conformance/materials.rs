//! Random materials: the shapes that bakes use, and random valid specifications of every kind, with random weights.

use crate::anchor::Anchor;
use crate::encoding::{Encoding, Quantity, Scale};
use crate::spec::{Activation, ChartsSpec, FORMAT, Geometry, Input, Roughness, Symmetry};
use crate::{BakedMaterial, Dense, Family, Material, Network, NetworkSpec, Rng, Role, Scalar, Setting};

/// Kinds of random materials that a backend must get right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// One chart and nothing free: 4×32.
    Fixed,
    /// One chart, three parameters free.
    Free,
    /// Two charts: 3×32.
    Mixed,
    /// [`Kind::Fixed`] with roughness 0.004 and 0.001, and frames e² times narrower still.
    Narrow,
    /// [`Kind::Fixed`] with maps that fold, and shifts beyond their clamp.
    Folding,
    /// [`Kind::Mixed`] that folds.
    FoldingMixed,
    /// Frequencies, rectifiers and the disk, as in the paper.
    Paper,
    /// Anything that a specification allows, of this number.
    Any(u64),
}

impl Kind {
    /// All but [`Kind::Any`].
    pub const NAMED: [Kind; 7] = [
        Kind::Fixed,
        Kind::Free,
        Kind::Mixed,
        Kind::Narrow,
        Kind::Folding,
        Kind::FoldingMixed,
        Kind::Paper,
    ];

    /// The material itself, with random weights of this seed.
    pub fn build(self, seed: u64) -> BakedMaterial {
        let mut material = match self {
            Kind::Any(number) => any(number),
            Kind::Paper => paper(),
            Kind::Free => typical(&conductor([None, None], [0.9, 0.8, f64::NAN]), 1, &[32; 4]),
            Kind::Mixed | Kind::FoldingMixed => typical(&conductor([Some(0.3), None], [0.9; 3]), 2, &[32; 3]),
            Kind::Narrow => typical(&conductor([Some(0.004), Some(0.001)], [0.9; 3]), 1, &[32; 4]),
            Kind::Fixed | Kind::Folding => typical(&conductor([Some(0.3), Some(0.1)], [0.9; 3]), 1, &[32; 4]),
        }
        .map(|spec| random_weights(spec, seed));
        for network in &mut material {
            let last = network.frame.last_mut();
            if let (Kind::Narrow, Some(last)) = (self, last) {
                last.bias[..2].iter_mut().for_each(|log| *log -= 2.0);
            }
            let last = network.net.last_mut().expect("it has layers");
            if network.spec.role == Role::Sample && matches!(self, Kind::Folding | Kind::FoldingMixed) {
                last.weight[..2 * last.inputs].iter_mut().for_each(|w| *w *= 25.0);
            }
        }
        let [sample, eval, pdf] = material;
        BakedMaterial { sample, eval, pdf }
    }
}

/// A conductor; `None` and NaN are free.
fn conductor(alpha: [Option<f64>; 2], reflectance: [f64; 3]) -> Material {
    let free = |min: f64| Scalar::Free { min, max: 1.0 };
    let alpha = alpha.map(|a| a.map_or(free(0.01), Scalar::Fixed));
    let reflectance = reflectance.map(|r| if r.is_nan() { free(0.0) } else { Scalar::Fixed(r) });
    Material {
        name: "random".into(),
        family: Family::Conductor,
        parameters: vec![
            ("alpha".into(), Setting::Numbers(alpha.to_vec())),
            ("reflectance".into(), Setting::Numbers(reflectance.to_vec())),
        ],
    }
}

/// The roughness that a conductor's charts start from.
fn roughness(material: &Material) -> [Roughness; 2] {
    let mut free = 0;
    let scalars = material.parameters[0].1.scalars();
    [0, 1].map(|i| match scalars[i].fixed() {
        Ok(value) => Roughness::Fixed(value),
        Err(_) => {
            free += 1;
            Roughness::Free {
                parameter: free - 1,
                factor: 1.0,
                power: 1,
            }
        }
    })
}

fn spec_of(role: Role, material: &Material, geometry: Geometry) -> NetworkSpec {
    NetworkSpec {
        format: FORMAT,
        role,
        material: material.clone(),
        symmetry: Symmetry::Quadrant,
        inputs: Vec::new(),
        hidden: Vec::new(),
        activation: Activation::Silu,
        geometry,
    }
}

/// Specifications in the shape that bakes have by default.
fn typical(material: &Material, charts: usize, hidden: &[usize]) -> [NetworkSpec; 3] {
    let mut common = vec![
        Input::plain(Quantity::Wo, Encoding::Grazing),
        Input::plain(Quantity::Anchor, Encoding::Identity),
    ];
    for (parameter, (_, min, max)) in material.free().into_iter().enumerate() {
        common.push(Input {
            quantity: Quantity::Parameter(parameter),
            scale: Scale::Sqrt([min, max]),
            encoding: Encoding::Centred,
        });
    }
    Role::ALL.map(|role| {
        let charts_spec = ChartsSpec {
            anchors: [Anchor::Mirror, Anchor::Diffuse][..charts].to_vec(),
            alpha: roughness(material),
            inputs: common.clone(),
            hidden: vec![16, 16],
        };
        let mut spec = spec_of(role, material, Geometry::Charts(charts_spec));
        if role == Role::Sample {
            spec.inputs.push(Input::plain(Quantity::U, Encoding::Centred));
        } else {
            spec.inputs
                .extend((0..charts).map(|c| Input::plain(Quantity::Local(c), Encoding::Identity)));
        }
        if role == Role::Sample && charts > 1 {
            spec.inputs
                .push(Input::plain(Quantity::Chart, Encoding::Identity));
        }
        spec.inputs.extend_from_slice(&common);
        spec.hidden = if role == Role::Pdf {
            vec![24; 3]
        } else {
            hidden.to_vec()
        };
        spec
    })
}

/// Specifications as the paper has them.
fn paper() -> [NetworkSpec; 3] {
    let material = conductor([None, None], [f64::NAN, 0.8, 0.7]);
    Role::ALL.map(|role| {
        let mut spec = spec_of(role, &material, Geometry::Disk);
        let other = match role {
            Role::Sample => Quantity::U,
            _ => Quantity::WiDisk,
        };
        spec.inputs = vec![
            Input::plain(other, Encoding::Frequency(12)),
            Input::plain(Quantity::WoDisk, Encoding::Frequency(12)),
        ];
        spec.inputs
            .extend((0..3).map(|p| Input::plain(Quantity::Parameter(p), Encoding::Frequency(4))));
        spec.hidden = vec![64, 32, 32];
        spec.activation = Activation::Relu;
        spec
    })
}

/// A random choice among `options`.
fn pick<T: Clone>(rng: &mut Rng, options: &[T]) -> T {
    options[(rng.uniform() * options.len() as f64) as usize].clone()
}

/// Random valid specifications of one material.
fn any(number: u64) -> [NetworkSpec; 3] {
    let mut rng = Rng::new(&[0xa11, number]);
    let rng = &mut rng;
    let alpha = [(); 2].map(|_| pick(rng, &[Some(0.3), Some(0.02), None]));
    let reflectance = [(); 3].map(|_| pick(rng, &[0.9, 0.5, f64::NAN]));
    let material = conductor(alpha, reflectance);
    let charts = pick(rng, &[0, 1, 1, 2, 2]);
    Role::ALL.map(|role| {
        let own = if role == Role::Eval {
            pick(rng, &[0, 1, 2])
        } else {
            charts
        };
        any_spec(rng, role, &material, own)
    })
}

fn any_spec(rng: &mut Rng, role: Role, material: &Material, charts: usize) -> NetworkSpec {
    let hidden = |rng: &mut Rng| {
        let depth = pick(rng, &[0, 1, 2, 3]);
        (0..depth).map(|_| pick(rng, &[1, 2, 3, 5, 8, 13, 32])).collect()
    };
    let mut spec = spec_of(role, material, Geometry::Disk);
    spec.symmetry = pick(rng, &[Symmetry::Quadrant, Symmetry::Rotation]);
    spec.activation = pick(rng, &[Activation::Silu, Activation::Relu]);
    spec.hidden = hidden(rng);
    if charts > 0 {
        let mut alpha = roughness(material);
        for alpha in &mut alpha {
            if let (Roughness::Free { power, factor, .. }, true) = (alpha, rng.uniform() < 0.5) {
                (*power, *factor) = (2, 0.7);
            }
        }
        spec.geometry = Geometry::Charts(ChartsSpec {
            anchors: (0..charts)
                .map(|_| pick(rng, &[Anchor::Mirror, Anchor::Mirror, Anchor::Diffuse]))
                .collect(),
            alpha,
            inputs: Vec::new(),
            hidden: hidden(rng),
        });
    }
    let inputs = any_inputs(rng, &spec, false);
    let of_frame = any_inputs(rng, &spec, true);
    spec.inputs = inputs;
    if let Geometry::Charts(charts) = &mut spec.geometry {
        charts.inputs = of_frame;
    }
    spec.validate().expect("a sound specification");
    spec
}

/// One to six inputs that `spec` may have.
fn any_inputs(rng: &mut Rng, spec: &NetworkSpec, of_frame: bool) -> Vec<Input> {
    let free = spec.material.free();
    let charts = spec.charts().map_or(0, |c| c.anchors.len());
    let mut quantities = vec![Quantity::Wo, Quantity::WoDisk];
    quantities.extend((0..free.len()).map(Quantity::Parameter));
    if charts > 0 {
        quantities.push(Quantity::Anchor);
    }
    match spec.role {
        _ if of_frame => {}
        Role::Sample => {
            quantities.extend([Quantity::U; 4]);
            quantities.extend((1..charts).flat_map(|_| [Quantity::Chart; 3]));
        }
        Role::Eval | Role::Pdf => {
            quantities.push(Quantity::WiDisk);
            quantities.extend((0..charts).flat_map(|c| [Quantity::Local(c); 3]));
        }
    }
    let count = pick(rng, &[1, 2, 3, 4, 5, 6]);
    let input = |rng: &mut Rng| {
        let quantity = pick(rng, &quantities);
        let mut encodings = vec![
            Encoding::Centred,
            Encoding::Identity,
            Encoding::Frequency(pick(rng, &[1, 3, 5])),
            Encoding::OneBlob(pick(rng, &[1, 4, 12])),
        ];
        if quantity.scalars() == 3 {
            encodings.extend([
                Encoding::Grazing,
                Encoding::Slant,
                Encoding::Grazing,
                Encoding::Slant,
            ]);
        }
        // A root has no slope at 0, where directions may lie.
        let scales = match quantity {
            Quantity::Parameter(p) => {
                let range = [free[p].1, free[p].2];
                vec![
                    Scale::None,
                    Scale::Linear(range),
                    Scale::Sqrt(range),
                    Scale::Decay(range),
                ]
            }
            _ => vec![Scale::None, Scale::Linear([-1.0, 1.0]), Scale::Decay([-1.0, 1.5])],
        };
        let encoding = pick(rng, &encodings);
        // Directions encoded as such must stay directions, and u has no scale.
        let plain = quantity == Quantity::U || matches!(encoding, Encoding::Grazing | Encoding::Slant);
        Input {
            quantity,
            scale: if plain { Scale::None } else { pick(rng, &scales) },
            encoding,
        }
    };
    (0..count).map(|_| input(rng)).collect()
}

/// Random weights: hidden layers keep the variance of their inputs (He et al. 2015), frame outputs and warp shifts stay
/// around 1 and exponents around 0.5.
fn random_weights(spec: NetworkSpec, seed: u64) -> Network {
    let mut rng = Rng::new(&[seed, spec.role as u64]);
    let mut layers = |shapes: &[(usize, usize)]| -> Vec<Dense> {
        let layer = |(i, &(inputs, outputs)): (usize, &(usize, usize))| {
            let gain: f64 = if i + 1 == shapes.len() { 1.0 } else { 6.0 };
            let bound = (gain / inputs as f64).sqrt();
            let mut centred = |bound: f64| ((2.0 * rng.uniform() - 1.0) * bound) as f32;
            Dense {
                weight: (0..inputs * outputs).map(|_| centred(bound)).collect(),
                bias: (0..outputs).map(|_| centred(0.3)).collect(),
                inputs,
                outputs,
            }
        };
        shapes.iter().enumerate().map(layer).collect()
    };
    let frame = layers(&spec.frame_layers());
    let net = layers(&spec.layers());
    Network { spec, frame, net }
}
