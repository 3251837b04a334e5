//! Where charts start from, before a network moves them: an analytic guess from `wo` and the roughness alone.
//!
//! A mirrored lobe is boosted to the mirror direction ([`crate::boost`]) in the shape that the slopes of the facets give
//! it; then what is left to learn hardly changes over decades of roughness. Diffuse light starts as a cosine lobe.

use crate::boost::Boost;
use crate::chart::Chart;
use crate::frame::Frame;
use serde::{Deserialize, Serialize};

/// How much more than its roughness pulls the boost of a lobe back from the horizon: chosen for the binning errors of 240
/// slices, alpha 0.01–1 along both axes and θ_o 75–89.5°, among 1, 2 and 4, and among other mean roughnesses.
pub const PULL: f64 = 2.0;

/// Variance of directional slopes that no start exceeds: wider lobes fill the hemisphere.
pub const VARIANCE_MAX: f64 = 1.0;

/// Number of [`anchor_scalars`].
pub const ANCHOR_SCALARS: usize = 6;

/// The kinds of start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Anchor {
    /// A lobe mirrored at a rough surface.
    Mirror,
    /// Light that left its direction behind: a cosine lobe around the normal.
    Diffuse,
}

impl Anchor {
    /// The start for a unit `wo`, z ≥ 0, over a surface of roughness `alpha` along x and y, > 0.
    pub fn chart(self, wo: [f64; 3], alpha: [f64; 2]) -> Chart {
        match self {
            Anchor::Mirror => mirror_chart(wo, alpha),
            Anchor::Diffuse => Chart::IDENTITY,
        }
    }
}

/// The start of a mirrored lobe.
///
/// The roughness of facets that tilt within the plane of `wo`, half the chord α_w which that plane cuts out of the ellipse
/// with semi-axes `alpha`, pulls the boost back from the horizon: the normal goes to the slope −(x, y)/d with
/// d = z + [`PULL`]·α_w·sin θ. Slopes of half vectors around the normal are facet slopes with the part along `wo`'s azimuth
/// over the boost's cosine (see [`crate::boost`]), slopes of directions about twice those: their variance is
/// S·diag(4α²)·S with S⁻¹ = 1 − ββᵀ/(1 + cos), and the frame has the variance V with V⁻¹ = S⁻¹·diag(1/4α²)·S⁻¹ + 1, which
/// keeps below [`VARIANCE_MAX`] = 1. All terms of its determinant are positive, so that long lobes lose no precision.
pub fn mirror_chart(wo: [f64; 3], alpha: [f64; 2]) -> Chart {
    let [x, y, z] = wo;
    let sin2 = x * x + y * y;
    let chord = (alpha[0] * y).hypot(alpha[1] * x).max(f64::MIN_POSITIVE);
    let d = z + PULL * alpha[0] * alpha[1] * sin2 / chord;
    let scale = 1.0 / (d * d + sin2).sqrt();
    let (beta, cos) = ([x * scale, y * scale], d * scale);

    let q = alpha.map(|a| 0.25 / (a * a));
    let k = 1.0 / (1.0 + cos);
    let (sxx, sxy, syy) = (
        1.0 - k * beta[0] * beta[0],
        -k * beta[0] * beta[1],
        1.0 - k * beta[1] * beta[1],
    );
    let pxx = sxx * sxx * q[0] + sxy * sxy * q[1] + 1.0 / VARIANCE_MAX;
    let pxy = sxx * sxy * q[0] + sxy * syy * q[1];
    let pyy = sxy * sxy * q[0] + syy * syy * q[1] + 1.0 / VARIANCE_MAX;
    let det = cos * cos * q[0] * q[1] + (pxx + pyy - 1.0 / VARIANCE_MAX) / VARIANCE_MAX;
    let root = det.sqrt();
    Chart {
        frame: Frame {
            x: pyy.sqrt() / root,
            y: 1.0 / pyy.sqrt(),
            shear: -pxy / root,
            b: [0.0; 2],
        },
        boost: Boost::with_cos(beta, cos),
    }
}

/// What networks are told about a mirror chart: β_x, β_y and the cosine of the boost, 1 + ½·ln x, 1 + ½·ln y, and
/// shear/√(1 + shear²) of the frame. Within [−1.6, 1] for alpha ≥ 0.003.
pub fn anchor_scalars(chart: &Chart) -> [f64; ANCHOR_SCALARS] {
    let Frame { x, y, shear, .. } = chart.frame;
    let [bx, by] = chart.boost.velocity();
    [
        bx,
        by,
        chart.boost.cos(),
        1.0 + 0.5 * x.ln(),
        1.0 + 0.5 * y.ln(),
        shear / shear.hypot(1.0),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::direction;

    /// Round-off of a few operations.
    const TOL: f64 = 1e-9;
    /// The cap changes the variance of a lobe of alpha 0.02 by 4α².
    const CAP_TOL: f64 = 2e-3;

    #[test]
    fn at_normal_incidence_the_start_is_the_roughness() {
        let chart = mirror_chart([0.0, 0.0, 1.0], [0.02, 0.01]);
        assert_eq!(chart.boost, Boost::NONE);
        let Frame { x, y, shear, b } = chart.frame;
        assert!((x / 0.04 - 1.0).abs() < CAP_TOL && (y / 0.02 - 1.0).abs() < CAP_TOL && shear.abs() < TOL);
        assert_eq!(b, [0.0; 2]);
    }

    #[test]
    fn the_frame_has_the_capped_variance_of_stretched_slopes() {
        let alpha = [0.3, 0.05];
        let wo = direction(70.0, 35.0).to_array();
        let Chart { frame, boost } = mirror_chart(wo, alpha);
        let (beta, cos) = (boost.velocity(), boost.cos());
        // S = 1 + (1/cos − 1)·aaᵀ along the azimuth a; V = (M⁻¹ + 1)⁻¹ with M = S·diag(4α²)·S, by plain inverses.
        let length = beta[0].hypot(beta[1]);
        let a = beta.map(|b| b / length);
        let s = |i: usize, j: usize| f64::from(u8::from(i == j)) + (1.0 / cos - 1.0) * a[i] * a[j];
        let m = |i: usize, j: usize| {
            (0..2)
                .map(|k| s(i, k) * 4.0 * alpha[k] * alpha[k] * s(k, j))
                .sum::<f64>()
        };
        let inverse = |[xx, xy, yy]: [f64; 3]| {
            let det = xx * yy - xy * xy;
            [yy / det, -xy / det, xx / det]
        };
        let p = inverse([m(0, 0), m(0, 1), m(1, 1)]);
        let v = inverse([p[0] + 1.0, p[1], p[2] + 1.0]);
        let (xx, xy) = (frame.x * frame.x, frame.x * frame.y * frame.shear);
        let yy = frame.y * frame.y * (1.0 + frame.shear * frame.shear);
        for (found, expected) in [xx, xy, yy].into_iter().zip(v) {
            assert!((found - expected).abs() < TOL, "{found} {expected}");
        }
    }

    #[test]
    fn smooth_surfaces_boost_to_the_mirror_direction_and_rough_ones_less() {
        let wo = direction(70.0, 30.0);
        let towards = |alpha: f64| {
            mirror_chart(wo.to_array(), [alpha; 2])
                .boost
                .apply([0.0, 0.0, 1.0])
                .0
        };
        let smooth = towards(1e-6);
        assert!((smooth[0] + wo.x).abs() < 1e-5 && (smooth[1] + wo.y).abs() < 1e-5);
        assert!(towards(0.5)[2] > smooth[2]);
    }

    #[test]
    fn scalars_stay_small() {
        for (theta, phi) in [(0.0, 0.0), (60.0, 45.0), (89.99, 10.0), (89.99, 90.0)] {
            for alpha in [[0.01, 0.01], [1.0, 0.01], [0.01, 1.0], [1.0, 1.0], [0.003, 0.1]] {
                let scalars = anchor_scalars(&mirror_chart(direction(theta, phi).to_array(), alpha));
                assert!(
                    scalars.iter().all(|s| (-2.0..=1.1).contains(s)),
                    "{theta} {phi} {alpha:?}: {scalars:?}"
                );
            }
        }
    }
}
