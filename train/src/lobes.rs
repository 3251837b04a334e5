//! Lobes: the reference BSDF over all `wi` for one `wo`, as a sharp and a smooth lobe with the charts that suit them.
//!
//! The sharp lobe is evaluated where it is asked for. The smooth one may be stochastic; its noise is removed without a
//! filter on the image, by walks that all directions share ([`bake_runtime::Bsdf::slice`]). The only smoothing is the
//! interpolation of its logarithm on [`SMOOTH_CELLS`]² cells, whose error [`LobeSlice::smoothing_error`] measures.

use crate::error::{Error, Result};
use crate::spline::{EdgeSpline, edge_cell_centre, edge_cell_weight};
use crate::transport::frame_fit;
use bake_runtime::Bsdf;
use bake_runtime::anchor::mirror_chart;
use bake_runtime::bsdf::{Rest, Slice, shifted_r2};
use bake_runtime::chart::Chart;
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

/// A lobe whose luminance albedo is below this is black.
pub const ALBEDO_MIN: f64 = 1e-12;

/// A smooth lobe's density below this share of its largest counts as this share.
const SMOOTH_FLOOR: f64 = 1e-6;

/// Cells per side of the look that tells whether a lobe is black: of one that costs microseconds a direction and spreads
/// over the hemisphere, and of one that may be a single pixel of a table.
const LOOK_CELLS: [usize; 2] = [12, 96];

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
    Table(Chart, EdgeSpline<3>),
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
fn look(chart: &Chart, cells: usize, f_cos: impl Fn(DVec3) -> DVec3) -> f64 {
    let n = cells * cells;
    let sum: f64 = (0..n)
        .map(|k| {
            let (wi, area) = direction_at(chart, edge_cell_centre(k, cells));
            f_cos(wi).dot(LUMINANCE) * area * edge_cell_weight(k, cells)
        })
        .sum();
    sum / n as f64
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
        let start = mirror_chart(wo.to_array(), alpha);
        let sharp = look(&start, LOOK_CELLS[1], |wi| slice.sharp(wi));
        if !sharp.is_finite() {
            return refuse("it is not finite");
        }
        let sharp_chart = (sharp > ALBEDO_MIN).then(|| fit(&start, |wi| slice.sharp(wi)));
        let home = match (slice.rest(), sharp_chart) {
            (Rest::Alike, Some(chart)) => chart,
            _ => Chart::IDENTITY,
        };
        let rest = look(&home, LOOK_CELLS[0], |wi| slice.smooth(wi));
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
            // Few walks may leave a direction dark: a logarithm far below its neighbours' would make the spline overshoot.
            let brightest = values
                .iter()
                .copied()
                .fold(DVec3::splat(f64::MIN_POSITIVE.sqrt()), DVec3::max);
            let floor = brightest * SMOOTH_FLOOR;
            let logs = [0, 1, 2].map(|c| values.iter().map(|v| v.max(floor)[c].ln()).collect::<Vec<_>>());
            let logs = logs.each_ref().map(|l| &l[..]);
            Smooth::Table(home, EdgeSpline::new(logs, SMOOTH_CELLS))
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
            Smooth::Table(chart, spline) => {
                let s = chart.direction_to_square(wi.to_array());
                let values = DVec3::from_array(spline.values_at(s).map(f64::exp));
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

    /// The lobes that get charts, with the charts fitted to them.
    pub fn fitted(&self) -> Vec<(Lobe, Chart)> {
        let lobes = self.charts().into_iter();
        lobes.map(|lobe| (lobe, self.chart(lobe))).collect()
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

    /// The chart fitted to a lobe from `start`, whose boost it keeps.
    pub fn fitted_from(&self, lobe: Lobe, start: &Chart) -> Chart {
        match (lobe, self.slice.rest()) {
            // Higher orders lie where single scattering does.
            (Lobe::Sharp, _) | (Lobe::Whole, Rest::Alike) if self.sharp_chart.is_some() => {
                fit(start, |wi| self.slice.sharp(wi))
            }
            _ => fit(start, |wi| self.f_cos(lobe, wi)),
        }
    }

    /// The chart of the sharp lobe; `None` where that is black.
    pub fn sharp_chart(&self) -> Option<Chart> {
        self.sharp_chart
    }

    /// Luminance albedo of a lobe, coarsely: a percent or so.
    pub fn energy(&self, lobe: Lobe) -> f64 {
        let cells = match (lobe, &self.smooth) {
            (Lobe::Smooth, Smooth::Black) => return 0.0,
            (Lobe::Smooth, Smooth::Table(..)) => SMOOTH_CELLS,
            _ => LOOK_CELLS[1],
        };
        look(&self.chart(lobe), cells, |wi| self.f_cos(lobe, wi))
    }

    /// Energy-weighted mean error of the smooth lobe's interpolation, over the albedo of the slice: the bias that removing
    /// its noise costs the transport. Weights of samples do not see it; they come from the model.
    pub fn smoothing_error(&self, albedo: DVec3) -> f64 {
        let Smooth::Table(chart, spline) = &self.smooth else {
            return 0.0;
        };
        let sum: f64 = (0..CHECKS)
            .map(|k| {
                let s = shifted_r2(k, [0.0; 2]);
                let (wi, area) = direction_at(chart, s);
                let table = DVec3::from_array(spline.values_at(s).map(f64::exp));
                (self.slice.smooth(wi) * area - table).dot(LUMINANCE).abs()
            })
            .sum();
        sum / CHECKS as f64 / albedo.dot(LUMINANCE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::conductor::Conductor;
    use bake_runtime::layered::Layered;

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
