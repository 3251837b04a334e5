//! Slices: the reference BSDF over all `wi` for one `wo`, as densities on the squares of lobe frames.
//!
//! The sharp lobe is evaluated where it is asked for. The smooth one may be stochastic; its noise is removed without a
//! filter on the image, by walks that all directions share ([`bake_runtime::Bsdf::slice`]). The only smoothing is the
//! interpolation of its logarithm on [`SMOOTH_CELLS`]² cells, whose error [`LobeSlice::smoothing_error`] measures.

use crate::error::{Error, Result};
use crate::spline::{EdgeSpline, edge_cell_centre, edge_cell_weight};
use crate::transport::frame_fit;
use bake_runtime::bsdf::{Rest, Slice, shifted_r2};
use bake_runtime::boost::Boost;
use bake_runtime::chart::Chart;
use bake_runtime::frame::{Frame, mirror_anchor};
use bake_runtime::Bsdf;
use glam::DVec3;

/// Luminance of linear Rec. 709 RGB: what the maps are made for.
pub const LUMINANCE: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

/// Cells per side of the grid that a stochastic lobe is tabulated on.
pub const SMOOTH_CELLS: usize = 24;

/// Walks per slice: at alpha 0.3 × 0.1 its noise is then about a quarter of a percent of its light.
pub const WALKS: usize = 1 << 12;

/// A sharp lobe at least this rough along both axes shares one chart with the diffuse light below it: two lobes that
/// overlap that much gain nothing from charts of their own.
const BROAD: f64 = 0.25;

/// A density below this share of the slice's mean counts as this share: logarithms stay finite.
const DENSITY_FLOOR: f64 = 1e-7;

/// A lobe whose luminance albedo is below this is black.
const ALBEDO_MIN: f64 = 1e-12;

/// Cells per side of the coarse look that tells whether a lobe is black.
const LOOK_CELLS: usize = 12;

/// Directions at which the smoothing is checked.
const CHECKS: u64 = 64;

/// What a chart covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lobe {
    /// The whole slice.
    Whole,
    /// Its sharp lobe.
    Sharp,
    /// What its sharp lobe leaves.
    Smooth,
}

/// Where the smooth lobe comes from.
enum Smooth {
    /// There is none.
    Black,
    /// The model says it exactly.
    Exact,
    /// Splines of ln(f_cos·dω/ds) per channel on the crowded square of a frame.
    Table(Chart, [EdgeSpline; 3]),
}

/// A slice with the frames of its lobes.
pub struct LobeSlice<'a> {
    /// Camera direction.
    pub wo: DVec3,
    slice: Box<dyn Slice + 'a>,
    smooth: Smooth,
    /// Chart of the sharp lobe; `None` where that is black.
    sharp_chart: Option<Chart>,
}

/// `wi` and f_cos ↦ density factor dω/ds at position `s` of the chart's square.
pub fn direction_at(chart: &Chart, s: [f64; 2]) -> (DVec3, f64) {
    let (w, area) = chart.square_to_direction(s);
    (DVec3::from_array(w), area)
}

/// Mean luminance of f_cos·dω/ds over the crowded square of `chart`: the albedo, coarsely.
fn look(chart: &Chart, f_cos: impl Fn(DVec3) -> DVec3) -> f64 {
    let n = LOOK_CELLS * LOOK_CELLS;
    let sum: f64 = (0..n)
        .map(|k| {
            let (wi, area) = direction_at(chart, edge_cell_centre(k, LOOK_CELLS));
            f_cos(wi).dot(LUMINANCE) * area * edge_cell_weight(k, LOOK_CELLS)
        })
        .sum();
    sum / n as f64
}

/// Where the chart of a lobe mirrored at a surface of roughness `alpha` starts from: boosted to the mirror direction,
/// pulled back from the horizon by the roughness, with the shape that the slopes of the facets give it.
fn mirror_chart(wo: DVec3, alpha: [f64; 2]) -> Chart {
    let pull: f64 = std::env::var("PULL").map_or(1.0, |v| v.parse().unwrap());
    let least = alpha[0].min(alpha[1]);
    let slope = mirror_anchor(wo.to_array(), [pull * least; 2]);
    let boost = Boost::to_slope(slope);
    // Slopes p of half vectors in the boosted frame are facet slopes with the part along wo's azimuth over cos; those of
    // directions are 2p.
    let t = slope[0].hypot(slope[1]);
    let (cos, along) = match t > 0.0 {
        true => (1.0 / (1.0 + t * t).sqrt(), [slope[0] / t, slope[1] / t]),
        false => (1.0, [1.0, 0.0]),
    };
    let stretch = 1.0 / cos - 1.0;
    let p = [
        [1.0 + stretch * along[0] * along[0], stretch * along[0] * along[1]],
        [stretch * along[0] * along[1], 1.0 + stretch * along[1] * along[1]],
    ];
    let cov = |i: usize, j: usize| 4.0 * (0..2).map(|k| p[i][k] * alpha[k] * alpha[k] * p[k][j]).sum::<f64>();
    let (xx, xy, yy) = (cov(0, 0), cov(0, 1), cov(1, 1));
    // Eigenvalues capped at 1.
    let mean = 0.5 * (xx + yy);
    let half = (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
    let (l1, l2) = (mean + half, ((xx * yy - xy * xy) / (mean + half)).max(1e-12));
    let (c1, c2) = (l1.min(1.0), l2.min(1.0));
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    let (s, c) = angle.sin_cos();
    let (xx, xy, yy) = (c1 * c * c + c2 * s * s, (c1 - c2) * s * c, c1 * s * s + c2 * c * c);
    let x = xx.sqrt();
    let l21 = xy / x;
    let y = (yy - l21 * l21).max(1e-12).sqrt();
    Chart { frame: Frame { x, y, shear: l21 / y, b: [0.0; 2] }, boost }
}

/// Fits a chart to f_cos, starting from `start`, whose boost it keeps.
fn fit(start: &Chart, f_cos: impl Fn(DVec3) -> DVec3) -> Chart {
    let luminance = |v: [f64; 3]| {
        let (w, scale) = start.boost.apply(v);
        f_cos(DVec3::from_array(w)).dot(LUMINANCE) * scale
    };
    Chart {
        frame: frame_fit::fit(luminance, start.frame),
        boost: start.boost,
    }
}

impl<'a> LobeSlice<'a> {
    /// Walks and tabulates the slice of `bsdf` at `wo`, a unit vector above the horizon.
    ///
    /// # Errors
    /// [`Error::Slice`] when the slice reflects nothing or is not finite.
    pub fn new(bsdf: &'a dyn Bsdf, wo: DVec3, walks: usize, seed: u64) -> Result<LobeSlice<'a>> {
        let slice = bsdf.slice(wo, walks, seed);
        let refuse = |reason: &str| {
            Err(Error::Slice {
                theta_deg: wo.z.clamp(-1.0, 1.0).acos().to_degrees(),
                phi_deg: wo.y.atan2(wo.x).to_degrees(),
                reason: reason.into(),
            })
        };
        let alpha = slice.alpha();
        let start = mirror_chart(wo, alpha);
        let sharp = look(&start, |wi| slice.sharp(wi));
        if !sharp.is_finite() {
            return refuse("it is not finite");
        }
        let sharp_chart = (sharp > ALBEDO_MIN).then(|| fit(&start, |wi| slice.sharp(wi)));
        let home = match (slice.rest(), sharp_chart) {
            (Rest::Alike, Some(chart)) => chart,
            _ => Chart::IDENTITY,
        };
        let rest = look(&home, |wi| slice.smooth(wi));
        if !rest.is_finite() {
            return refuse("it is not finite");
        }
        let smooth = if rest <= ALBEDO_MIN {
            Smooth::Black
        } else if !bsdf.is_stochastic() {
            Smooth::Exact
        } else {
            let values: Vec<DVec3> = (0..SMOOTH_CELLS * SMOOTH_CELLS)
                .map(|k| {
                    let (wi, area) = direction_at(&home, edge_cell_centre(k, SMOOTH_CELLS));
                    slice.smooth(wi) * area
                })
                .collect();
            let floor = DVec3::splat(f64::MIN_POSITIVE.sqrt());
            let logs = |c: usize| values.iter().map(|v| v.max(floor)[c].ln()).collect::<Vec<_>>();
            Smooth::Table(home, [0, 1, 2].map(|c| EdgeSpline::new(&logs(c), SMOOTH_CELLS)))
        };
        if sharp_chart.is_none() && matches!(smooth, Smooth::Black) {
            return refuse("it reflects nothing, so there is nothing to sample");
        }
        Ok(LobeSlice {
            wo,
            slice,
            smooth,
            sharp_chart,
        })
    }

    /// f_cos of a lobe at `wi`, RGB, sr⁻¹, without noise.
    pub fn f_cos(&self, lobe: Lobe, wi: DVec3) -> DVec3 {
        let smooth = || match &self.smooth {
            Smooth::Black => DVec3::ZERO,
            Smooth::Exact => self.slice.smooth(wi),
            Smooth::Table(chart, splines) => {
                let s = chart.direction_to_square(wi.to_array());
                let values = DVec3::from_array([0, 1, 2].map(|c: usize| splines[c].at(s).0.exp()));
                values * chart.density(wi.to_array())
            }
        };
        match lobe {
            Lobe::Whole => self.slice.sharp(wi) + smooth(),
            Lobe::Sharp => self.slice.sharp(wi),
            Lobe::Smooth => smooth(),
        }
    }

    /// The lobes that get charts: two where a sharp lobe lies over diffuse light, else the whole slice.
    pub fn charts(&self) -> Vec<Lobe> {
        let apart = self.slice.rest() == Rest::Diffuse
            && self.slice.alpha().iter().any(|a| *a < BROAD)
            && self.sharp_chart.is_some()
            && !matches!(self.smooth, Smooth::Black);
        match apart {
            true => vec![Lobe::Sharp, Lobe::Smooth],
            false => vec![Lobe::Whole],
        }
    }

    /// The chart fitted to a lobe.
    pub fn chart(&self, lobe: Lobe) -> Chart {
        let alike = self.slice.rest() == Rest::Alike || matches!(self.smooth, Smooth::Black);
        match (lobe, self.sharp_chart) {
            (Lobe::Sharp, Some(chart)) => chart,
            // Higher orders lie where single scattering does.
            (Lobe::Whole, Some(chart)) if alike => chart,
            _ => fit(&Chart::IDENTITY, |wi| self.f_cos(lobe, wi)),
        }
    }

    /// The frame fitted to the sharp lobe without a boost, as the networks predict it.
    pub fn linear_frame(&self) -> Frame {
        let alpha = self.slice.alpha();
        let anchor = mirror_anchor(self.wo.to_array(), alpha);
        let start = Frame::from_outputs([alpha[0].ln(), alpha[1].ln(), 0.0, 0.0, 0.0], anchor);
        fit(&Chart::of_frame(start), |wi| self.slice.sharp(wi)).frame
    }

    /// Energy-weighted mean error of the smooth lobe's interpolation, over the albedo of the slice: the bias that removing
    /// its noise costs the transport. Weights of samples do not see it; they come from the model.
    pub fn smoothing_error(&self, albedo: DVec3) -> f64 {
        let Smooth::Table(chart, splines) = &self.smooth else {
            return 0.0;
        };
        let sum: f64 = (0..CHECKS)
            .map(|k| {
                let s = shifted_r2(k, [0.0; 2]);
                let (wi, area) = direction_at(chart, s);
                let table = DVec3::from_array([0, 1, 2].map(|c: usize| splines[c].at(s).0.exp()));
                (self.slice.smooth(wi) * area - table).dot(LUMINANCE).abs()
            })
            .sum();
        sum / CHECKS as f64 / albedo.dot(LUMINANCE)
    }
}

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
    use bake_runtime::conductor::Conductor;
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
            &Chart::of_frame(Frame::from_outputs([-0.6, -1.6, 0.3, 0.0, 0.0], [-0.5, -0.4])),
        );
        let layered = Layered::new(0.2, 1.5, 1.0, [0.9, 0.8, 0.7], [0.6, 0.5, 0.4], 0.0).expect("valid parameters");
        agrees_with_the_reference(&layered, &Chart::IDENTITY);
    }

    #[test]
    fn a_sharp_lobe_over_a_base_gets_a_chart_of_its_own() {
        let layered = |alpha: f64, base: f64| {
            Layered::new(alpha, 1.5, 0.0, [0.0; 3], [base; 3], 0.0).expect("valid parameters")
        };
        let wo = DVec3::new(0.6, 0.0, 0.8);
        let charts = |bsdf: &Layered| LobeSlice::new(bsdf, wo, 64, 0).expect("a bright slice").charts();
        assert_eq!(charts(&layered(0.05, 0.5)), [Lobe::Sharp, Lobe::Smooth]);
        assert_eq!(charts(&layered(0.5, 0.5)), [Lobe::Whole]);
        assert_eq!(charts(&layered(0.05, 0.0)), [Lobe::Whole]);
    }

    #[test]
    fn a_slice_without_light_is_refused() {
        let black = Conductor::new([0.3, 0.1], [1.0; 3]).expect("valid parameters");
        assert!(LobeSlice::new(&black, -DVec3::Z, WALKS, 0).is_err());
    }
}
