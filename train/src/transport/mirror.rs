//! Where the chart of a mirrored lobe starts from: boosted to the mirror direction, in the shape that the slopes of the
//! facets give it.

use bake_runtime::boost::Boost;
use bake_runtime::chart::Chart;
use bake_runtime::frame::{Frame, mirror_anchor};
use glam::DVec3;

/// How much more than its roughness pulls the boost of a lobe back from the horizon: chosen for the binning errors of 240
/// slices, alpha 0.01–1 along both axes and θ_o 75–89.5°, among 1, 2 and 4, and among other mean roughnesses.
const PULL: f64 = 2.0;

/// Largest variance of directional slopes that a start has: wider lobes fill the hemisphere.
const VARIANCE_MAX: f64 = 1.0;
/// Smallest variance, against division by zero.
const VARIANCE_MIN: f64 = 1e-12;

/// The chart from which the fit of a lobe mirrored at a surface of roughness `alpha` starts, for a unit `wo` above the
/// horizon.
///
/// The roughness of facets that tilt within the plane of `wo` pulls the boost back, b = −(x, y)/(z + pull·sin θ): a long
/// lobe that leaves that plane stays straight only under nearly the full boost. Slopes of half vectors around the normal are facet slopes with the part along wo's azimuth over
/// cos θ (see [`bake_runtime::boost`]); slopes of directions are about twice those.
pub fn mirror_chart(wo: DVec3, alpha: [f64; 2]) -> Chart {
    let slope = mirror_anchor(wo.to_array(), [PULL * alpha_within(wo, alpha); 2]);
    let steepness = slope[0].hypot(slope[1]);
    let along = match steepness > 0.0 {
        true => slope.map(|s| s / steepness),
        false => [1.0, 0.0],
    };
    let stretch = steepness.hypot(1.0) - 1.0;
    let stretched = |i: usize, k: usize| f64::from(u8::from(i == k)) + stretch * along[i] * along[k];
    let variance = |i: usize, j: usize| -> f64 {
        (0..2)
            .map(|k| 4.0 * stretched(i, k) * alpha[k] * alpha[k] * stretched(k, j))
            .sum()
    };
    Chart {
        frame: frame_of(capped([variance(0, 0), variance(0, 1), variance(1, 1)])),
        boost: Boost::to_slope(slope),
    }
}

/// Half the chord that the plane of `wo` cuts out of the ellipse with semi-axes `alpha`.
fn alpha_within(wo: DVec3, alpha: [f64; 2]) -> f64 {
    let sin = wo.x.hypot(wo.y);
    match sin > 0.0 {
        true => alpha[0] * alpha[1] * sin / (alpha[0] * wo.y).hypot(alpha[1] * wo.x),
        false => alpha[0].min(alpha[1]),
    }
}

/// The symmetric matrix `[xx, xy, yy]` with its eigenvalues capped.
fn capped([xx, xy, yy]: [f64; 3]) -> [f64; 3] {
    let (mean, half) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
    // The smaller eigenvalue by the determinant: a difference would lose it.
    let larger = mean + half;
    let smaller = (xx * yy - xy * xy) / larger;
    let [larger, smaller] = [larger, smaller].map(|l| l.clamp(VARIANCE_MIN, VARIANCE_MAX));
    let (sin, cos) = (0.5 * (2.0 * xy).atan2(xx - yy)).sin_cos();
    [
        larger * cos * cos + smaller * sin * sin,
        (larger - smaller) * sin * cos,
        larger * sin * sin + smaller * cos * cos,
    ]
}

/// The frame whose A·Aᵀ is the matrix `[xx, xy, yy]`.
fn frame_of([xx, xy, yy]: [f64; 3]) -> Frame {
    let x = xx.sqrt();
    let below = xy / x;
    let y = (yy - below * below).max(VARIANCE_MIN).sqrt();
    Frame {
        x,
        y,
        shear: below / y,
        b: [0.0; 2],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::bsdf::direction;

    /// Round-off of a few operations.
    const TOL: f64 = 1e-9;

    #[test]
    fn at_normal_incidence_the_start_is_the_roughness() {
        let chart = mirror_chart(DVec3::Z, [0.1, 0.02]);
        assert_eq!(chart.boost, Boost::NONE);
        let Frame { x, y, shear, b } = chart.frame;
        assert!((x - 0.2).abs() < TOL && (y - 0.04).abs() < TOL && shear.abs() < TOL && b == [0.0; 2]);
    }

    #[test]
    fn smooth_surfaces_boost_to_the_mirror_direction_and_rough_ones_less() {
        let wo = direction(70.0, 30.0);
        let towards = |alpha: f64| mirror_chart(wo, [alpha; 2]).boost.apply([0.0, 0.0, 1.0]).0;
        let smooth = towards(1e-6);
        assert!((smooth[0] + wo.x).abs() < 1e-5 && (smooth[1] + wo.y).abs() < 1e-5);
        assert!(towards(0.5)[2] > smooth[2]);
    }

    #[test]
    fn roughness_within_the_plane_of_the_camera() {
        for (phi, expected) in [(0.0, 0.3), (90.0, 0.1), (45.0, 0.3 * 0.1 * (2.0f64 / 0.1).sqrt())] {
            let found = alpha_within(direction(60.0, phi), [0.3, 0.1]);
            assert!((found - expected).abs() < TOL, "{found} {expected}");
        }
        assert_eq!(alpha_within(DVec3::Z, [0.3, 0.1]), 0.1);
    }

    #[test]
    fn variances_are_capped() {
        let [xx, xy, yy] = capped([50.0, 7.0, 1.0]);
        assert!(xx <= VARIANCE_MAX && (xx * yy - xy * xy) > 0.0 && xy > 0.0);
        assert!((capped([0.2, 0.1, 0.3])[1] - 0.1).abs() < TOL);
    }
}
