//! From a query to the features that enter a network, in f64: what training and the oracle share, and what the fast
//! paths are held against.

use crate::anchor::{ANCHOR_SCALARS, anchor_scalars};
use crate::chart::Chart;
use crate::encoding::{Quantity, SCALARS_MAX};
use crate::spec::{CHARTS_MAX, ChartsSpec, Input};

/// Everything that inputs are made of.
#[derive(Clone, Copy, Debug)]
pub struct Point<'a> {
    /// Values of the free parameters.
    pub params: &'a [f64],
    /// Camera direction, folded.
    pub wo: [f64; 3],
    /// Scalars of the analytic mirror chart; zeros without charts.
    pub anchor: [f64; ANCHOR_SCALARS],
    /// Uniform numbers of the drawn chart.
    pub u: [f64; 2],
    /// The drawn chart.
    pub chart: usize,
    /// Light direction, folded.
    pub wi: [f64; 3],
    /// The same in the frame of every chart.
    pub local: [[f64; 3]; CHARTS_MAX],
}

impl<'a> Point<'a> {
    /// The point at `params` and the folded `wo`; what depends on `u` or `wi` is zero.
    pub fn new(params: &'a [f64], wo: [f64; 3], charts: Option<&ChartsSpec>) -> Point<'a> {
        Point {
            params,
            wo,
            anchor: charts.map_or([0.0; ANCHOR_SCALARS], |c| anchor_scalars(&c.mirror(params, wo))),
            u: [0.0; 2],
            chart: 0,
            wi: [0.0, 0.0, 1.0],
            local: [[0.0, 0.0, 1.0]; CHARTS_MAX],
        }
    }

    /// Appends the features of `inputs` to `out`.
    pub fn append(&self, inputs: &[Input], out: &mut Vec<f64>) {
        for input in inputs {
            let (scalars, count) = self.scalars(input.quantity);
            let scaled = scalars.map(|x| input.scale.apply(x));
            input.encoding.append(&scaled[..count], out);
        }
    }

    /// The derivatives of the features of `inputs` by u₀ and by u₁.
    pub fn slopes(&self, inputs: &[Input]) -> [Vec<f64>; 2] {
        let mut slopes = [Vec::new(), Vec::new()];
        for input in inputs {
            let [along_x, along_y] = &mut slopes;
            let start = along_x.len();
            along_x.resize(start + input.features(), 0.0);
            along_y.resize(start + input.features(), 0.0);
            if input.quantity == Quantity::U {
                let mut own = Vec::new();
                input.encoding.append_slopes(&self.u, &mut own);
                let half = own.len() / 2;
                along_x[start..start + half].copy_from_slice(&own[..half]);
                along_y[start + half..].copy_from_slice(&own[half..]);
            }
        }
        slopes
    }

    fn scalars(&self, quantity: Quantity) -> ([f64; SCALARS_MAX], usize) {
        let mut scalars = [0.0; SCALARS_MAX];
        let values: &[f64] = match quantity {
            Quantity::U => &self.u,
            Quantity::Wo => &self.wo,
            Quantity::WoDisk => &self.wo[..2],
            Quantity::WiDisk => &self.wi[..2],
            Quantity::Local(chart) => &self.local[chart],
            Quantity::Anchor => &self.anchor,
            Quantity::Parameter(parameter) => &self.params[parameter..=parameter],
            Quantity::Chart => &[1.0 - 2.0 * self.chart as f64],
        };
        scalars[..values.len()].copy_from_slice(values);
        (scalars, values.len())
    }
}

impl ChartsSpec {
    /// Roughness along x and y where the free parameters are `params`.
    pub fn alpha_at(&self, params: &[f64]) -> [f64; 2] {
        self.alpha.map(|a| a.at(params))
    }

    /// The analytic mirror chart at `params` and the folded `wo`.
    pub fn mirror(&self, params: &[f64], wo: [f64; 3]) -> Chart {
        crate::anchor::mirror_chart(wo, self.alpha_at(params))
    }
}
