//! Analytic densities that the solvers are tested on, from even to very narrow.

use super::raster::Raster;
use crate::spline::cell_centre;

/// The raster of `value` at pixel centres on [−1, 1]².
pub fn raster(side: usize, value: impl Fn(f64, f64) -> f64) -> Raster {
    let values: Vec<f64> = (0..side * side)
        .map(|k| {
            let [u, v] = cell_centre(k, side);
            value(2.0 * u - 1.0, 2.0 * v - 1.0)
        })
        .collect();
    Raster::new(side, &values).expect("the density is positive somewhere")
}

/// Even on the unit disk.
pub fn disk(side: usize) -> Raster {
    raster(side, |x, y| f64::from(u8::from(x * x + y * y < 1.0)))
}

/// A lobe with the heavy tails of GGX around `centre`, `width` wide along x and y, cut off by the rim of the disk.
pub fn lobe(side: usize, centre: [f64; 2], width: [f64; 2]) -> Raster {
    raster(side, |x, y| {
        let (a, b) = ((x - centre[0]) / width[0], (y - centre[1]) / width[1]);
        let inside = f64::from(u8::from(x * x + y * y < 1.0));
        inside / (1.0 + a * a + b * b).powi(2)
    })
}

/// A stand-in for a picture: blobs of several sizes, an edge and a dark ground over the whole square.
pub fn blobs(side: usize) -> Raster {
    const BLOBS: [[f64; 4]; 5] = [
        [-0.5, -0.4, 0.25, 1.0],
        [0.45, 0.5, 0.12, 2.0],
        [0.6, -0.55, 0.3, 0.6],
        [-0.3, 0.6, 0.05, 3.0],
        [0.0, 0.05, 0.5, 0.3],
    ];
    raster(side, |x, y| {
        let edge = if x + 0.3 * y > 0.2 { 0.12 } else { 0.02 };
        BLOBS.iter().fold(edge, |sum, [a, b, width, height]| {
            let r2 = ((x - a).powi(2) + (y - b).powi(2)) / (width * width);
            sum + height * (-0.5 * r2).exp()
        })
    })
}
