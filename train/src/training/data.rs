//! The training set in memory: splines of every slice's densities, its map, and how batches are drawn.

use crate::maps::{CELLS, MappedSlice};
use crate::spline::EdgeSpline;
use bake_runtime::Rng;
use bake_runtime::encoding::{GRAZING_FEATURES, grazing};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::Arc;

/// Exponent that favours grazing slices in batches: rank 1 − ξ^p among slices sorted by θ_o.
const GRAZING_EXPONENT: f64 = 1.3;

/// Smallest coordinate of a position: its logit must be finite.
const POSITION_MIN: f32 = 1.0 / (1u32 << 25) as f32;

/// What the training of a material draws from.
pub struct TrainingSet {
    /// ln of the luminance density, mean 1 over the square, per slice.
    pub log_luminance: Arc<Vec<EdgeSpline>>,
    /// ln of f_cos·dω/ds per channel, per slice.
    pub log_density: [Arc<Vec<EdgeSpline>>; 3],
    /// Albedo of every slice.
    pub albedo: Vec<DVec3>,
    /// Features of every slice's `wo`.
    pub features: Vec<[f32; GRAZING_FEATURES]>,
    maps: Vec<Vec<[f32; 2]>>,
}

/// One shard of a batch: slices, and positions in the unit square.
pub struct Batch {
    /// Slice of each sample.
    pub slices: Arc<Vec<usize>>,
    /// Position of each sample, in `[POSITION_MIN, 1 − 2⁻²⁴]`.
    pub positions: Vec<[f32; 2]>,
}

impl TrainingSet {
    /// Prepares `slices`, sorted by θ_o, each of one chart.
    pub fn new(slices: &[MappedSlice]) -> TrainingSet {
        let mut order: Vec<&MappedSlice> = slices.iter().collect();
        order.sort_by(|a, b| b.wo[2].total_cmp(&a.wo[2]));
        let plane = |c: usize| {
            let spline = |s: &&MappedSlice| {
                let values: Vec<f64> = s.charts[0].table.log_density[c]
                    .iter()
                    .map(|&v| f64::from(v))
                    .collect();
                EdgeSpline::new(&values, s.charts[0].table.cells)
            };
            Arc::new(order.par_iter().map(spline).collect::<Vec<_>>())
        };
        let luminance = |s: &&MappedSlice| {
            let logs: Vec<f64> = s.charts[0].table.luminance().iter().map(|q| q.ln()).collect();
            EdgeSpline::new(&logs, s.charts[0].table.cells)
        };
        TrainingSet {
            log_luminance: Arc::new(order.par_iter().map(luminance).collect()),
            log_density: [plane(0), plane(1), plane(2)],
            albedo: order.iter().map(|s| s.charts[0].table.albedo()).collect(),
            features: order.iter().map(|s| grazing(s.wo).map(|v| v as f32)).collect(),
            maps: order.iter().map(|s| s.charts[0].map.clone()).collect(),
        }
    }

    /// Draws `size` samples: slices with a preference for grazing ones, positions uniform.
    pub fn draw(&self, size: usize, rng: &mut Rng) -> Batch {
        let count = self.maps.len();
        let mut slices = Vec::with_capacity(size);
        let mut positions = Vec::with_capacity(size);
        for _ in 0..size {
            let rank = 1.0 - rng.uniform().powf(GRAZING_EXPONENT);
            slices.push(((rank * count as f64) as usize).min(count - 1));
            let bound = |v: f64| (v as f32).clamp(POSITION_MIN, 1.0 - f32::EPSILON / 2.0);
            positions.push(rng.pair().map(bound));
        }
        Batch {
            slices: Arc::new(slices),
            positions,
        }
    }

    /// The importance map of slice `k` at `u`: bilinear between cell centres, with every edge of the square
    /// carried onto itself.
    pub fn map_at(&self, k: usize, u: [f32; 2]) -> [f32; 2] {
        let n = CELLS;
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
            let p = self.maps[k][inside(j) * n + inside(i)];
            let pin = |v: f32, k: usize| {
                if k == 0 {
                    0.0
                } else if k == n + 1 {
                    1.0
                } else {
                    v
                }
            };
            [pin(p[0], i), pin(p[1], j)]
        };
        let (a, b, c, d) = (node(i, j), node(i + 1, j), node(i, j + 1), node(i + 1, j + 1));
        std::array::from_fn(|k| (1.0 - t) * ((1.0 - s) * a[k] + s * b[k]) + t * ((1.0 - s) * c[k] + s * d[k]))
    }
}
