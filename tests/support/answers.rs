//! Random queries, and what backends and the oracle answer to them.

use bake_runtime::{Backend, BakedMaterial, Points, Rng, oracle};

/// Largest difference between the directions that the two ways to sample draw; they may add in another order.
const SAME_WI_TOL: f32 = 1e-5;

/// Largest angle of `wo` and `wi` from the normal.
const THETA_MAX_DEG: f64 = 89.99;
/// Largest f32 below 1, the largest u that a renderer can draw.
const U_LARGEST: f32 = 1.0 - 1.0 / (1u32 << 24) as f32;

/// Number of outputs of all networks.
pub const WIDTH: usize = 11;
/// Names and columns of the outputs.
pub const OUTPUTS: [(&str, [usize; 2]); 5] = [
    ("wi", [0, 3]),
    ("weight", [3, 6]),
    ("jacobian", [6, 7]),
    ("f_cos", [7, 10]),
    ("pdf", [10, 11]),
];

/// Everything that is answered to one query.
pub type Answer = [f64; WIDTH];

/// One query of all networks.
#[derive(Clone)]
pub struct Query {
    /// Free parameters.
    pub params: Vec<f64>,
    /// Camera direction.
    pub wo: [f64; 3],
    /// Random numbers.
    pub u: [f64; 2],
    /// Light direction.
    pub wi: [f64; 3],
}

/// Queries as backends take them: structures of arrays.
pub struct Queries {
    /// Free parameters.
    pub params: Vec<Vec<f32>>,
    /// Camera directions.
    pub wo: [Vec<f32>; 3],
    /// Random numbers.
    pub u: [Vec<f32>; 2],
    /// Light directions.
    pub wi: [Vec<f32>; 3],
}

impl Queries {
    /// `count` queries: parameters over their whole ranges, θ uniform up to [`THETA_MAX_DEG`], one u in eight at either
    /// end of its range, and every other `wi` drawn by the material itself, so that evaluations meet the lobe.
    pub fn new(material: &BakedMaterial, count: usize, seed: u64) -> Queries {
        let mut rng = Rng::new(&[0x7061_7269_7479, seed]);
        let free = material.sample.spec.material.free();
        let mut queries = Queries {
            params: vec![Vec::new(); free.len()],
            wo: Default::default(),
            u: Default::default(),
            wi: Default::default(),
        };
        let push = |columns: &mut [Vec<f32>], values: &[f64]| {
            columns
                .iter_mut()
                .zip(values)
                .for_each(|(column, &value)| column.push(value as f32));
        };
        for i in 0..count {
            let params: Vec<f64> = free
                .iter()
                .map(|(_, min, max)| within(&mut rng, *min, *max))
                .collect();
            let (wo, mut wi) = (direction(&mut rng), direction(&mut rng));
            let u = [uniform(&mut rng), uniform(&mut rng)];
            if i % 2 == 0 {
                wi = oracle::sample(&material.sample, &params, wo, u).wi;
            }
            push(&mut queries.params, &params);
            push(&mut queries.wo, &wo);
            push(&mut queries.u, &u);
            push(&mut queries.wi, &wi);
        }
        queries
    }

    /// Number of queries.
    pub fn len(&self) -> usize {
        self.u[0].len()
    }

    /// Query `i`, its directions of unit length, which their rounding to f32 is not.
    pub fn at(&self, i: usize) -> Query {
        let unit = |columns: &[Vec<f32>; 3]| {
            let w = columns.each_ref().map(|column| f64::from(column[i]));
            let length = w.iter().map(|c| c * c).sum::<f64>().sqrt();
            w.map(|c| c / length)
        };
        Query {
            params: self.params.iter().map(|column| column[i].into()).collect(),
            wo: unit(&self.wo),
            u: self.u.each_ref().map(|column| column[i].into()),
            wi: unit(&self.wi),
        }
    }

    /// Every answer of `backend`, a column per output; both ways to sample must draw the same `wi`.
    pub fn ask(&self, backend: &dyn Backend) -> Vec<Vec<f32>> {
        let n = self.len();
        let params: Vec<&[f32]> = self.params.iter().map(Vec::as_slice).collect();
        let points = Points {
            params: &params,
            wo: self.wo.each_ref().map(Vec::as_slice),
        };
        let (u, wi) = (
            self.u.each_ref().map(Vec::as_slice),
            self.wi.each_ref().map(Vec::as_slice),
        );
        let mut learned = [(); 3].map(|()| vec![0.0; n]);
        let mut answers = [(); WIDTH].map(|()| vec![0.0; n]);
        let [x, y, z, r, g, b, jacobian, er, eg, eb, pdf] = answers.each_mut().map(Vec::as_mut_slice);
        let run = |result: bake_runtime::Result<()>| result.unwrap_or_else(|e| panic!("{e}"));
        run(backend.sample_learned(points, u, learned.each_mut().map(Vec::as_mut_slice), [r, g, b]));
        run(backend.sample_jacobian(points, u, [x, y, z], jacobian));
        run(backend.eval(points, wi, [er, eg, eb]));
        run(backend.pdf(points, wi, pdf));
        for (a, b) in learned.iter().flatten().zip(answers[..3].iter().flatten()) {
            assert!(
                (a - b).abs() <= SAME_WI_TOL,
                "sample_learned and sample_jacobian draw {a} and {b}"
            );
        }
        answers.into()
    }

    /// What the oracle answers, a column per output.
    pub fn ask_oracle(&self, material: &BakedMaterial) -> Vec<Vec<f32>> {
        let mut answers = vec![Vec::new(); WIDTH];
        for i in 0..self.len() {
            let answer = oracle_answer(material, &self.at(i));
            for (column, value) in answers.iter_mut().zip(answer) {
                column.push(value as f32);
            }
        }
        answers
    }
}

/// What the oracle answers to `query`.
pub fn oracle_answer(material: &BakedMaterial, query: &Query) -> Answer {
    let Query { params, wo, u, wi } = query;
    let drawn = oracle::sample(&material.sample, params, *wo, *u);
    let [x, y, z] = drawn.wi;
    let [r, g, b] = drawn.weight;
    let jacobian = oracle::jacobian(&drawn, &material.pdf, params, *wo);
    let [er, eg, eb] = oracle::eval(&material.eval, params, *wo, *wi);
    let (pdf, _) = oracle::pdf(&material.pdf, params, *wo, *wi);
    [x, y, z, r, g, b, jacobian, er, eg, eb, pdf]
}

/// θ uniform up to [`THETA_MAX_DEG`], with its ends.
fn direction(rng: &mut Rng) -> [f64; 3] {
    let theta = match rng.bits() % 64 {
        0 => 0.0,
        1 => THETA_MAX_DEG.to_radians(),
        _ => rng.uniform() * THETA_MAX_DEG.to_radians(),
    };
    let (sin_phi, cos_phi) = (rng.uniform() * std::f64::consts::TAU).sin_cos();
    [theta.sin() * cos_phi, theta.sin() * sin_phi, theta.cos()]
}

/// Uniform in `min..max`, with its ends.
fn within(rng: &mut Rng, min: f64, max: f64) -> f64 {
    match rng.bits() % 16 {
        0 => min,
        1 => max,
        _ => min + (max - min) * rng.uniform(),
    }
}

/// An f32 uniform, a multiple of 2⁻²⁴.
fn uniform(rng: &mut Rng) -> f64 {
    f64::from(match rng.bits() % 16 {
        0 => 0.0,
        1 => U_LARGEST,
        _ => (rng.bits() >> 40) as f32 / (1u32 << 24) as f32,
    })
}
