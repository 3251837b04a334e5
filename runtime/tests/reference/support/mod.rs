//! What the tests of the reference models share: directions, means with standard errors, tables of independent
//! values, quadrature and χ².

pub mod chi_square;
pub mod draws;
pub mod histogram;
pub mod quadrature;
pub mod table;

pub use bake_runtime::bsdf::direction;
use bake_runtime::frame::Frame;
use glam::DVec3;

/// Agreement asked of a Monte Carlo comparison, in combined standard errors.
pub const SIGMAS: f64 = 3.0;
/// Round-off of a handful of f64 operations whose terms do not cancel.
pub const ROUND_OFF: f64 = 1e-11;

/// Sums for means of several numbers and their standard errors.
#[derive(Clone, Debug)]
pub struct Means<const N: usize> {
    n: f64,
    sum: [f64; N],
    square: [f64; N],
}

impl<const N: usize> Means<N> {
    /// Means of `n` draws.
    pub fn of(n: usize, mut draw: impl FnMut() -> [f64; N]) -> Self {
        let mut means = Means {
            n: n as f64,
            sum: [0.0; N],
            square: [0.0; N],
        };
        for _ in 0..n {
            for (i, x) in draw().into_iter().enumerate() {
                means.sum[i] += x;
                means.square[i] += x * x;
            }
        }
        means
    }

    pub fn mean(&self, i: usize) -> f64 {
        self.sum[i] / self.n
    }

    pub fn variance(&self, i: usize) -> f64 {
        (self.square[i] / self.n - self.mean(i).powi(2)).max(0.0)
    }

    pub fn se(&self, i: usize) -> f64 {
        (self.variance(i) / self.n).sqrt()
    }
}

/// A frame on the lobe that a surface of roughness `alpha` mirrors `wo` to, pulled back from the horizon by the roughness.
pub fn lobe_frame(wo: DVec3, alpha: [f64; 2]) -> Frame {
    let scale = -1.0 / (wo.z + (alpha[0] * wo.x).hypot(alpha[1] * wo.y));
    Frame {
        x: alpha[0],
        y: alpha[1],
        shear: 0.0,
        b: [scale * wo.x, scale * wo.y],
    }
}

/// Asserts that `found ± se` and `expected ± expected_se` agree within [`SIGMAS`] plus `slack`.
pub fn assert_agree(found: (f64, f64), expected: (f64, f64), slack: f64, what: &str) {
    let tolerance = SIGMAS * found.1.hypot(expected.1) + slack;
    assert!(
        (found.0 - expected.0).abs() <= tolerance,
        "{what}: {found:?}, expected {expected:?} ± {tolerance}"
    );
}
