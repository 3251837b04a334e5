//! A chart: the unit square laid over the hemisphere so that a lobe is about evenly bright in it.
//!
//! Square → disk (concentric) → linearly transformed cosine ([`Frame`]) → boost to where the lobe lies ([`Boost`]).

use crate::boost::Boost;
use crate::frame::Frame;

/// A frame for the shape of a lobe, and the boost that takes it from the normal to its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chart {
    /// Shape, and what the boost leaves of the shift.
    pub frame: Frame,
    /// Applied after the frame.
    pub boost: Boost,
}

impl Chart {
    /// The square laid evenly over the disk of directions.
    pub const IDENTITY: Chart = Chart {
        frame: Frame::IDENTITY,
        boost: Boost::NONE,
    };

    /// The chart of a frame alone.
    pub fn of_frame(frame: Frame) -> Chart {
        Chart {
            frame,
            boost: Boost::NONE,
        }
    }

    /// Unit direction at `s` in the unit square, and dω/ds there (sr).
    pub fn square_to_direction(&self, s: [f64; 2]) -> ([f64; 3], f64) {
        let (v, jacobian_cos) = self.frame.square_to_direction(s, [1.0 - s[0], 1.0 - s[1]]);
        let (w, scale) = self.boost.apply(v);
        (w, scale * jacobian_cos / v[2])
    }

    /// Position of direction `w` in the square.
    pub fn direction_to_square(&self, w: [f64; 3]) -> [f64; 2] {
        self.frame.direction_to_square(self.boost.inverse().apply(w).0)
    }

    /// Unit local direction of `w`, the one around which the lobe is a cosine lobe, and [`Chart::density`] at `w`.
    pub fn to_local(&self, w: [f64; 3]) -> ([f64; 3], f64) {
        let (v, scale) = self.boost.inverse().apply(w);
        let (local, density) = self.frame.to_local(v);
        (local, density * scale)
    }

    /// Density at `w` of a direction drawn evenly over the square, sr⁻¹.
    pub fn density(&self, w: [f64; 3]) -> f64 {
        self.to_local(w).1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Rng;

    /// Round-off through a frame and a boost.
    const ROUND_TRIP_TOL: f64 = 1e-9;

    #[test]
    fn round_trip_and_density() {
        let mut rng = Rng::new(&[0xc4a]);
        let chart = Chart {
            frame: Frame::from_outputs([-0.5, -1.5, 0.4, 0.2, -0.1], &Frame::IDENTITY),
            boost: Boost::to_slope([-3.0, 1.0]),
        };
        for _ in 0..1000 {
            let s = rng.pair().map(|v| 0.01 + 0.98 * v);
            let (w, area) = chart.square_to_direction(s);
            let back = chart.direction_to_square(w);
            assert!((back[0] - s[0]).abs() < ROUND_TRIP_TOL && (back[1] - s[1]).abs() < ROUND_TRIP_TOL);
            assert!((chart.density(w) * area - 1.0).abs() < ROUND_TRIP_TOL);
        }
    }
}
