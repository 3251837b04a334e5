//! The analytic proposal of Sztrajman et al. 2021, *Neural BRDF Representation and Importance Sampling*: a cosine lobe and
//! a Blinn–Phong lobe around the normal, fitted to one slice.
//!
//! Sztrajman et al. have a network predict the lobe of a material. Here the exponent and the share of the lobe are fitted to
//! every slice by itself, by least squares: no network that predicts them can do better by that measure.

use super::KnownDensity;
use crate::lobes::{LUMINANCE, Lobe, LobeSlice, direction_at};
use crate::spline::{edge_cell_centre, edge_cell_weight};
use bake_runtime::chart::Chart;
use bake_runtime::concentric::square_to_hemisphere;
use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, TAU};

/// Exponents that a fit may end at: broader than any cosine, and narrower than an alpha of 1e-4.
const EXPONENT: [f64; 2] = [1e-2, 1e9];
/// Exponents tried on the way, evenly in their logarithm, a third apart.
const TRIALS: usize = 80;
/// Golden sections of the best three trials: the logarithm of the exponent is then known to 1e-6.
const SECTIONS: usize = 30;
/// Nodes per side and chart of the quadrature that a fit minimises over.
const NODES: usize = 128;

/// The two lobes over the hemisphere for one `wo`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlinnPhong {
    /// Camera direction.
    pub wo: DVec3,
    /// Exponent of the cosine between the half vector and the normal.
    pub exponent: f64,
    /// Probability of the half-vector lobe; the rest is the cosine lobe.
    pub share: f64,
}

/// A node of a quadrature over the hemisphere.
struct Node {
    wi: DVec3,
    /// What the density of directions should be, sr⁻¹.
    target: f64,
    /// sr.
    solid_angle: f64,
}

/// Nodes in the charts of `slice`, each chart's weighted by its share of the nodes around it, under the slice's luminance,
/// whose integral is made 1.
fn nodes_of(slice: &LobeSlice) -> Vec<Node> {
    let charts: Vec<Chart> = slice.fitted().into_iter().map(|(_, chart)| chart).collect();
    let count = NODES * NODES;
    let mut nodes = Vec::with_capacity(charts.len() * count);
    for chart in &charts {
        for k in 0..count {
            let (wi, area) = direction_at(chart, edge_cell_centre(k, NODES));
            // Balance heuristic: the density of the chart's own nodes over that of all.
            let own = 1.0 / area;
            let all: f64 = charts.iter().map(|c| c.density(wi.to_array())).sum();
            nodes.push(Node {
                wi,
                target: slice.f_cos(Lobe::Whole, wi).dot(LUMINANCE),
                solid_angle: area * edge_cell_weight(k, NODES) / count as f64 * (own / all),
            });
        }
    }
    let energy: f64 = nodes.iter().map(|n| n.target * n.solid_angle).sum();
    nodes.iter_mut().for_each(|n| n.target /= energy);
    nodes
}

fn cosine_pdf(wi: DVec3) -> f64 {
    wi.z * FRAC_1_PI
}

/// Density of the half-vector lobe at `wi` above the horizon, sr⁻¹: (n+1) cosⁿθ_h / 2π over the 4 wo·h of the reflection.
fn half_pdf(wo: DVec3, wi: DVec3, exponent: f64) -> f64 {
    let h = (wo + wi).normalize();
    // cos² θ_h = 1 − sin², which is what a large exponent needs precisely.
    let log_cos = 0.5 * (-(h.x * h.x + h.y * h.y)).ln_1p();
    (exponent + 1.0) * (exponent * log_cos).exp() / (TAU * 4.0 * wo.dot(h))
}

/// The share of the half-vector lobe of `exponent` in [0, 1] that leaves the least squared error, and that error.
fn best_share(wo: DVec3, exponent: f64, nodes: &[Node]) -> (f64, f64) {
    // target − cosine = share·(half − cosine): linear regression through the origin.
    let (mut ab, mut bb, mut aa) = (0.0, 0.0, 0.0);
    for node in nodes {
        let a = node.target - cosine_pdf(node.wi);
        let b = half_pdf(wo, node.wi, exponent) - cosine_pdf(node.wi);
        aa += a * a * node.solid_angle;
        ab += a * b * node.solid_angle;
        bb += b * b * node.solid_angle;
    }
    let share = if bb > 0.0 { (ab / bb).clamp(0.0, 1.0) } else { 0.0 };
    (share, aa - 2.0 * share * ab + share * share * bb)
}

/// The lobes nearest to the target of `nodes` in L2 over solid angles.
fn fit_nodes(wo: DVec3, nodes: &[Node]) -> BlinnPhong {
    let [low, high] = EXPONENT.map(f64::ln);
    let step = (high - low) / (TRIALS - 1) as f64;
    let error = |log: f64| best_share(wo, log.exp(), nodes).1;
    let trials: Vec<f64> = (0..TRIALS).map(|i| error(low + step * i as f64)).collect();
    let best = (0..TRIALS).fold(0, |best, i| if trials[i] < trials[best] { i } else { best });
    let centre = low + step * best as f64;
    let (mut a, mut b) = ((centre - step).max(low), (centre + step).min(high));
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut c, mut d) = (b - golden * (b - a), a + golden * (b - a));
    let (mut at_c, mut at_d) = (error(c), error(d));
    for _ in 0..SECTIONS {
        if at_c < at_d {
            (b, d, at_d) = (d, c, at_c);
            c = b - golden * (b - a);
            at_c = error(c);
        } else {
            (a, c, at_c) = (c, d, at_d);
            d = a + golden * (b - a);
            at_d = error(d);
        }
    }
    let exponent = (0.5 * (a + b)).exp();
    BlinnPhong {
        wo,
        exponent,
        share: best_share(wo, exponent, nodes).0,
    }
}

impl BlinnPhong {
    /// Fits exponent and share to the luminance of `slice`, divided by its albedo, by least squares over solid angles.
    pub fn fit(slice: &LobeSlice) -> BlinnPhong {
        fit_nodes(slice.wo, &nodes_of(slice))
    }
}

impl KnownDensity for BlinnPhong {
    fn sample(&self, [u, v]: [f64; 2]) -> Option<(DVec3, f64)> {
        let wi = if u < self.share {
            let u = u / self.share;
            // 1 − u has the density (n+1) cosⁿθ_h sinθ_h where cosθ_h = (1 − u)^(1/(n+1)).
            let log_cos = (-u).ln_1p() / (self.exponent + 1.0);
            let sin = (-(2.0 * log_cos).exp_m1()).sqrt();
            let (y, x) = (TAU * v).sin_cos();
            let h = DVec3::new(sin * x, sin * y, log_cos.exp());
            (2.0 * self.wo.dot(h) * h - self.wo).normalize()
        } else {
            let u = ((u - self.share) / (1.0 - self.share)).min(1.0 - f64::EPSILON);
            DVec3::from_array(square_to_hemisphere([u, v], [1.0 - u, 1.0 - v]))
        };
        (wi.z > 0.0).then(|| (wi, self.pdf(wi)))
    }

    fn pdf(&self, wi: DVec3) -> f64 {
        if wi.z <= 0.0 {
            return 0.0;
        }
        self.share * half_pdf(self.wo, wi, self.exponent) + (1.0 - self.share) * cosine_pdf(wi)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::comparators::tests::assert_samples_follow_pdf;
    use crate::lobes::WALKS;
    use bake_runtime::bsdf::direction;
    use bake_runtime::conductor::Conductor;
    use bake_runtime::principled::{Principled, PrincipledParameters};

    /// The bracket that golden sections leave, and the round-off of sums.
    const RECOVERY_TOL: f64 = 1e-5;
    /// Quadrature of the cosine on 128² crowded nodes of two charts.
    const QUADRATURE_TOL: f64 = 1e-3;

    fn plastic() -> Principled {
        Principled::new(PrincipledParameters {
            roughness: 0.2,
            ..PrincipledParameters::default()
        })
        .expect("valid parameters")
    }

    #[test]
    fn samples_follow_the_density() {
        for (theta, exponent, share) in [
            (0.0, 30.0, 0.5),
            (50.0, 80.0, 0.7),
            (85.0, 20.0, 0.9),
            (60.0, 5.0, 1.0),
        ] {
            let wo = direction(theta, 100.0);
            assert_samples_follow_pdf(&BlinnPhong { wo, exponent, share });
        }
    }

    #[test]
    fn what_falls_below_the_horizon_is_lost() {
        let wo = direction(85.0, 0.0);
        let half = |exponent| BlinnPhong {
            wo,
            exponent,
            share: 1.0,
        };
        // Half of the normals around n are turned towards wo's own horizon.
        assert_eq!(half(5.0).sample([0.9, 0.5]), None);
        assert!(half(1e6).sample([0.9, 0.5]).is_some());
    }

    #[test]
    fn a_fit_recovers_its_own_lobes() {
        let bsdf = Conductor::new([0.3, 0.1], [0.9; 3]).expect("valid parameters");
        for (theta, exponent, share) in [(30.0, 100.0, 0.8), (80.0, 20.0, 0.3), (60.0, 5000.0, 1.0)] {
            let wo = direction(theta, 10.0);
            let truth = BlinnPhong { wo, exponent, share };
            let mut nodes = nodes_of(&LobeSlice::new(&bsdf, wo, 1, 0).expect("bright"));
            nodes.iter_mut().for_each(|n| n.target = truth.pdf(n.wi));
            let found = fit_nodes(wo, &nodes);
            assert!(
                (found.exponent / exponent - 1.0).abs() < RECOVERY_TOL,
                "{found:?}"
            );
            assert!((found.share - share).abs() < RECOVERY_TOL, "{found:?}");
        }
    }

    /// The oracle: the error itself, summed up at every pair of a grid.
    #[test]
    fn no_other_lobes_fit_better() {
        let (metal, plastic) = (
            Conductor::new([0.3, 0.1], [0.9; 3]).expect("valid parameters"),
            plastic(),
        );
        let wo = direction(70.0, 30.0);
        for slice in [
            LobeSlice::new(&metal, wo, WALKS, 0).expect("bright"),
            LobeSlice::new(&plastic, wo, 1, 0).expect("bright"),
        ] {
            let nodes = nodes_of(&slice);
            let error = |lobes: BlinnPhong| -> f64 {
                let square = |n: &Node| (n.target - lobes.pdf(n.wi)).powi(2) * n.solid_angle;
                nodes.iter().map(square).sum()
            };
            let fitted = BlinnPhong::fit(&slice);
            let best = error(fitted);
            for i in 0..40 {
                for j in 0..=10 {
                    let exponent = 10f64.powf(-1.0 + 0.15 * f64::from(i));
                    let share = 0.1 * f64::from(j);
                    assert!(
                        best <= error(BlinnPhong { wo, exponent, share }),
                        "{fitted:?} {exponent} {share}"
                    );
                }
            }
        }
    }

    #[test]
    fn nodes_of_two_charts_cover_the_hemisphere_once() {
        let plastic = plastic();
        let slice = LobeSlice::new(&plastic, direction(60.0, 0.0), 1, 0).expect("bright");
        assert_eq!(slice.charts().len(), 2);
        let nodes = nodes_of(&slice);
        let cosine: f64 = nodes.iter().map(|n| cosine_pdf(n.wi) * n.solid_angle).sum();
        assert!((cosine - 1.0).abs() < QUADRATURE_TOL, "{cosine}");
    }
}
