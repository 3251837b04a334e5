//! Random materials and queries, and the two ways to run them: in batches, and one by one in f64.

use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::{Backend, BakedMaterial, Dense, Family, Material, Network, NetworkSpec, Rng, Role};
use std::f64::consts::TAU;

/// Roughness of the anchor.
const ALPHA: [f64; 2] = [0.3, 0.1];

/// Hidden widths of a random material: sampling, evaluation, pdf and frame networks.
pub struct Widths {
    pub sample: &'static [usize],
    pub eval: &'static [usize],
    pub pdf: &'static [usize],
    pub frame: &'static [usize],
}

/// The sizes that bakes use.
pub const TYPICAL: Widths = Widths {
    sample: &[32, 32, 32, 32],
    eval: &[32, 32, 32],
    pdf: &[32, 32],
    frame: &[16, 16],
};

/// Sizes that fill no register block, and networks without hidden layers.
pub const ODD: [Widths; 3] = [
    Widths {
        sample: &[7, 5, 9],
        eval: &[1, 3],
        pdf: &[13],
        frame: &[3],
    },
    Widths {
        sample: &[11],
        eval: &[2],
        pdf: &[1],
        frame: &[6, 1],
    },
    Widths {
        sample: &[],
        eval: &[],
        pdf: &[],
        frame: &[],
    },
];

/// Kinds of random materials that the kernels must get right.
#[derive(Clone, Copy, Debug)]
pub enum Materials {
    /// [`TYPICAL`] networks.
    Moderate,
    /// Lobes e⁴ times narrower: roughness around 0.02.
    Narrow,
    /// Maps that fold, with shifts beyond their clamp.
    Folding,
    /// One of [`ODD`].
    Odd(usize),
}

/// A material with random networks: hidden layers keep the variance of their inputs (He et al. 2015), frame
/// outputs and warp shifts stay around 1 and exponents around 0.5.
pub fn material(seed: u64, widths: &Widths) -> BakedMaterial {
    let description = Material::fixed(
        "random",
        Family::Conductor,
        &[("alpha", &ALPHA), ("reflectance", &[0.8; 3])],
    )
    .expect("valid parameters");
    let network = |role: Role, hidden: &[usize]| {
        let mut rng = Rng::new(&[seed, role as u64]);
        let spec = NetworkSpec::warp(
            role,
            description.clone(),
            ALPHA,
            hidden.to_vec(),
            widths.frame.to_vec(),
        );
        let frame = layers(&mut rng, &spec.frame_layers());
        let net = layers(&mut rng, &spec.layers());
        Network { spec, frame, net }
    };
    BakedMaterial {
        sample: network(Role::Sample, widths.sample),
        eval: network(Role::Eval, widths.eval),
        pdf: network(Role::Pdf, widths.pdf),
    }
}

impl Materials {
    /// The material itself.
    pub fn build(self, seed: u64) -> BakedMaterial {
        match self {
            Materials::Moderate => material(seed, &TYPICAL),
            Materials::Odd(which) => material(seed, &ODD[which]),
            Materials::Narrow => {
                let mut material = material(seed, &TYPICAL);
                for network in [&mut material.sample, &mut material.eval, &mut material.pdf] {
                    let last = network.frame.last_mut().expect("it has layers");
                    last.bias[..2].iter_mut().for_each(|log| *log -= 4.0);
                }
                material
            }
            Materials::Folding => {
                let mut material = material(seed, &TYPICAL);
                let last = material.sample.net.last_mut().expect("it has layers");
                last.weight[..2 * last.inputs].iter_mut().for_each(|w| *w *= 25.0);
                material
            }
        }
    }
}

fn layers(rng: &mut Rng, shapes: &[(usize, usize)]) -> Vec<Dense> {
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
}

/// `wo`, `wi` and `u` of one query.
type Query = ([f32; 3], [f32; 3], [f32; 2]);

/// Queries as the backends take them: every array has one element per query.
#[derive(Clone)]
pub struct Queries {
    pub wo: [Vec<f32>; 3],
    pub wi: [Vec<f32>; 3],
    pub u: [Vec<f32>; 2],
}

impl Queries {
    /// The queries with these values.
    fn new(rows: &[Query]) -> Queries {
        let column = |of: &dyn Fn(&Query) -> f32| rows.iter().map(of).collect();
        Queries {
            wo: std::array::from_fn(|i| column(&|row| row.0[i])),
            wi: std::array::from_fn(|i| column(&|row| row.1[i])),
            u: std::array::from_fn(|i| column(&|row| row.2[i])),
        }
    }

    /// `count` random queries: every fourth direction within about a degree of the horizon.
    pub fn random(seed: u64, count: usize) -> Queries {
        let mut rng = Rng::new(&[seed]);
        let rows: Vec<_> = (0..count)
            .map(|_| {
                (
                    direction(&mut rng),
                    direction(&mut rng),
                    rng.pair().map(uniform_f32),
                )
            })
            .collect();
        Queries::new(&rows)
    }

    /// All pairs of directions that are hard for one reason or another, with hard u.
    pub fn hard() -> Queries {
        let polar = |theta_deg: f64, phi_deg: f64| {
            let (theta, phi) = (theta_deg.to_radians(), phi_deg.to_radians());
            [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()].map(|c| c as f32)
        };
        let mut directions = vec![
            [0.0, 0.0, 1.0],
            [-0.0, -0.0, 1.0],
            [1.0, 0.0, 1e-7],
            [-0.6, 0.8, 1e-20],
        ];
        for theta in [0.01, 45.0, 80.0, 89.0, 89.99] {
            directions.extend([0.0, 90.0, 135.0, 180.0, 301.0].map(|phi| polar(theta, phi)));
        }
        let below_one = 1.0 - f32::EPSILON / 2.0;
        let u = [0.0, f32::EPSILON / 2.0, 0.25, 0.5, 0.75, below_one, 1.0];
        let mut rows = Vec::new();
        for (i, &wo) in directions.iter().enumerate() {
            for (j, &wi) in directions.iter().enumerate() {
                rows.push((
                    wo,
                    wi,
                    [u[(i + j) % u.len()], u[(i * u.len() + j) / u.len() % u.len()]],
                ));
            }
        }
        rows.extend(
            u.iter()
                .flat_map(|&x| u.map(|y| (polar(60.0, 20.0), polar(60.0, 200.0), [x, y]))),
        );
        Queries::new(&rows)
    }

    /// Number of queries.
    pub fn len(&self) -> usize {
        self.wo[0].len()
    }

    /// wo, wi and u of query `i` in f64.
    pub fn at(&self, i: usize) -> ([f64; 3], [f64; 3], [f64; 2]) {
        let row = |columns: &[Vec<f32>; 3]| std::array::from_fn(|c| f64::from(columns[c][i]));
        (
            row(&self.wo),
            row(&self.wi),
            [f64::from(self.u[0][i]), f64::from(self.u[1][i])],
        )
    }

    /// The queries `range`.
    pub fn slice(&self, range: std::ops::Range<usize>) -> Queries {
        let cut = |v: &Vec<f32>| v[range.clone()].to_vec();
        Queries {
            wo: self.wo.each_ref().map(cut),
            wi: self.wi.each_ref().map(cut),
            u: self.u.each_ref().map(cut),
        }
    }
}

/// The f32 next to `u` that is still below 1.
fn uniform_f32(u: f64) -> f32 {
    (u as f32).min(1.0 - f32::EPSILON / 2.0)
}

/// A unit vector above the horizon.
fn direction(rng: &mut Rng) -> [f32; 3] {
    let [a, b] = rng.pair();
    let z = if rng.uniform() < 0.25 {
        1e-5 + 0.02 * a
    } else {
        1e-3 + 0.999 * a
    };
    let r = (1.0 - z * z).sqrt();
    [r * (TAU * b).cos(), r * (TAU * b).sin(), z].map(|c| c as f32)
}

/// Everything a backend answers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answers {
    pub wi: [Vec<f32>; 3],
    pub weight: [Vec<f32>; 3],
    pub wi_of_jacobian: [Vec<f32>; 3],
    pub jacobian: Vec<f32>,
    pub f_cos: [Vec<f32>; 3],
    pub pdf: Vec<f32>,
}

impl Answers {
    /// Room for `count` queries, filled with NaN so that nothing unwritten passes.
    pub fn new(count: usize) -> Answers {
        let one = vec![f32::NAN; count];
        let three = [one.clone(), one.clone(), one.clone()];
        Answers {
            wi: three.clone(),
            weight: three.clone(),
            wi_of_jacobian: three.clone(),
            jacobian: one.clone(),
            f_cos: three,
            pdf: one,
        }
    }

    /// All arrays, with their names.
    pub fn columns(&self) -> Vec<(&'static str, &[f32])> {
        let triples = [
            ("wi", &self.wi),
            ("weight", &self.weight),
            ("wi of jacobian", &self.wi_of_jacobian),
            ("f_cos", &self.f_cos),
        ];
        let mut all: Vec<(&str, &[f32])> = Vec::new();
        for (name, columns) in triples {
            all.extend(columns.iter().map(|column| (name, column.as_slice())));
        }
        all.extend([
            ("jacobian", self.jacobian.as_slice()),
            ("pdf", self.pdf.as_slice()),
        ]);
        all
    }
}

/// A backend for `material`, which must exist on this processor.
pub fn backend(material: &BakedMaterial, tier: Tier) -> NativeBackend {
    NativeBackend::new(material, tier).expect("the tier is available and the material is sound")
}

/// Runs all four kinds of query.
pub fn run(backend: &mut NativeBackend, queries: &Queries) -> Answers {
    let mut answers = Answers::new(queries.len());
    let Answers {
        wi,
        weight,
        wi_of_jacobian,
        jacobian,
        f_cos,
        pdf,
    } = &mut answers;
    let (wo, lights, u) = (refs(&queries.wo), refs(&queries.wi), refs(&queries.u));
    backend
        .sample_learned(wo, u, slices(wi), slices(weight))
        .expect("equal lengths");
    backend
        .sample_jacobian(wo, u, slices(wi_of_jacobian), jacobian)
        .expect("equal lengths");
    backend.eval(wo, lights, slices(f_cos)).expect("equal lengths");
    backend.pdf(wo, lights, pdf).expect("equal lengths");
    answers
}

/// The columns as slices.
pub fn refs<const K: usize>(columns: &[Vec<f32>; K]) -> [&[f32]; K] {
    columns.each_ref().map(Vec::as_slice)
}

/// The columns as mutable slices.
pub fn slices<const K: usize>(columns: &mut [Vec<f32>; K]) -> [&mut [f32]; K] {
    columns.each_mut().map(Vec::as_mut_slice)
}
