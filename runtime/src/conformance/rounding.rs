//! How much rounding may change an answer: measured, not derived.
//!
//! The oracle answers the same query again after every weight, parameter, direction and number has been moved by a rounding
//! or two; what that moves the answer by is what single precision may be off by. Roundings of numbers that the charts make
//! on the way have no such move: floors follow them.

use super::queries::{Exact, Queries, normalised};
use crate::chart::Chart;
use crate::frame::Frame;
use crate::oracle::OracleSample;
use crate::spec::{Geometry, Roughness};
use crate::{BakedMaterial, Network, Rng, oracle};

/// Relative size of the moves, two roundings of f32.
const MOVE: f64 = 1.0 / (1u64 << 23) as f64;
/// Moved copies of every material: with few of them, none may happen to move an answer.
const COPIES: usize = 8;
/// Errors allowed over the largest change that moves made.
const MOVES_ALLOWED: f64 = 8.0;
/// Part of a value that it may be off by however little moves change it: some tens of roundings.
pub const FLOOR: f64 = 3e-6;

/// `value` moved by up to [`MOVE`] of itself.
fn moved(value: f64, rng: &mut Rng) -> f64 {
    value * (1.0 + MOVE * (2.0 * rng.uniform() - 1.0))
}

fn moved_network(network: &Network, rng: &mut Rng) -> Network {
    let mut network = network.clone();
    for layer in network.frame.iter_mut().chain(&mut network.net) {
        for weight in layer.weight.iter_mut().chain(&mut layer.bias) {
            // Weights are f32 themselves: one step up or down, or none.
            *weight = match rng.uniform() {
                r if r < 1.0 / 3.0 => weight.next_up(),
                r if r < 2.0 / 3.0 => weight.next_down(),
                _ => *weight,
            };
        }
    }
    if let Geometry::Charts(charts) = &mut network.spec.geometry {
        for alpha in &mut charts.alpha {
            match alpha {
                Roughness::Fixed(value) | Roughness::Free { factor: value, .. } => {
                    *value = moved(*value, rng)
                }
            }
        }
    }
    network
}

fn moved_query(query: &Exact, rng: &mut Rng) -> Exact {
    let mut unit = |w: [f64; 3]| normalised(w.map(|c| moved(c, rng)));
    let (wo, wi) = (unit(query.wo), unit(query.wi));
    Exact {
        params: query.params.iter().map(|p| moved(*p, rng)).collect(),
        wo,
        wi,
        u: query.u.map(|u| moved(u, rng)),
    }
}

/// How much roundings of the charts' own numbers grow on the way of `wi` into the frames of `network`: those of the boost's
/// velocity by the boost and by the slopes of the frame, those of the frame's shear by what it subtracts.
pub fn condition(network: &Network, query: &Exact, wi: [f64; 3]) -> f64 {
    let (wo, turn) = oracle::fold(network.spec.symmetry, query.wo);
    let w = oracle::folded(turn, wi);
    let of_chart = |(_, chart): (f64, Chart)| {
        let (v, scale) = chart.boost.inverse().apply(w);
        let Frame { x, y, shear, b } = chart.frame;
        let (px, shift) = ((v[0] - b[0] * v[2]) / x, b[0].abs() / x + b[1].abs() / y);
        let py = (v[1] - b[1] * v[2]) / y - shear * px;
        let m = (px * px + py * py + v[2] * v[2]).sqrt();
        let steep = 1.0 / x + 1.0 / y + shear.abs() / x;
        1.0 + (steep * scale.sqrt() + (shear * px).abs() + shift * v[2]) / m
    };
    let charts = oracle::charts_of(network, &query.params, wo);
    charts.into_iter().map(of_chart).fold(1.0, f64::max)
}

/// How much roundings of the boost's velocity grow on the way to the drawn light: see [`condition`].
pub fn boost_condition(network: &Network, query: &Exact, sample: &OracleSample) -> f64 {
    let (wo, turn) = oracle::fold(network.spec.symmetry, query.wo);
    let w = oracle::folded(turn, sample.wi);
    match oracle::charts_of(network, &query.params, wo).get(sample.chart) {
        Some((_, chart)) => 1.0 + 1.0 / chart.boost.inverse().apply(w).1.sqrt(),
        None => 1.0,
    }
}

/// The Jacobian with all its terms added instead of subtracted, from differences of the position; these vanish where u is
/// next to its limits.
pub fn terms(network: &Network, query: &Exact, sample: &OracleSample) -> f64 {
    let at = |j: usize, by: f64| {
        let mut u = query.u;
        u[j] += by * u[j].min(1.0 - u[j]);
        let moved = oracle::sample(network, &query.params, query.wo, u);
        (u[j], moved.square)
    };
    let slopes = [0, 1].map(|j: usize| {
        let ((low, a), (high, b)) = (at(j, -1e-5), at(j, 1e-5));
        [0, 1].map(|c: usize| ((b[c] - a[c]) / (high - low)).abs())
    });
    let area = match network.spec.charts() {
        Some(_) => (sample.jacobian / sample.det).abs(),
        None => 4.0 / sample.wi[2],
    };
    let terms = area * (slopes[0][0] * slopes[1][1] + slopes[0][1] * slopes[1][0]);
    terms.max(sample.jacobian.abs())
}

/// What an answer should be, and how far off it may be.
#[derive(Clone, Copy, Debug)]
pub struct Expected {
    /// What the oracle answers.
    pub value: f64,
    /// What rounding may change it by, in the unit of the answer.
    pub tolerance: f64,
}

/// What every query should give, column by column, if `answer` is what the oracle gives and `floors` what that may be off by
/// beside what moves show.
pub fn expected(
    material: &BakedMaterial,
    queries: &Queries,
    seed: u64,
    answer: impl Fn(&BakedMaterial, &Exact) -> Vec<f64>,
    floors: impl Fn(&BakedMaterial, &Exact, &[f64]) -> Vec<f64>,
) -> Vec<Vec<Expected>> {
    let mut rng = Rng::new(&[0x30fed, seed]);
    let copies: Vec<BakedMaterial> = (0..COPIES)
        .map(|_| BakedMaterial {
            sample: moved_network(&material.sample, &mut rng),
            eval: moved_network(&material.eval, &mut rng),
            pdf: moved_network(&material.pdf, &mut rng),
        })
        .collect();
    let mut columns: Vec<Vec<Expected>> = Vec::new();
    for i in 0..queries.len() {
        let query = queries.at(i);
        let row = answer(material, &query);
        let mut changes = vec![0.0f64; row.len()];
        for copy in &copies {
            let other = answer(copy, &moved_query(&query, &mut rng));
            for ((change, value), other) in changes.iter_mut().zip(&row).zip(other) {
                *change = change.max((value - other).abs());
            }
        }
        columns.resize_with(row.len(), Vec::new);
        let floors = floors(material, &query, &row);
        for (((column, value), change), floor) in columns.iter_mut().zip(row).zip(changes).zip(floors) {
            column.push(Expected {
                value,
                tolerance: MOVES_ALLOWED * change + floor,
            });
        }
    }
    columns
}
