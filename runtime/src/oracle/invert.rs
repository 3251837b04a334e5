//! The exact density of what a sampling network draws: its map inverted at a given direction by Newton's method.
//!
//! In the square of a chart the map is h = σ(logit u + g(u)). With t = logit u, the position of the direction gives
//! t + g(σ(t)) = logit h, whose Jacobian is I + ∂g/∂u·u(1 − u).

use super::{OracleSample, charts_of, fold, folded, shift};
use crate::concentric::hemisphere_to_square;
use crate::features::Point;
use crate::network::Network;

/// Longest step in either logit: beyond, the tangents say little. Chosen among 1, 2, 4 and 8 for the fewest steps on a
/// trained map.
pub const STEP_MAX: f64 = 2.0;

/// Smallest determinant whose Newton step is trusted; where it is smaller, next to folds, the step is that of a fixed
/// point.
pub const DET_MIN: f64 = 0.05;

/// Most evaluations of the network per chart.
const STEPS_MAX: usize = 200;

/// Largest residual of a logit that counts as solved.
const RESIDUAL_MAX: f64 = 1e-11;

/// What the inversion says.
#[derive(Clone, Debug, PartialEq)]
pub struct Inverted {
    /// The density, sr⁻¹.
    pub pdf: f64,
    /// Of every chart its share times its density.
    pub parts: Vec<f64>,
    /// Number of charts for which Newton's method did not converge; the density of the frame stands in there.
    pub unconverged: usize,
}

/// The density of what `network` draws at `params` and `wo`, at the direction `wi`, both above the horizon. Where the map
/// folds it is that of one of its branches. `None` on the disk, whose map need not be one to one.
pub fn exact_pdf(network: &Network, params: &[f64], wo: [f64; 3], wi: [f64; 3]) -> Option<Inverted> {
    let spec = network.spec.charts()?;
    let (wo, turn) = fold(network.spec.symmetry, wo);
    let wi = folded(turn, wi);
    let mut inverted = Inverted {
        pdf: 0.0,
        parts: Vec::new(),
        unconverged: 0,
    };
    for (c, (share, chart)) in charts_of(network, params, wo).into_iter().enumerate() {
        let mut point = Point::new(params, wo, Some(spec));
        point.chart = c;
        let (local, density) = chart.to_local(wi);
        let (h, rest) = hemisphere_to_square(local);
        let ratio = match solve(network, &mut point, [0, 1].map(|c| (h[c] / rest[c]).ln())) {
            Some((areas, det)) => areas[0] / (h[0] * rest[0]) * (areas[1] / (h[1] * rest[1])) / det.abs(),
            None => {
                inverted.unconverged += 1;
                1.0
            }
        };
        inverted.parts.push(share * density * ratio);
    }
    inverted.pdf = inverted.parts.iter().sum();
    Some(inverted)
}

/// The Jacobian that makes `f_cos · jacobian` an unbiased weight: that of the drawn chart, times the share that its exact
/// density has in the mixture at `wi`. Signed, sr. As [`super::jacobian`], with densities of the map itself.
pub fn mixture_jacobian(sample: &OracleSample, network: &Network, params: &[f64], wo: [f64; 3]) -> f64 {
    match exact_pdf(network, params, wo, sample.wi) {
        Some(Inverted { pdf, parts, .. }) if parts.len() > 1 => sample.jacobian * parts[sample.chart] / pdf,
        _ => sample.jacobian,
    }
}

/// u(1 − u) of both coordinates where the position has the logits `target`, and the Jacobian's determinant there.
fn solve(network: &Network, point: &mut Point, target: [f64; 2]) -> Option<([f64; 2], f64)> {
    let (mut t, mut start, mut step, mut least) = (target, target, [0.0; 2], f64::INFINITY);
    for _ in 0..STEPS_MAX {
        point.u = t.map(|t| 1.0 / (1.0 + (-t).exp()));
        let areas = t.map(|t| {
            let e = (-t.abs()).exp();
            e / ((1.0 + e) * (1.0 + e))
        });
        let (_, [[gx, xx, xy], [gy, yx, yy]]) = shift(network, point);
        let (xx, xy) = (1.0 + xx * areas[0], xy * areas[1]);
        let (yx, yy) = (yx * areas[0], 1.0 + yy * areas[1]);
        let det = xx * yy - xy * yx;
        let f = [t[0] + gx - target[0], t[1] + gy - target[1]];
        let residual = f[0].abs().max(f[1].abs());
        if residual <= RESIDUAL_MAX {
            return Some((areas, det));
        }
        if residual < least {
            (least, start) = (residual, t);
            step = match det > DET_MIN {
                true => [(yy * f[0] - xy * f[1]) / det, (xx * f[1] - yx * f[0]) / det],
                false => f,
            };
            let longest = step[0].abs().max(step[1].abs()).max(STEP_MAX);
            step = step.map(|s| -s * STEP_MAX / longest);
        } else {
            step = step.map(|s| 0.5 * s);
        }
        t = [0, 1].map(|c| start[c] + step[c]);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::super::tests::{charts, densities, sampler};
    use super::super::{eval, sample};
    use super::*;
    use crate::anchor::Anchor;
    use crate::bsdf::{direction, shifted_r2};
    use crate::chart::Chart;
    use crate::encoding::Encoding;
    use crate::spec::{Geometry, Role};

    /// Newton's residual and the way of a direction back into the square.
    const INVERSE_TOL: f64 = 1e-7;
    /// Midpoint quadrature with 400² nodes of a density with kinks along the diagonals of the concentric map.
    const QUADRATURE_TOL: f64 = 2e-3;
    /// The mean over 2¹⁶ R2 points of a weight that varies by a factor of a few.
    const MEAN_TOL: f64 = 3e-3;

    fn one_chart() -> Geometry {
        let Geometry::Charts(mut spec) = charts() else {
            unreachable!("charts are charts")
        };
        spec.anchors = vec![Anchor::Mirror];
        spec.inputs.truncate(1);
        Geometry::Charts(spec)
    }

    /// A mean over the hemisphere, sr.
    fn integral(f: impl Fn([f64; 3]) -> f64) -> f64 {
        let side = 400;
        let at = |k: usize| {
            let s = [(k % side) as f64 + 0.5, (k / side) as f64 + 0.5].map(|v| v / side as f64);
            let (wi, area) = Chart::IDENTITY.square_to_direction(s);
            f(wi) * area / (side * side) as f64
        };
        (0..side * side).map(at).sum()
    }

    #[test]
    fn the_density_of_samples_is_the_reciprocal_of_their_jacobian() {
        let network = sampler(one_chart(), Encoding::Centred);
        for k in 0..500 {
            let wo = direction(5.0 + 80.0 * k as f64 / 500.0, 130.0).to_array();
            let drawn = sample(&network, &[], wo, shifted_r2(k, [0.0; 2]));
            assert!(drawn.det > 0.0, "it folds");
            let inverted = exact_pdf(&network, &[], wo, drawn.wi).expect("there is a chart");
            let error = inverted.pdf * drawn.jacobian - 1.0;
            assert!(error.abs() < INVERSE_TOL && inverted.unconverged == 0, "{error}");
        }
    }

    #[test]
    fn densities_integrate_to_one() {
        let wo = direction(55.0, 130.0).to_array();
        for geometry in [one_chart(), charts()] {
            let network = sampler(geometry, Encoding::Centred);
            let density = |wi| {
                let inverted = exact_pdf(&network, &[], wo, wi).expect("there are charts");
                assert_eq!(inverted.unconverged, 0);
                inverted.pdf
            };
            let found = integral(density);
            assert!((found - 1.0).abs() < QUADRATURE_TOL, "{found}");
        }
        assert!(exact_pdf(&sampler(Geometry::Disk, Encoding::Centred), &[], wo, wo).is_none());
    }

    #[test]
    fn the_exact_mixture_is_unbiased() {
        let (sampler, eval_network) = (sampler(charts(), Encoding::Centred), densities(Role::Eval));
        let wo = direction(55.0, 130.0).to_array();
        let n = 1 << 16;
        let weight = |k: u64| {
            let drawn = sample(&sampler, &[], wo, shifted_r2(k, [0.0; 2]));
            eval(&eval_network, &[], wo, drawn.wi)[1] * mixture_jacobian(&drawn, &sampler, &[], wo)
        };
        let mean = (0..n).map(weight).sum::<f64>() / n as f64;
        let truth = integral(|wi| eval(&eval_network, &[], wo, wi)[1]);
        assert!((mean / truth - 1.0).abs() < MEAN_TOL, "{mean} {truth}");
    }
}
