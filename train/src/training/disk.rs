//! Training of the paper's preset (Bai et al. 2023, §5.2): three networks on the disk, from slices and their maps.
//!
//! Targets are those of §5.1: positions of the importance map, off its grid; the weight f_cos over the slice's density, the
//! normalised luminance; values and densities of the slice. Maps come from either solver: an image of the disk, or maps of
//! charts, which are evaluated where they are and expressed on the disk.

use super::data::luminance;
use super::mlp::Mlp;
use super::paper::{log_l1, sampling, smape};
use super::run::Plan;
use super::trainer::Trainer;
use crate::Tick;
use crate::error::Result;
use crate::fused::{Features, Outputs, OutputsMut, TileLoss};
use crate::maps::MappedSlice;
use crate::spline::{EdgePlace, EdgeSpline};
use crate::transport::Solver;
use crate::transport::frame_map::FrameMap;
use crate::transport::map::{ImportanceMap, MapImage};
use bake_runtime::chart::Chart;
use bake_runtime::encoding::Quantity;
use bake_runtime::features::Point;
use bake_runtime::simd::Simd;
use bake_runtime::spec::{DISK_HEIGHT_MIN, EXPONENT_MAX, Input};
use bake_runtime::{NetworkSpec, Rng, Role};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Most outputs of a network: (x, y) and a weight.
const OUTPUTS_MAX: usize = 5;

/// One slice: its light in charts, and the map of its luminance.
pub struct DiskSlice {
    params: Vec<f64>,
    wo: [f64; 3],
    lobes: Vec<DiskLobe>,
    map: Box<dyn ImportanceMap + Send>,
    /// Luminance albedo.
    energy: f64,
}

/// ln f_cos·dω/ds per channel in the square of a chart.
struct DiskLobe {
    chart: Chart,
    cells: usize,
    log_density: EdgeSpline<3>,
}

/// The slices that the three networks learn.
pub struct DiskSet {
    slices: Vec<DiskSlice>,
}

impl DiskSet {
    /// Prepares `slices`, whose maps `solver` made.
    pub fn new(slices: Vec<MappedSlice>, solver: Solver) -> DiskSet {
        let prepare = |slice: MappedSlice| {
            let map: Box<dyn ImportanceMap + Send> = match (solver, &slice.charts[..]) {
                (Solver::Frame, charts) => Box::new(FrameMap::new(charts)),
                (_, charts) => Box::new(MapImage {
                    side: charts[0].table.cells,
                    points: charts[0].map.iter().map(|p| p.map(f64::from)).collect(),
                }),
            };
            let energy = slice.charts.iter().map(|c| luminance(c.table.albedo())).sum();
            let lobe = |c: &crate::transport::frame_map::ChartMap| {
                let logs: [Vec<f64>; 3] = [0, 1, 2]
                    .map(|channel: usize| c.table.log_density[channel].iter().map(|&v| v.into()).collect());
                DiskLobe {
                    chart: c.chart,
                    cells: c.table.cells,
                    log_density: EdgeSpline::new(logs.each_ref().map(|l| &l[..]), c.table.cells),
                }
            };
            DiskSlice {
                lobes: slice.charts.iter().map(lobe).collect(),
                params: slice.parameters,
                wo: slice.wo,
                map,
                energy,
            }
        };
        DiskSet {
            slices: slices.into_par_iter().map(prepare).collect(),
        }
    }
}

impl DiskSlice {
    /// f_cos at `wi`, RGB, sr⁻¹.
    fn f_cos(&self, wi: [f64; 3]) -> DVec3 {
        let of = |lobe: &DiskLobe| {
            let (_, density) = lobe.chart.to_local(wi);
            let place = EdgePlace::new(lobe.chart.direction_to_square(wi), lobe.cells);
            DVec3::from_array(lobe.log_density.values(&place).map(f64::exp)) * density
        };
        self.lobes.iter().map(of).sum()
    }

    /// Position on the disk for `u`, and the weight there.
    fn target(&self, u: [f64; 2]) -> [f32; OUTPUTS_MAX] {
        let position = self.map.at(u);
        let f_cos = self.f_cos(lift(position));
        let weight = f_cos * (self.energy / luminance(f_cos).max(f64::MIN_POSITIVE));
        let [r, g, b] = weight.as_vec3().to_array();
        [position[0] as f32, position[1] as f32, r, g, b]
    }
}

/// The direction over a position on the disk; from outside of it the nearest one, next to the horizon.
fn lift([x, y]: [f64; 2]) -> [f64; 3] {
    let z = (1.0 - x * x - y * y)
        .max(DISK_HEIGHT_MIN * DISK_HEIGHT_MIN)
        .sqrt();
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

/// Trains the network of `spec`, any of the three.
///
/// # Errors
/// As [`Trainer::run`].
pub fn train(
    spec: &NetworkSpec,
    plan: Plan,
    set: &Arc<DiskSet>,
    folder: &Path,
    context: &str,
    tick: Tick,
) -> Result<Mlp> {
    let size = plan.batch;
    let of_query = |i: &Input| matches!(i.quantity, Quantity::U | Quantity::WiDisk);
    let (query, place): (Vec<Input>, Vec<Input>) = spec.inputs.iter().partition(|i| of_query(i));
    let rows = set
        .slices
        .iter()
        .map(|s| features(&Point::new(&s.params, s.wo, None), &place));
    let places: Arc<Vec<Vec<f32>>> = Arc::new(rows.collect());
    let role = spec.role;
    let trainer = Trainer::new(plan, &spec.layers(), spec.activation, folder, context)?;
    let loss = |_: u64, rng: &mut Rng| {
        let pick = |rng: &mut Rng| ((rng.uniform() * set.slices.len() as f64) as usize, rng.pair());
        let picks: Vec<(usize, [f64; 2])> = (0..size).map(|_| pick(rng)).collect();
        let drawn = picks.par_iter().map(|&(k, u)| {
            let slice = &set.slices[k];
            let mut point = Point::new(&slice.params, slice.wo, None);
            let target = match role {
                Role::Sample => {
                    point.u = u;
                    slice.target(u)
                }
                Role::Eval | Role::Pdf => {
                    point.wi = on_disk(u);
                    let f_cos = slice.f_cos(point.wi);
                    let [r, g, b] = match role {
                        Role::Eval => f_cos.as_vec3().to_array(),
                        _ => [(luminance(f_cos) / slice.energy) as f32, 0.0, 0.0],
                    };
                    [r, g, b, 0.0, 0.0]
                }
            };
            (features(&point, &query), target)
        });
        let batch = DiskLoss {
            role,
            drawn: drawn.collect(),
            slices: picks.iter().map(|(k, _)| *k).collect(),
            places: places.clone(),
        };
        Ok((1, batch))
    };
    trainer.run(loss, tick)
}

/// A direction whose place on the disk is uniform, as that of a pixel is.
fn on_disk(u: [f64; 2]) -> [f64; 3] {
    let w = bake_runtime::concentric::square_to_hemisphere(u, [1.0 - u[0], 1.0 - u[1]]);
    [w[0], w[1], w[2].max(DISK_HEIGHT_MIN)]
}

fn features(point: &Point, inputs: &[Input]) -> Vec<f32> {
    let mut out = Vec::new();
    point.append(inputs, &mut out);
    out.into_iter().map(|v| v as f32).collect()
}

/// A batch with its targets.
struct DiskLoss {
    role: Role,
    /// Features of u or wi, and the targets.
    drawn: Vec<(Vec<f32>, [f32; OUTPUTS_MAX])>,
    slices: Vec<usize>,
    places: Arc<Vec<Vec<f32>>>,
}

impl DiskLoss {
    /// Loss of one query, and its gradient by the outputs.
    fn of(
        &self,
        target: &[f32; OUTPUTS_MAX],
        output: &[f32; OUTPUTS_MAX],
        slope: &mut [f32; OUTPUTS_MAX],
    ) -> f64 {
        let exp = |v: f32| v.clamp(-EXPONENT_MAX as f32, EXPONENT_MAX as f32).exp();
        let mut prediction = output.map(exp);
        let loss = match self.role {
            Role::Sample => {
                let position = [0, 1].map(|c: usize| 1.0 / (1.0 + (-output[c]).exp()));
                prediction[..2].copy_from_slice(&position.map(|h| 2.0 * h - 1.0));
                let loss = sampling(&prediction, target, slope);
                for c in 0..2 {
                    slope[c] *= 2.0 * position[c] * (1.0 - position[c]);
                }
                loss
            }
            Role::Eval => smape(&prediction[..3], &target[..3], &mut slope[..3]),
            Role::Pdf => log_l1(&prediction[..1], &target[..1], &mut slope[..1]),
        };
        let first = if self.role == Role::Sample { 2 } else { 0 };
        for c in first..OUTPUTS_MAX {
            slope[c] *= prediction[c];
        }
        loss
    }
}

impl TileLoss for DiskLoss {
    #[inline(always)]
    fn features<S: Simd>(&self, _: S, queries: Range<usize>, rows: &mut Features) {
        for (i, k) in queries.enumerate() {
            let place = &self.places[self.slices[k]];
            let (first, last) = rows.row(0, i).split_at_mut(place.len());
            first.copy_from_slice(place);
            last.copy_from_slice(&self.drawn[k].0);
        }
    }

    fn loss<S: Simd>(
        &self,
        _: S,
        queries: Range<usize>,
        outputs: &Outputs,
        gradient: &mut OutputsMut,
    ) -> f64 {
        let count = match self.role {
            Role::Sample => 5,
            Role::Eval => 3,
            Role::Pdf => 1,
        };
        let mut loss = 0.0;
        for (i, k) in queries.enumerate() {
            let (mut output, mut slope) = ([0.0; OUTPUTS_MAX], [0.0; OUTPUTS_MAX]);
            for (o, value) in output.iter_mut().enumerate().take(count) {
                *value = outputs.plane(0, o)[i];
            }
            loss += self.of(&self.drawn[k].1, &output, &mut slope);
            for (o, slope) in slope.iter().enumerate().take(count) {
                gradient.plane(0, o)[i] = *slope;
            }
        }
        loss
    }
}
