//! Fits a lobe frame to a slice by expectation–maximisation.
//!
//! In slope space (x/z, y/z) a frame is an affine map and its base density a bivariate Student-t with ν = 2,
//! so the classical iteration applies (Liu and Rubin 1995, *ML estimation of the t distribution*): weight
//! every direction by 2z² of its local direction, take mean and covariance, and compose.

use bake_runtime::frame::Frame;

use crate::spline::cell_centre;

/// Quadrature nodes per side of the frame's square.
const NODES: usize = 48;
/// Iterations allowed; 11–19 suffice for GGX lobes.
const ITERATIONS: usize = 40;
/// Change of the frame, in local slopes, at which the fit has converged.
const CONVERGED: f64 = 1e-4;
/// Added to the covariance: a lobe narrower than this in the frame of the last iteration is still shrinking.
const COVARIANCE_FLOOR: f64 = 1e-10;

/// Fits a frame to `f_cos` (sr⁻¹, ≥ 0) starting from `start`.
pub fn fit(f_cos: impl Fn([f64; 3]) -> f64, start: Frame) -> Frame {
    let mut frame = start;
    for _ in 0..ITERATIONS {
        let (mut mass, mut weight, mut mean) = (0.0, 0.0, [0.0; 2]);
        let mut second = [0.0; 3];
        for k in 0..NODES * NODES {
            let s = cell_centre(k, NODES);
            let (w, jacobian_cos) = frame.square_to_direction(s, [1.0 - s[0], 1.0 - s[1]]);
            let ([x, y, z], _) = frame.to_local(w);
            let q = f_cos(w) * jacobian_cos / w[2];
            // With the slope (x, y)/z and the weight 2z² only x, y and z appear, all bounded.
            mass += q;
            weight += 2.0 * q * z * z;
            mean = [mean[0] + 2.0 * q * x * z, mean[1] + 2.0 * q * y * z];
            second = [
                second[0] + 2.0 * q * x * x,
                second[1] + 2.0 * q * x * y,
                second[2] + 2.0 * q * y * y,
            ];
        }
        if !(mass > 0.0 && weight > 0.0) {
            return frame;
        }
        let b = [mean[0] / weight, mean[1] / weight];
        let covariance = |s: f64, i: usize, j: usize| 2.0 * (s - weight * b[i] * b[j]) / mass;
        let xx = covariance(second[0], 0, 0) + COVARIANCE_FLOOR;
        let (xy, yy) = (
            covariance(second[1], 0, 1),
            covariance(second[2], 1, 1) + COVARIANCE_FLOOR,
        );
        // Cholesky factor of the covariance: a step in the same lower-triangular form as the frame itself.
        let l11 = xx.sqrt();
        let l21 = xy / l11;
        let l22 = (yy - l21 * l21).max(COVARIANCE_FLOOR).sqrt();
        frame = Frame {
            x: frame.x * l11,
            y: frame.y * l22,
            shear: (frame.shear * l11 + l21) / l22,
            b: [
                frame.b[0] + frame.x * b[0],
                frame.b[1] + frame.y * (frame.shear * b[0] + b[1]),
            ],
        };
        let change = b[0]
            .abs()
            .max(b[1].abs())
            .max((l11 - 1.0).abs())
            .max((l22 - 1.0).abs())
            .max(l21.abs());
        if change < CONVERGED {
            break;
        }
    }
    frame
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 48² midpoint nodes on the density of the frame that generated it.
    const RECOVERY_TOL: f64 = 2e-3;

    #[test]
    fn recovers_the_frame_that_made_the_density() {
        let truth = Frame {
            x: 0.35,
            y: 0.2,
            shear: 0.4,
            b: [-1.2, 0.5],
        };
        let found = fit(|w| truth.to_local(w).1, Frame::IDENTITY);
        assert!((found.x / truth.x - 1.0).abs() < RECOVERY_TOL, "{found:?}");
        assert!((found.y / truth.y - 1.0).abs() < RECOVERY_TOL);
        assert!((found.shear - truth.shear).abs() < RECOVERY_TOL * 10.0);
        assert!(
            (found.b[0] - truth.b[0]).abs() < RECOVERY_TOL && (found.b[1] - truth.b[1]).abs() < RECOVERY_TOL
        );
    }
}
