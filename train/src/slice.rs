//! Slices: the reference BSDF over all `wi` for one `wo`, as densities on the square of a lobe frame.
//!
//! The analytic single scattering is evaluated where it is asked for. Multiple scattering is stochastic; its
//! noise is removed without a filter on the image, by walks that all directions share
//! ([`bake_runtime::conductor::ConductorSlice`]). The only smoothing is the interpolation of its logarithm on
//! [`SCATTER_CELLS`]² cells.

use crate::error::{Error, Result};
use crate::spline::{EdgeSpline, edge_cell_centre, edge_cell_weight};
use bake_runtime::conductor::{Conductor, ConductorSlice};
use bake_runtime::frame::Frame;
use glam::DVec3;

/// Luminance of linear Rec. 709 RGB: what the maps are made for.
pub const LUMINANCE: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

/// Cells per side of the grid that multiple scattering is tabulated on.
pub const SCATTER_CELLS: usize = 24;

/// Walks per slice: at alpha 0.3 × 0.1 its noise is then about a quarter of a percent of its light.
pub const WALKS: usize = 1 << 12;

/// A density below this share of the slice's mean counts as this share: logarithms stay finite.
const DENSITY_FLOOR: f64 = 1e-7;

/// A slice whose luminance albedo is below this is black.
const ALBEDO_MIN: f64 = 1e-12;

/// Seed of the walks: every slice uses the same numbers, so that their noise varies smoothly with `wo`.
const WALK_SEED: u64 = 0;

/// Logarithms of f_cos·dω/ds on the square of `frame`, RGB, at the centres of crowded cells.
#[derive(Clone, Debug)]
pub struct SliceTable {
    /// Cells per side.
    pub cells: usize,
    /// ln of the density per unit square at [`edge_cell_centre`], one plane per channel; its mean over the square
    /// is the albedo.
    pub log_density: [Vec<f32>; 3],
}

/// `wi` and f_cos ↦ density factor at position `s` of the frame's square.
fn direction_at(frame: &Frame, s: [f64; 2]) -> (DVec3, f64) {
    let (w, jacobian_cos) = frame.square_to_direction(s, [1.0 - s[0], 1.0 - s[1]]);
    (DVec3::from_array(w), jacobian_cos / w[2])
}

impl SliceTable {
    /// Tabulates the slice of `bsdf` at `wo` on `cells`² cells of `frame`'s square.
    ///
    /// # Errors
    /// [`Error::Slice`] when the slice has no energy or is not finite.
    pub fn tabulate(bsdf: &Conductor, wo: DVec3, frame: &Frame, cells: usize) -> Result<SliceTable> {
        let slice = ConductorSlice::new(bsdf, wo, WALKS, WALK_SEED);
        let coarse: Vec<DVec3> = (0..SCATTER_CELLS * SCATTER_CELLS)
            .map(|k| {
                let (wi, area) = direction_at(frame, edge_cell_centre(k, SCATTER_CELLS));
                slice.multiple(wi) * area
            })
            .collect();
        let floor = DVec3::splat(f64::MIN_POSITIVE.sqrt());
        let logs = |c: usize| coarse.iter().map(|v| v.max(floor)[c].ln()).collect::<Vec<_>>();
        let splines = [0, 1, 2].map(|c| EdgeSpline::new(&logs(c), SCATTER_CELLS));
        let density: Vec<DVec3> = (0..cells * cells)
            .map(|k| {
                let s = edge_cell_centre(k, cells);
                let (wi, area) = direction_at(frame, s);
                bsdf.single(wo, wi) * area
                    + DVec3::from_array([0, 1, 2].map(|c: usize| splines[c].at(s).0.exp()))
            })
            .collect();
        let weights = (0..cells * cells).map(|k| edge_cell_weight(k, cells));
        let mean = density.iter().zip(weights).map(|(v, w)| *v * w).sum::<DVec3>() / density.len() as f64;
        if !(mean.is_finite() && mean.dot(LUMINANCE) > ALBEDO_MIN) {
            let reason = if mean.is_finite() {
                "it reflects nothing, so there is nothing to sample"
            } else {
                "it is not finite"
            };
            return Err(Error::Slice {
                theta_deg: wo.z.clamp(-1.0, 1.0).acos().to_degrees(),
                phi_deg: wo.y.atan2(wo.x).to_degrees(),
                reason: reason.into(),
            });
        }
        let floor = DENSITY_FLOOR * mean.dot(LUMINANCE);
        let log_density = [0, 1, 2].map(|c| density.iter().map(|v| v[c].max(floor).ln() as f32).collect());
        Ok(SliceTable { cells, log_density })
    }

    /// The table's albedo, RGB.
    pub fn albedo(&self) -> DVec3 {
        let weighted = |(k, v): (usize, &f32)| f64::from(*v).exp() * edge_cell_weight(k, self.cells);
        let mean = |plane: &[f32]| plane.iter().enumerate().map(weighted).sum::<f64>() / plane.len() as f64;
        DVec3::new(
            mean(&self.log_density[0]),
            mean(&self.log_density[1]),
            mean(&self.log_density[2]),
        )
    }

    /// Luminance density at every cell, mean 1.
    pub fn luminance(&self) -> Vec<f64> {
        let mean = self.albedo().dot(LUMINANCE);
        (0..self.cells * self.cells)
            .map(|k| {
                (0..3)
                    .map(|c| LUMINANCE[c] * f64::from(self.log_density[c][k]).exp())
                    .sum::<f64>()
                    / mean
            })
            .collect()
    }
}

/// Luminance of the analytic single scattering: what frames are fitted to.
pub fn single_luminance(bsdf: &Conductor, wo: DVec3, wi: [f64; 3]) -> f64 {
    bsdf.single(wo, DVec3::from_array(wi)).dot(LUMINANCE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::{Bsdf, Rng};

    /// Evaluations behind one value of the oracle.
    const SAMPLES: u64 = 40_000;
    /// Standard errors allowed: 81 comparisons exceed 4.5 by chance once in 1800 runs.
    const SIGMAS: f64 = 4.5;
    /// Error of the table itself: about one in ten of its walks scatters twice, and where that light dominates, next
    /// to the horizon, their common noise is a few percent.
    const TABLE_TOL: f64 = 0.05;
    /// Key of the oracle's numbers.
    const ORACLE_KEY: u64 = 0x51_1cf;

    /// The oracle: the reference's stochastic evaluation, averaged, with its standard error.
    fn oracle_f_cos(bsdf: &Conductor, wo: DVec3, wi: DVec3, key: u64) -> (DVec3, DVec3) {
        let (mut sum, mut square) = (DVec3::ZERO, DVec3::ZERO);
        for i in 0..SAMPLES {
            let value = bsdf.eval(wo, wi, &mut Rng::new(&[ORACLE_KEY, key, i]));
            sum += value;
            square += value * value;
        }
        let n = SAMPLES as f64;
        let mean = sum / n;
        let variance = (square / n - mean * mean).max(DVec3::ZERO) / n;
        (mean, DVec3::from_array(variance.to_array().map(f64::sqrt)))
    }

    #[test]
    fn table_agrees_with_the_reference() {
        let bsdf = Conductor::new([0.3, 0.1], [1.0, 0.782, 0.344]).expect("valid parameters");
        let wo = DVec3::new(0.5, 0.4, 0.77).normalize();
        let frame = Frame::from_outputs([-0.6, -1.6, 0.3, 0.0, 0.0], [-0.5, -0.4]);
        let cells = 9;
        let table = SliceTable::tabulate(&bsdf, wo, &frame, cells).expect("a bright slice");
        for k in (0..cells * cells).step_by(3) {
            let (wi, area) = direction_at(&frame, edge_cell_centre(k, cells));
            let (mean, se) = oracle_f_cos(&bsdf, wo, wi, k as u64);
            for c in 0..3 {
                let found = f64::from(table.log_density[c][k]).exp();
                let allowed = SIGMAS * se[c] * area + TABLE_TOL * mean[c] * area;
                assert!(
                    (found - mean[c] * area).abs() < allowed,
                    "cell {k}: {found} {}",
                    mean[c] * area
                );
            }
        }
    }

    #[test]
    fn a_slice_without_light_is_refused() {
        let bsdf = Conductor::new([0.3, 0.1], [1.0; 3]).expect("valid parameters");
        assert!(SliceTable::tabulate(&bsdf, -DVec3::Z, &Frame::IDENTITY, 4).is_err());
    }
}
