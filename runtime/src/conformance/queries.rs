//! Random and hard queries, as backends take them and as the oracle does.

use crate::spec::U_MIN;
use crate::{BakedMaterial, Points, Rng};
use std::f64::consts::TAU;

/// The largest u that a backend uses: the last f32 below 1.
const U_MAX: f64 = 1.0 - 1.0 / (1u64 << 24) as f64;

/// `wo`, `wi` and `u` of one query: unit vectors of the shading frame, and numbers in `[0, 1]`.
pub type Query = ([f32; 3], [f32; 3], [f32; 2]);

/// One query in f64, as the oracle takes it: directions are unit, u is not next to its edges.
#[derive(Clone, Debug)]
pub struct Exact {
    /// Values of the free parameters.
    pub params: Vec<f64>,
    /// Unit direction to the camera.
    pub wo: [f64; 3],
    /// Unit direction to the light.
    pub wi: [f64; 3],
    /// The random numbers, in `(0, 1)`.
    pub u: [f64; 2],
}

/// Queries as the backends take them: every array has one element per query, but the first of several parameters is the
/// same for all.
#[derive(Clone, Debug)]
pub struct Queries {
    /// A column for each free parameter.
    pub params: Vec<Vec<f32>>,
    /// Directions to the camera.
    pub wo: [Vec<f32>; 3],
    /// Directions to the light.
    pub wi: [Vec<f32>; 3],
    /// Random numbers.
    pub u: [Vec<f32>; 2],
}

impl Queries {
    /// The queries with these values, of a material that leaves nothing free.
    pub fn new(rows: &[Query]) -> Queries {
        let column = |of: &dyn Fn(&Query) -> f32| rows.iter().map(of).collect();
        Queries {
            params: Vec::new(),
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
            unit_f32([theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()])
        };
        let mut directions = vec![
            [0.0, 0.0, 1.0],
            [-0.0, -0.0, 1.0],
            [1.0, 0.0, 1e-7],
            [0.0, -1.0, 1e-20],
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

    /// The same with values for what `material` leaves free.
    pub fn with_params(mut self, material: &BakedMaterial, seed: u64) -> Queries {
        let mut rng = Rng::new(&[0x9a4a, seed]);
        let free = material.sample.spec.material.free();
        let columns = free.iter().enumerate().map(|(p, (_, min, max))| {
            let count = if p == 0 && free.len() > 1 { 1 } else { self.len() };
            (0..count)
                .map(|_| (min + (max - min) * rng.uniform()) as f32)
                .collect()
        });
        self.params = columns.collect();
        self
    }

    /// The parameters as slices.
    pub fn columns(&self) -> Vec<&[f32]> {
        self.params.iter().map(Vec::as_slice).collect()
    }

    /// The shading points, with `params` as [`Queries::columns`] gives them.
    pub fn points<'a>(&'a self, params: &'a [&'a [f32]]) -> Points<'a> {
        Points {
            params,
            wo: refs(&self.wo),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of queries.
    pub fn len(&self) -> usize {
        self.wo[0].len()
    }

    /// Query `i` in f64.
    pub fn at(&self, i: usize) -> Exact {
        let unit = |columns: &[Vec<f32>; 3]| normalised(std::array::from_fn(|c| f64::from(columns[c][i])));
        let param = |column: &Vec<f32>| f64::from(*column.get(i).unwrap_or(&column[0]));
        Exact {
            params: self.params.iter().map(param).collect(),
            wo: unit(&self.wo),
            wi: unit(&self.wi),
            u: [0, 1].map(|c: usize| f64::from(self.u[c][i]).clamp(U_MIN, U_MAX)),
        }
    }

    /// The queries with these numbers, in this order; what they all share stays one value.
    pub fn select(&self, numbers: impl Iterator<Item = usize> + Clone) -> Queries {
        let pick = |column: &Vec<f32>| -> Vec<f32> { numbers.clone().map(|i| column[i]).collect() };
        let params = self.params.iter().map(|column| match column.len() {
            1 => column.clone(),
            _ => pick(column),
        });
        Queries {
            params: params.collect(),
            wo: self.wo.each_ref().map(pick),
            wi: self.wi.each_ref().map(pick),
            u: self.u.each_ref().map(pick),
        }
    }

    /// These queries and then those of `other`, none of which has parameters yet.
    pub fn and(mut self, other: Queries) -> Queries {
        let ours = self.wo.iter_mut().chain(&mut self.wi).chain(&mut self.u);
        let theirs = other.wo.into_iter().chain(other.wi).chain(other.u);
        ours.zip(theirs).for_each(|(ours, theirs)| ours.extend(theirs));
        self
    }
}

/// The columns as slices.
pub fn refs<const K: usize>(columns: &[Vec<f32>; K]) -> [&[f32]; K] {
    columns.each_ref().map(Vec::as_slice)
}

/// The columns as mutable slices.
pub fn slices<const K: usize>(columns: &mut [Vec<f32>; K]) -> [&mut [f32]; K] {
    columns.each_mut().map(Vec::as_mut_slice)
}

/// The f32 next to `u` that is still below 1.
fn uniform_f32(u: f64) -> f32 {
    (u as f32).min(1.0 - f32::EPSILON / 2.0)
}

/// `w` made unit.
pub fn normalised(w: [f64; 3]) -> [f64; 3] {
    let length = (w[0] * w[0] + w[1] * w[1] + w[2] * w[2]).sqrt();
    w.map(|c| c / length)
}

/// A unit vector near `w`, far more precisely so than rounding to f32 leaves it: backends do not make directions unit, and
/// formulas that are equal for unit vectors differ by what these lack.
fn unit_f32(w: [f64; 3]) -> [f32; 3] {
    let [x, y, z] = normalised(w);
    // The components that rounding moves least make up for what it did to the others.
    let start = if z > 0.5 {
        let z = (z as f32).min(1.0 - f32::EPSILON / 2.0);
        let scale = (1.0 - f64::from(z).powi(2)).sqrt() / x.hypot(y).max(f64::MIN_POSITIVE);
        [(x * scale) as f32, (y * scale) as f32, z]
    } else {
        let [x, y] = [x, y].map(|c| (c as f32).clamp(f32::EPSILON / 2.0 - 1.0, 1.0 - f32::EPSILON / 2.0));
        let rest = 1.0 - f64::from(x).powi(2) - f64::from(y).powi(2);
        [x, y, rest.max(1e-9).sqrt() as f32]
    };
    let steps = |c: f32| (-3..=3).map(move |k: i32| f32::from_bits(c.to_bits().wrapping_add_signed(k)));
    let choices = |c: f32| {
        if c == 0.0 {
            vec![c]
        } else {
            steps(c).collect::<Vec<_>>()
        }
    };
    let mut best = (f64::INFINITY, start);
    for x in choices(start[0]) {
        for y in choices(start[1]) {
            for z in choices(start[2]) {
                let length2: f64 = [x, y, z].map(|c| f64::from(c).powi(2)).iter().sum();
                if (length2 - 1.0).abs() < best.0 {
                    best = ((length2 - 1.0).abs(), [x, y, z]);
                }
            }
        }
    }
    best.1
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
    unit_f32([r * (TAU * b).cos(), r * (TAU * b).sin(), z])
}
