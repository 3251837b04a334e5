//! The lobe frame: a bijection of the hemisphere that carries a cosine lobe onto a BSDF lobe.
//!
//! A local direction v goes to normalise(A·(x, y) + b·z, z), a linearly transformed cosine whose third row is
//! (0, 0, 1) (Heitz et al. 2016, *Real-Time Polygonal-Light Shading with Linearly Transformed Cosines*), so the
//! horizon stays the horizon and nothing is lost below it. Deviation: A is lower triangular; the rotation that
//! this leaves out only turns the local disk.

use crate::concentric::{DISK_AREA, disk_to_square, square_to_hemisphere};
use serde::{Deserialize, Serialize};

/// Number of outputs per chart of the network that predicts frames: `log_x`, `log_y`, `shear`, `delta_x`, `delta_y`.
pub const FRAME_OUTPUTS: usize = 5;

/// Largest |`log_x`|, |`log_y`|, |`shear`| and |`delta`| that a frame network may ask for.
///
/// Fitted frames differ from their start by less than 3; the clamp keeps an untrained or damaged network finite.
pub const FRAME_OUTPUT_MAX: f64 = 4.0;

/// A frame: A = [[x, 0], [y·shear, y]] and b.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// First diagonal element of A, > 0.
    pub x: f64,
    /// Second diagonal element of A, > 0.
    pub y: f64,
    /// A\[1\]\[0\] / A\[1\]\[1\].
    pub shear: f64,
    /// Slope (x/z, y/z) of the lobe's centre.
    pub b: [f64; 2],
}

impl Frame {
    /// The identity: local directions are directions.
    pub const IDENTITY: Frame = Frame {
        x: 1.0,
        y: 1.0,
        shear: 0.0,
        b: [0.0, 0.0],
    };

    /// The frame of a frame network's `outputs` ln x, ln y, shear, δ: A = A_start·[[x, 0], [y·shear, y]], b = A·δ.
    pub fn from_outputs(outputs: [f64; FRAME_OUTPUTS], start: &Frame) -> Frame {
        let [log_x, log_y, shear, dx, dy] = outputs.map(|v| v.clamp(-FRAME_OUTPUT_MAX, FRAME_OUTPUT_MAX));
        let (x, y) = (start.x * log_x.exp(), start.y * log_y.exp());
        let shear = start.shear * (log_x - log_y).exp() + shear;
        Frame {
            x,
            y,
            shear,
            b: [x * dx, y * (shear * dx + dy)],
        }
    }

    /// The outputs a frame network should give for this frame: the inverse of [`Frame::from_outputs`].
    pub fn to_outputs(&self, start: &Frame) -> [f64; FRAME_OUTPUTS] {
        let (log_x, log_y) = ((self.x / start.x).ln(), (self.y / start.y).ln());
        let dx = self.b[0] / self.x;
        let dy = self.b[1] / self.y - self.shear * dx;
        [
            log_x,
            log_y,
            self.shear - start.shear * (log_x - log_y).exp(),
            dx,
            dy,
        ]
    }

    /// det A, > 0.
    pub fn det(&self) -> f64 {
        self.x * self.y
    }

    /// Unit direction of the local direction `local`, and dω/dω_local.
    pub fn to_direction(&self, local: [f64; 3]) -> ([f64; 3], f64) {
        let [x, y, z] = local;
        let v = [
            self.x * x + self.b[0] * z,
            self.y * (self.shear * x + y) + self.b[1] * z,
            z,
        ];
        let n = (v[0] * v[0] + v[1] * v[1] + z * z).sqrt();
        ([v[0] / n, v[1] / n, z / n], self.det() / (n * n * n))
    }

    /// Unit local direction of the direction `w`, and the frame's density at `w`, sr⁻¹.
    ///
    /// The density is the one that a cosine lobe in the local hemisphere gets:
    /// z / (π·det A·m⁴) with m the length of A⁻¹-transformed `w`; it integrates to 1 over the hemisphere.
    pub fn to_local(&self, w: [f64; 3]) -> ([f64; 3], f64) {
        let z = w[2];
        let px = (w[0] - self.b[0] * z) / self.x;
        let py = (w[1] - self.b[1] * z) / self.y - self.shear * px;
        let m2 = px * px + py * py + z * z;
        let m = m2.sqrt();
        (
            [px / m, py / m, z / m],
            z.max(0.0) / (DISK_AREA * self.det() * m2 * m2),
        )
    }

    /// Direction at position `s` of the frame's square, with dω·cos θ / ds (that is π·det A/n⁴, finite
    /// everywhere) and cos θ = z of the direction. `complement` = 1 − `s`.
    pub fn square_to_direction(&self, s: [f64; 2], complement: [f64; 2]) -> ([f64; 3], f64) {
        let [x, y, z] = square_to_hemisphere(s, complement);
        let v = [
            self.x * x + self.b[0] * z,
            self.y * (self.shear * x + y) + self.b[1] * z,
            z,
        ];
        let n2 = v[0] * v[0] + v[1] * v[1] + z * z;
        let n = n2.sqrt();
        ([v[0] / n, v[1] / n, z / n], DISK_AREA * self.det() / (n2 * n2))
    }

    /// Position of direction `w` in the frame's square.
    pub fn direction_to_square(&self, w: [f64; 3]) -> [f64; 2] {
        let (local, _) = self.to_local(w);
        disk_to_square(local[0], local[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Rng;

    /// Round-off through a frame with |b| up to 10 loses two digits of f64.
    const ROUND_TRIP_TOL: f64 = 1e-10;
    /// Midpoint quadrature with 512² nodes of a density that is smooth in the frame's own square.
    const NORMALISATION_TOL: f64 = 1e-4;

    const START: Frame = Frame {
        x: 0.8,
        y: 0.5,
        shear: -0.7,
        b: [0.0; 2],
    };

    fn random_frame(rng: &mut Rng) -> Frame {
        let mut centred = || 2.0 * rng.uniform() - 1.0;
        Frame::from_outputs(
            [1.5 * centred(), 1.5 * centred(), centred(), centred(), centred()],
            &START,
        )
    }

    #[test]
    fn outputs_directions_and_square_round_trip() {
        let mut rng = Rng::new(&[11]);
        for _ in 0..2000 {
            let frame = random_frame(&mut rng);
            let again = Frame::from_outputs(frame.to_outputs(&START), &START);
            assert!(
                (again.b[1] - frame.b[1]).abs() < ROUND_TRIP_TOL
                    && (again.y - frame.y).abs() < ROUND_TRIP_TOL
            );
            let s = rng.pair();
            let (w, jacobian_cos) = frame.square_to_direction(s, [1.0 - s[0], 1.0 - s[1]]);
            let back = frame.direction_to_square(w);
            assert!((back[0] - s[0]).abs() < ROUND_TRIP_TOL && (back[1] - s[1]).abs() < ROUND_TRIP_TOL);
            let (local, density) = frame.to_local(w);
            let (forth, jacobian) = frame.to_direction(local);
            assert!((forth[0] - w[0]).abs() < ROUND_TRIP_TOL);
            // The square is uniform under the frame's own density: density · dω/ds = 1.
            assert!((density * jacobian_cos / w[2] - 1.0).abs() < ROUND_TRIP_TOL * 1e3);
            assert!(
                (density * jacobian * std::f64::consts::PI / local[2] - 1.0).abs() < ROUND_TRIP_TOL * 1e3
            );
        }
    }

    #[test]
    fn density_integrates_to_one() {
        let frame = Frame::from_outputs([-0.4, 0.3, 0.5, 0.2, -0.6], &START);
        let n = 512;
        let mut sum = 0.0;
        for i in 0..n * n {
            let s = [(i % n) as f64 + 0.5, (i / n) as f64 + 0.5].map(|v| v / n as f64);
            let (w, jacobian_cos) = Frame::IDENTITY.square_to_direction(s, [1.0 - s[0], 1.0 - s[1]]);
            sum += frame.to_local(w).1 * jacobian_cos / w[2];
        }
        assert!((sum / (n * n) as f64 - 1.0).abs() < NORMALISATION_TOL);
    }
}
