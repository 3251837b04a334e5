//! The training set in memory: splines of every lobe's densities, its map, and how batches are drawn.

use crate::charts::ChartsNetwork;
use crate::lobes::LUMINANCE;
use crate::maps::MappedSlice;
use crate::spline::EdgeSpline;
use bake_runtime::chart::Chart;
use bake_runtime::encoding::Quantity;
use bake_runtime::features::Point;
use bake_runtime::oracle::Charts;
use bake_runtime::{NetworkSpec, Rng};
use glam::DVec3;
use rayon::prelude::*;

/// Exponent that favours grazing slices in batches: rank 1 − ξ^p among lobes sorted by θ_o.
const GRAZING_EXPONENT: f64 = 1.3;

/// Smallest coordinate of a position: its logit must be finite.
const POSITION_MIN: f32 = 1.0 / (1u32 << 25) as f32;

/// One lobe of one slice.
pub struct Entry {
    /// Values of the free parameters.
    pub params: Vec<f64>,
    /// Camera direction, folded.
    pub wo: [f64; 3],
    /// Number of its chart.
    pub chart: usize,
    /// Charts of the slice as the networks predict them, with their shares.
    pub charts: Charts,
    /// ln of the luminance density in the chart's square, mean 1; and ln of f_cos·dω/ds, RGB.
    pub log_density: EdgeSpline<4>,
    /// Cells per side of all of these.
    pub cells: usize,
    /// Albedo of the whole slice, RGB.
    pub albedo: DVec3,
    /// The entry of the slice's other lobe.
    pub other: Option<usize>,
    map: Vec<[f32; 2]>,
}

/// What the training of a material draws from: lobes sorted by θ_o. Black ones are left out.
pub struct TrainingSet {
    /// All lobes.
    pub entries: Vec<Entry>,
}

/// One sample: a lobe, and a position in the unit square, in `[POSITION_MIN, 1 − 2⁻²⁴]`².
#[derive(Clone, Copy, Debug)]
pub struct Pick {
    /// Number of the entry.
    pub entry: usize,
    /// Position.
    pub at: [f32; 2],
}

impl Entry {
    /// The chart of its lobe, and the share of the samples that it gets.
    pub fn own_chart(&self) -> (f64, &Chart) {
        let (share, chart) = &self.charts[self.chart];
        (*share, chart)
    }

    /// The importance map at `u`: bilinear between cell centres, with every edge of the square carried onto itself.
    pub fn map_at(&self, u: [f32; 2]) -> [f32; 2] {
        let n = self.cells;
        // Nodes: the edge 0, the n cell centres, the edge 1.
        let locate = |v: f32| {
            let x = v * n as f32 + 0.5;
            let i = (x.floor() as usize).min(n);
            let node = |i: usize| match i {
                0 => 0.0,
                i if i == n + 1 => 1.0,
                i => (i as f32 - 0.5) / n as f32,
            };
            (i, ((v - node(i)) / (node(i + 1) - node(i))).clamp(0.0, 1.0))
        };
        let ((i, s), (j, t)) = (locate(u[0]), locate(u[1]));
        let node = |i: usize, j: usize| {
            let inside = |k: usize| k.clamp(1, n) - 1;
            let p = self.map[inside(j) * n + inside(i)];
            let pin = |v: f32, k: usize| match k {
                0 => 0.0,
                k if k == n + 1 => 1.0,
                _ => v,
            };
            [pin(p[0], i), pin(p[1], j)]
        };
        let (a, b, c, d) = (node(i, j), node(i + 1, j), node(i, j + 1), node(i + 1, j + 1));
        std::array::from_fn(|k| (1.0 - t) * ((1.0 - s) * a[k] + s * b[k]) + t * ((1.0 - s) * c[k] + s * d[k]))
    }
}

impl TrainingSet {
    /// Prepares `slices`, whose charts are those that `network` predicts.
    pub fn new(slices: Vec<MappedSlice>, network: &ChartsNetwork) -> TrainingSet {
        let entries: Vec<Vec<Entry>> = slices
            .into_par_iter()
            .map(|slice| {
                let charts = network.predict(&slice.parameters, slice.wo);
                let albedo: DVec3 = slice.charts.iter().map(|c| c.table.albedo()).sum();
                let lobes = slice
                    .charts
                    .into_iter()
                    .enumerate()
                    .filter(|(_, c)| c.share > 0.0);
                lobes
                    .map(|(chart, map)| {
                        let cells = map.table.cells;
                        let plane =
                            |c: usize| map.table.log_density[c].iter().map(|&v| f64::from(v)).collect();
                        let luminance = map.table.luminance().iter().map(|q| q.ln()).collect();
                        let planes: [Vec<f64>; 4] = [luminance, plane(0), plane(1), plane(2)];
                        Entry {
                            params: slice.parameters.clone(),
                            wo: slice.wo,
                            chart,
                            charts: charts.clone(),
                            log_density: EdgeSpline::new(planes.each_ref().map(|p| &p[..]), cells),
                            cells,
                            albedo,
                            other: None,
                            map: map.map,
                        }
                    })
                    .collect()
            })
            .collect();
        TrainingSet::sorted(entries)
    }

    /// Sorts the lobes of all slices by θ_o and tells those of one slice of each other.
    fn sorted(slices: Vec<Vec<Entry>>) -> TrainingSet {
        let mut entries: Vec<(usize, Entry)> = slices
            .into_iter()
            .enumerate()
            .flat_map(|(slice, lobes)| lobes.into_iter().map(move |lobe| (slice, lobe)))
            .collect();
        entries.sort_by(|(a, x), (b, y)| y.wo[2].total_cmp(&x.wo[2]).then(a.cmp(b)));
        let slices: Vec<usize> = entries.iter().map(|(slice, _)| *slice).collect();
        let mut entries: Vec<Entry> = entries.into_iter().map(|(_, entry)| entry).collect();
        for i in 1..entries.len() {
            if slices[i] == slices[i - 1] {
                entries[i].other = Some(i - 1);
                entries[i - 1].other = Some(i);
            }
        }
        TrainingSet { entries }
    }

    /// Draws `size` samples: lobes with a preference for grazing ones, positions uniform.
    pub fn draw(&self, size: usize, rng: &mut Rng) -> Vec<Pick> {
        let count = self.entries.len();
        (0..size)
            .map(|_| {
                let rank = 1.0 - rng.uniform().powf(GRAZING_EXPONENT);
                let bound = |v: f64| (v as f32).clamp(POSITION_MIN, 1.0 - f32::EPSILON / 2.0);
                Pick {
                    entry: ((rank * count as f64) as usize).min(count - 1),
                    at: rng.pair().map(bound),
                }
            })
            .collect()
    }

    /// Per entry, the features of those inputs of `spec` that depend on neither u nor wi, in their order.
    pub fn place_features(&self, spec: &NetworkSpec) -> Vec<Vec<f32>> {
        let constant = |quantity: Quantity| match quantity {
            Quantity::U | Quantity::Local(_) | Quantity::WiDisk => false,
            Quantity::Wo | Quantity::WoDisk | Quantity::Anchor | Quantity::Parameter(_) | Quantity::Chart => {
                true
            }
        };
        let inputs: Vec<_> = spec
            .inputs
            .iter()
            .copied()
            .filter(|i| constant(i.quantity))
            .collect();
        let of = |entry: &Entry| {
            let mut point = Point::new(&entry.params, entry.wo, spec.charts());
            point.chart = entry.chart;
            let mut out = Vec::new();
            point.append(&inputs, &mut out);
            out.into_iter().map(|v| v as f32).collect()
        };
        self.entries.par_iter().map(of).collect()
    }
}

/// Luminance of `rgb`.
pub fn luminance(rgb: DVec3) -> f64 {
    rgb.dot(LUMINANCE)
}
