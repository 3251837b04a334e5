//! The light that rises to the interface from below, as many walks from one direction to the camera tell it.
//!
//! A medium that scatters evenly, over a diffuse base, sends up light that depends on nothing but its slope. That
//! function is kept as Chebyshev series, so that any number of directions share any number of walks. What this
//! leaves out is round-off: see [`NODES`]. Otherwise the segments themselves are kept, and each serves one facet.

use super::Layered;
use super::eval::share;
use super::link::{Exit, Link};
use super::phase::henyey_greenstein;
use super::walk::{COS_MIN, Segment};
use crate::bsdf::usable;
use crate::random::stratified;
use crate::real::consts::{FRAC_1_PI, PI};
use crate::real::{Real, Vec3};

/// Key of the walks. It does not depend on `wo`, so that the noise of slices varies smoothly with it, too.
const WALK_KEY: u64 = 0x1a7e_51ce;

/// Stratified numbers of a walk after the facet where it enters: the first two flights, and the direction after each.
const CHOSEN: usize = 6;

/// Panels of slopes, each this many times as wide as the next.
const PANEL_RATIO: Real = 8.0;
/// Panels down to [`COS_MIN`].
const PANELS: usize = 7;
/// Chebyshev nodes per panel.
///
/// All terms are analytic but at a slope of 0 and below it. On a panel from a to 8a their series converge like
/// ρ^(−n) with ρ = 2.09 (Trefethen 2013, *Approximation Theory and Approximation Practice*, Thm 8.2): below 1e-8 here,
/// which is tested against the sum over the segments.
const NODES: usize = 26;

/// Radiance under the interface per flux that falls on it from `wo`.
#[derive(Clone, Debug)]
pub(super) enum Field {
    /// Chebyshev coefficients of the medium's light, over panels of slopes, and the light off the base at the base.
    Isotropic {
        /// One series per panel, RGB coefficients.
        medium: Vec<[Vec3; NODES]>,
        /// Per e^(−τ/μ').
        base: Vec3,
    },
    /// The segments of all walks.
    Directional(Vec<Connector>),
}

/// A segment of a walk, ready to connect.
#[derive(Clone, Copy, Debug)]
pub(super) struct Connector {
    link: Link,
    direction: Vec3,
    /// Throughput times the albedo of the medium, and times the reflectance of the base, RGB, over the walks.
    medium: Vec3,
    base: Vec3,
    /// As in [`Segment`].
    first: Option<Real>,
}

impl Field {
    /// What `walks` walks from `wo` tell, keyed by `seed`; the facets through which they enter and their first
    /// vertices are stratified by Sobol points.
    pub fn new(layered: &Layered, wo: Vec3, walks: usize, seed: u64) -> Field {
        if layered.g != 0.0 {
            let mut connectors = Vec::new();
            connect_walks(layered, wo, walks, seed, |connector| connectors.push(connector));
            return Field::Directional(connectors);
        }
        let exits: Vec<Exit> = (0..PANELS * NODES)
            .map(|k| Exit::at_slope(layered, node_slope(k / NODES, k % NODES)))
            .collect();
        let mut values = vec![Vec3::ZERO; exits.len()];
        let mut base = Vec3::ZERO;
        let phase = henyey_greenstein(Vec3::Z, Vec3::Z, 0.0);
        connect_walks(layered, wo, walks, seed, |connector| {
            for (value, exit) in values.iter_mut().zip(&exits) {
                *value += connector.medium * (connector.link.scattered(layered, exit) * phase);
            }
            base += connector.base * connector.link.based();
        });
        Field::Isotropic {
            medium: values.chunks_exact(NODES).map(coefficients).collect(),
            base,
        }
    }

    /// A share 1/`of` of the radiance along `exit`, RGB: the `part`-th, so that all together are unbiased.
    ///
    /// Where segments are kept, each counts with its [`share`] against `others` walks the other way for each of these.
    #[inline]
    pub fn part(&self, layered: &Layered, exit: &Exit, part: usize, of: usize, others: Real) -> Vec3 {
        match self {
            Field::Isotropic { medium, base } => {
                let (panel, x) = panel_of(exit.slope());
                let series = clenshaw(&medium[panel], x);
                (series.max(Vec3::ZERO) + *base * exit.base_way()) / of as Real
            }
            Field::Directional(connectors) => connectors
                [connectors.len() * part / of..connectors.len() * (part + 1) / of]
                .iter()
                .map(|c| {
                    let phase = henyey_greenstein(c.direction, exit.direction, layered.g);
                    let share = |last| share(c.first, last, others);
                    let scattered = c.link.scattered(layered, exit) * phase * share(phase);
                    let based = c.link.based() * exit.base_way() * share(c.direction.z.abs() * FRAC_1_PI);
                    c.medium * scattered + c.base * based
                })
                .sum(),
        }
    }
}

/// Walks `walks` times and hands every segment over.
fn connect_walks(layered: &Layered, wo: Vec3, walks: usize, seed: u64, mut tell: impl FnMut(Connector)) {
    if !usable(wo) {
        return;
    }
    let dye = layered.dye();
    for (u, mut rest) in stratified::<CHOSEN>(WALK_KEY, seed, walks) {
        let Some(entered) = layered.enter(wo, u) else {
            continue;
        };
        let throughput = entered.share * entered.masking / walks as Real;
        let start = Segment::start(entered.direction, Vec3::ONE);
        layered.walk_inside(start, &dye, true, &mut rest, |segment| {
            tell(Connector {
                link: Link::new(layered, segment),
                direction: segment.direction,
                medium: segment.throughput * dye.albedo * throughput,
                base: segment.throughput * dye.base * throughput,
                first: segment.first,
            });
        });
    }
}

/// Slope of Chebyshev node `node` of `panel`; panel 0 reaches from 1/[`PANEL_RATIO`] to 1.
fn node_slope(panel: usize, node: usize) -> Real {
    let x = (PI * (node as Real + 0.5) / NODES as Real).cos();
    let highest = PANEL_RATIO.powi(-(panel as i32));
    let (half, centre) = (0.5 * (1.0 - 1.0 / PANEL_RATIO), 0.5 * (1.0 + 1.0 / PANEL_RATIO));
    (highest * (centre + half * x)).max(COS_MIN)
}

/// Panel of a slope, and where in it that is, in [−1, 1].
#[inline]
fn panel_of(slope: Real) -> (usize, Real) {
    let mut highest = 1.0;
    let mut panel = 0;
    while slope * PANEL_RATIO < highest && panel + 1 < PANELS {
        highest /= PANEL_RATIO;
        panel += 1;
    }
    let (half, centre) = (0.5 * (1.0 - 1.0 / PANEL_RATIO), 0.5 * (1.0 + 1.0 / PANEL_RATIO));
    (panel, ((slope / highest - centre) / half).clamp(-1.0, 1.0))
}

/// Chebyshev coefficients of the polynomial through `values` at the nodes.
fn coefficients(values: &[Vec3]) -> [Vec3; NODES] {
    std::array::from_fn(|m| {
        let sum: Vec3 = values
            .iter()
            .enumerate()
            .map(|(j, value)| *value * (m as Real * PI * (j as Real + 0.5) / NODES as Real).cos())
            .sum();
        let twice = if m == 0 { 1.0 } else { 2.0 };
        sum * (twice / NODES as Real)
    })
}

/// The series at `x` (Clenshaw 1955, *A Note on the Summation of Chebyshev Series*).
#[inline]
fn clenshaw(series: &[Vec3; NODES], x: Real) -> Vec3 {
    let (mut next, mut after) = (Vec3::ZERO, Vec3::ZERO);
    for c in series[1..].iter().rev() {
        (next, after) = (*c + next * (2.0 * x) - after, next);
    }
    series[0] + next * x - after
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative error of the series: what 26 nodes leave, times ten for the constant before it.
    const SERIES_TOL: Real = 1e-7;

    /// The series against the sum over the segments that they were made from.
    #[test]
    fn the_series_is_the_sum_over_segments() {
        const WALKS: usize = 300;
        let wo = Vec3::new(0.6, 0.3, 0.7).normalize();
        for (alpha, eta, sigma_t) in [
            (0.3, 1.5, 0.8),
            (0.5, 1.0, 0.001),
            (0.2, 1.3, 30.0),
            (0.4, 0.8, 2.0),
        ] {
            let layered = Layered::new(alpha, eta, sigma_t, [0.9, 0.6, 0.3], [0.8, 0.5, 0.2], 0.0)
                .expect("valid parameters");
            let series = Field::new(&layered, wo, WALKS, 3);
            let mut connectors = Vec::new();
            connect_walks(&layered, wo, WALKS, 3, |c| connectors.push(c));
            let sum = Field::Directional(connectors);
            for k in 0..400 {
                let slope = COS_MIN.powf(k as Real / 399.0);
                let exit = Exit::at_slope(&layered, slope);
                let [a, b] = [&series, &sum].map(|field| field.part(&layered, &exit, 0, 1, 0.0));
                let error = (a - b).abs().max_element() / b.max_element();
                assert!(error < SERIES_TOL, "{error} at slope {slope}, sigma_t {sigma_t}");
            }
        }
    }
}
