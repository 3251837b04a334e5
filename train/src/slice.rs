//! Slice tables: a lobe's density on the square of its chart.

use crate::error::{Error, Result};
use crate::lobes::{ALBEDO_MIN, LUMINANCE, Lobe, LobeSlice, direction_at};
use crate::spline::{edge_cell_centre, edge_cell_weight};
use bake_runtime::chart::Chart;
use glam::DVec3;

/// A density below this share of the slice's mean counts as this share: logarithms stay finite.
const DENSITY_FLOOR: f64 = 1e-7;

/// Logarithms of f_cos·dω/ds on the square of a frame, RGB, at the centres of crowded cells.
#[derive(Clone, Debug, PartialEq)]
pub struct SliceTable {
    /// Cells per side.
    pub cells: usize,
    /// ln of the density per unit square at [`edge_cell_centre`], one plane per channel; its mean over the square
    /// is the albedo.
    pub log_density: [Vec<f32>; 3],
}

impl SliceTable {
    /// Tabulates a lobe of `slice` on `cells`² cells of `chart`'s square.
    ///
    /// # Errors
    /// [`Error::Slice`] when the lobe has no energy or is not finite.
    pub fn tabulate(slice: &LobeSlice, lobe: Lobe, chart: &Chart, cells: usize) -> Result<SliceTable> {
        let density: Vec<DVec3> = (0..cells * cells)
            .map(|k| {
                let (wi, area) = direction_at(chart, edge_cell_centre(k, cells));
                slice.f_cos(lobe, wi) * area
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
                theta_deg: slice.wo.z.clamp(-1.0, 1.0).acos().to_degrees(),
                phi_deg: slice.wo.y.atan2(slice.wo.x).to_degrees(),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lobes::WALKS;
    use bake_runtime::Bsdf;
    use bake_runtime::conductor::Conductor;
    use bake_runtime::frame::Frame;
    use bake_runtime::layered::Layered;
    use bake_runtime::{Estimate, Rng};

    /// Evaluations behind one value of the oracle.
    const SAMPLES: u64 = 40_000;
    /// Standard errors allowed: 162 comparisons exceed 4.5 by chance once in 900 runs.
    const SIGMAS: f64 = 4.5;
    /// Error of the table itself: about one in ten of its walks scatters twice, and where that light dominates, next
    /// to the horizon, their common noise is a few percent.
    const TABLE_TOL: f64 = 0.05;
    /// Key of the oracle's numbers.
    const ORACLE_KEY: u64 = 0x51_1cf;

    /// The oracle: the reference's stochastic evaluation, averaged, with its standard error.
    fn oracle_f_cos(bsdf: &dyn Bsdf, wo: DVec3, wi: DVec3, key: u64) -> Estimate {
        let mut moments = bake_runtime::moments::Moments::default();
        for i in 0..SAMPLES {
            moments.add(bsdf.eval(wo, wi, &mut Rng::new(&[ORACLE_KEY, key, i])));
        }
        moments.estimate()
    }

    fn agrees_with_the_reference(bsdf: &dyn Bsdf, chart: &Chart) {
        let wo = DVec3::new(0.5, 0.4, 0.77).normalize();
        let cells = 9;
        let slice = LobeSlice::new(bsdf, wo, WALKS, 0).expect("a bright slice");
        let table = SliceTable::tabulate(&slice, Lobe::Whole, chart, cells).expect("a bright slice");
        for k in (0..cells * cells).step_by(3) {
            let (wi, area) = direction_at(chart, edge_cell_centre(k, cells));
            let truth = oracle_f_cos(bsdf, wo, wi, k as u64);
            for c in 0..3 {
                let found = f64::from(table.log_density[c][k]).exp();
                let expected = truth.mean[c] * area;
                let allowed = SIGMAS * truth.se[c] * area + TABLE_TOL * expected;
                assert!((found - expected).abs() < allowed, "cell {k}: {found} {expected}");
            }
        }
    }

    #[test]
    fn tables_agree_with_the_reference() {
        let conductor = Conductor::new([0.3, 0.1], [1.0, 0.782, 0.344]).expect("valid parameters");
        agrees_with_the_reference(
            &conductor,
            &Chart::of_frame(Frame {
                x: 0.55,
                y: 0.2,
                shear: 0.3,
                b: [-0.5, -0.4],
            }),
        );
        let layered =
            Layered::new(0.2, 1.5, 1.0, [0.9, 0.8, 0.7], [0.6, 0.5, 0.4], 0.0).expect("valid parameters");
        agrees_with_the_reference(&layered, &Chart::IDENTITY);
    }
}
