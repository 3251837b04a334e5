//! Training of the warp sampling network.
//!
//! First the map: L1 distance to the importance map. Then the density: with h the network's position in the
//! chart's square, the ratio r = q(h)·det Dh of target to sampled density should be 1 everywhere, so |ln r|
//! is driven to zero, with both tangents carried through the network. The three remaining outputs learn the
//! weight that the network's own map needs by least squares (whose optimum is its mean): f_cos·jacobian, with two
//! charts times the lobe's own part of the light at wi, over the chart's share. Where a weight is far above the albedo, as
//! those of a weak channel are in the tails, its error counts relative to the prediction, which leaves the optimum alone.

use super::data::{Entry, Pick, TrainingSet, luminance};
use super::mlp::Mlp;
use super::run::Plan;
use super::trainer::Trainer;
use crate::Tick;
use crate::error::Result;
use crate::fused::{Features, Outputs, OutputsMut, TileLoss};
use crate::spline::EdgePlace;
use bake_runtime::simd::Simd;
use bake_runtime::spec::WARP_SHIFT_MAX;
use bake_runtime::{NetworkSpec, Rng};
use glam::DVec3;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Share of the steps spent on the map alone.
const MAP_SHARE: f64 = 0.2;
/// Weight of the map's distance while the density is trained: it keeps the map from wandering into folds.
const MAP_WEIGHT: f64 = 0.3;
/// Weight of the learned weight's squared error, relative to the albedo: squares of hundredths would count for nothing beside
/// the density's absolute values.
const WEIGHT_WEIGHT: f64 = 4.0;
/// Weight of the squared deviation of the ratio, which is the variance of the exact weight.
const VARIANCE_WEIGHT: f64 = 0.5;
/// Ratios below this count linearly, so that a fold is pushed out instead of giving NaN.
const RATIO_FLOOR: f64 = 1e-2;
/// Deviations above this count linearly: they are rare, and would only add noise.
const RATIO_BEND: f64 = 2.0;
/// Learned weights aim at most at this many albedos. Less would cut off the tails that dark channels have: with 5 the worst
/// channel at the held-out places of the wide conductor lost 23 % of its light.
const WEIGHT_MAX: f64 = 1000.0;

/// Features of u, the centred numbers, in front of those of the place.
const U_FEATURES: usize = 2;

/// Steps of a training of `steps` that are spent on the map alone; those after them have another loss.
pub fn map_steps(steps: u64) -> u64 {
    (steps as f64 * MAP_SHARE) as u64
}

/// Trains the network of `spec` on `set`.
///
/// # Errors
/// As [`Trainer::run`].
pub fn train(
    spec: &NetworkSpec,
    plan: Plan,
    set: &Arc<TrainingSet>,
    folder: &Path,
    context: &str,
    tick: Tick,
) -> Result<Mlp> {
    let map_steps = map_steps(plan.steps);
    let batch = plan.batch;
    let places = Arc::new(set.place_features(spec));
    let loss = |step: u64, rng: &mut Rng| {
        let stage = if step < map_steps {
            Stage::Map
        } else {
            Stage::Density
        };
        let batch = WarpLoss {
            set: set.clone(),
            places: places.clone(),
            picks: set.draw(batch, rng),
            stage,
        };
        Ok((stage.columns(), batch))
    };
    Trainer::new(plan, &spec.layers(), spec.activation, folder, context)?.run(loss, tick)
}

/// What is trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Map,
    Density,
}

impl Stage {
    /// Rows per query: values, and for the density their derivatives along u.
    fn columns(self) -> usize {
        match self {
            Stage::Map => 1,
            Stage::Density => 3,
        }
    }
}

/// The loss of a batch; the features of u come first.
struct WarpLoss {
    set: Arc<TrainingSet>,
    places: Arc<Vec<Vec<f32>>>,
    picks: Vec<Pick>,
    stage: Stage,
}

/// Rows of features of `picks`, values and the derivatives along u₀ and u₁, for [`crate::fused::Fused::forward`].
pub fn u_features(picks: &[Pick], places: &[Vec<f32>]) -> Vec<f32> {
    let width = U_FEATURES + places.first().map_or(0, Vec::len);
    let mut rows = vec![0.0; 3 * picks.len() * width];
    for (i, pick) in picks.iter().enumerate() {
        for column in 0..3 {
            let start = (column * picks.len() + i) * width;
            encode(pick, &places[pick.entry], column, &mut rows[start..start + width]);
        }
    }
    rows
}

/// Writes the features of `pick` (column 0), or what of their derivative along u₀ (1) or u₁ (2) is not 0.
#[inline(always)]
fn encode(pick: &Pick, place: &[f32], column: usize, row: &mut [f32]) {
    match column {
        0 => {
            row[..U_FEATURES].copy_from_slice(&pick.at.map(|u| 2.0 * u - 1.0));
            row[U_FEATURES..].copy_from_slice(place);
        }
        tangent => row[tangent - 1] = 2.0,
    }
}

/// Position and derivatives of the warp at one u.
pub struct Warp {
    /// h.
    pub h: [f64; 2],
    /// 1 − h.
    pub complement: [f64; 2],
    /// u(1 − u).
    spread: [f64; 2],
    /// δ_cj + u_c(1 − u_c)·∂g_c/∂u_j.
    bent: [[f64; 2]; 2],
}

impl Warp {
    /// The warp with shifts `g`, and their derivatives `slopes[c][j]` = ∂g_c/∂u_j.
    pub fn new(u: [f32; 2], g: [f32; 2], slopes: [[f32; 2]; 2]) -> Warp {
        let mut warp = Warp {
            h: [0.0; 2],
            complement: [0.0; 2],
            spread: [0.0; 2],
            bent: [[0.0; 2]; 2],
        };
        for c in 0..2 {
            let u = f64::from(u[c]);
            let g = f64::from(g[c]).clamp(-WARP_SHIFT_MAX, WARP_SHIFT_MAX);
            let rest = (1.0 - u) * (-g).exp();
            warp.h[c] = u / (u + rest);
            warp.complement[c] = rest / (u + rest);
            warp.spread[c] = u * (1.0 - u);
            warp.bent[c] = slopes[c].map(|slope| warp.spread[c] * f64::from(slope));
            warp.bent[c][c] += 1.0;
        }
        warp
    }

    /// dh_c/dg_c.
    fn slope(&self, c: usize) -> f64 {
        self.h[c] * self.complement[c]
    }

    /// Determinant of the bent part alone; its sign is that of [`Warp::det`].
    fn bent_det(&self) -> f64 {
        let [[a, b], [c, d]] = self.bent;
        a * d - b * c
    }

    /// Signed determinant of u ↦ h.
    pub fn det(&self) -> f64 {
        self.bent_det() * self.slope(0) / self.spread[0] * self.slope(1) / self.spread[1]
    }
}

impl WarpLoss {
    /// Loss of the distance to the map's position `target`, and its gradient by g.
    fn map(target: [f32; 2], warp: &Warp) -> (f64, [f64; 2]) {
        let error = [0, 1].map(|c: usize| warp.h[c] - f64::from(target[c]));
        (
            error[0].abs() + error[1].abs(),
            [0, 1].map(|c: usize| error[c].signum() * warp.slope(c)),
        )
    }

    /// Loss of the density, whose target's logarithm at the warp and its gradient are given, and its gradient by g and by
    /// ∂g_c/∂u_j.
    fn density((log_q, log_slope): (f64, [f64; 2]), warp: &Warp) -> (f64, [f64; 2], [[f64; 2]; 2]) {
        let bent = warp.bent_det();
        let scale = log_q.exp() * warp.slope(0) / warp.spread[0] * warp.slope(1) / warp.spread[1];
        let ratio = scale * bent;
        // d loss = along · d ln(scale) + across · d bent.
        let (loss, along, across) = if ratio > RATIO_FLOOR {
            let log = ratio.ln();
            let deviation = ratio - 1.0;
            let (square, pull) = match deviation > RATIO_BEND {
                true => (RATIO_BEND * (2.0 * deviation - RATIO_BEND), 2.0 * RATIO_BEND),
                false => (deviation * deviation, 2.0 * deviation),
            };
            let slope = log.signum() + VARIANCE_WEIGHT * pull * ratio;
            (log.abs() + VARIANCE_WEIGHT * square, slope, slope / bent)
        } else {
            let linear = 1.0 - RATIO_FLOOR.ln() - ratio / RATIO_FLOOR;
            (linear, -ratio / RATIO_FLOOR, -scale / RATIO_FLOOR)
        };
        // ∂ ln(h(1 − h))/∂g = (1 − h) − h.
        let by_g =
            [0, 1].map(|c: usize| along * (warp.slope(c) * log_slope[c] + warp.complement[c] - warp.h[c]));
        let [[a, b], [c, d]] = warp.bent;
        let [vx, vy] = warp.spread;
        (
            loss,
            by_g,
            [
                [across * d * vx, -across * c * vx],
                [-across * b * vy, across * a * vy],
            ],
        )
    }

    /// Light of the slice's other lobe at `warp`, per unit of the entry's square, RGB; zero where there is none.
    fn other_light(&self, entry: &Entry, warp: &Warp) -> DVec3 {
        let Some(other) = entry.other.map(|k| &self.set.entries[k]) else {
            return DVec3::ZERO;
        };
        let (wi, area) = entry.own_chart().1.square_to_direction(warp.h);
        let (_, far) = other.own_chart();
        let place = EdgePlace::new(far.direction_to_square(wi), other.cells);
        let [_, r, g, b] = other.log_density.values(&place);
        DVec3::from_array([r, g, b].map(f64::exp)) * (far.density(wi) * area)
    }

    /// The weight that the map needs at `warp`, over the albedo, RGB, where its own lobe's light is `own`.
    fn weight(entry: &Entry, warp: &Warp, own: DVec3, other: DVec3) -> DVec3 {
        let (share, _) = entry.own_chart();
        let light = match entry.other {
            None => own,
            Some(_) => {
                let light = own + other;
                light * (luminance(own) / luminance(light))
            }
        };
        (light * (warp.det() / share) / entry.albedo).clamp(DVec3::ZERO, DVec3::splat(WEIGHT_MAX))
    }

    /// What the tables say about the queries' warps.
    ///
    /// Tables are far larger than any cache: each kind of lookup has its own loop, short enough for the processor to wait
    /// for the memory of several queries at once.
    fn look_up(&self, picks: &[Pick], warps: &[Warp]) -> Vec<Found> {
        let entry = |pick: &Pick| &self.set.entries[pick.entry];
        let mut found: Vec<Found> = picks
            .iter()
            .map(|pick| Found {
                map: entry(pick).map_at(pick.at),
                ..Found::default()
            })
            .collect();
        if self.stage == Stage::Map {
            return found;
        }
        let places = picks
            .iter()
            .zip(warps)
            .map(|(pick, warp)| EdgePlace::new(warp.h, entry(pick).cells));
        let places: Vec<EdgePlace> = places.collect();
        for ((pick, place), found) in picks.iter().zip(&places).zip(&mut found) {
            let [luminance, rgb @ ..] = entry(pick).log_density.around(place);
            found.log_luminance = luminance;
            found.log_f_cos = rgb.map(|(log, _)| log);
        }
        for ((pick, warp), found) in picks.iter().zip(warps).zip(&mut found) {
            found.other = self.other_light(entry(pick), warp);
        }
        found
    }
}

/// What the tables say about one query.
#[derive(Clone, Copy, Default)]
struct Found {
    /// Position that the importance map has.
    map: [f32; 2],
    /// Of [`Entry::log_density`] the luminance with its gradient.
    log_luminance: (f64, [f64; 2]),
    /// And the three channels of f_cos.
    log_f_cos: [f64; 3],
    /// Light of the other lobe.
    other: DVec3,
}

impl TileLoss for WarpLoss {
    #[inline(always)]
    fn features<S: Simd>(&self, _: S, queries: Range<usize>, rows: &mut Features) {
        for (i, pick) in self.picks[queries].iter().enumerate() {
            for column in 0..self.stage.columns() {
                encode(pick, &self.places[pick.entry], column, rows.row(column, i));
            }
        }
    }

    fn loss<S: Simd>(
        &self,
        _: S,
        queries: Range<usize>,
        outputs: &Outputs,
        gradient: &mut OutputsMut,
    ) -> f64 {
        let picks = &self.picks[queries];
        let warp = |(i, pick): (usize, &Pick)| {
            let g = [0, 1].map(|c| outputs.plane(0, c)[i]);
            let slopes = match self.stage {
                Stage::Map => [[0.0; 2]; 2],
                Stage::Density => [0, 1].map(|c| [1, 2].map(|j| outputs.plane(j, c)[i])),
            };
            Warp::new(pick.at, g, slopes)
        };
        let warps: Vec<Warp> = picks.iter().enumerate().map(warp).collect();
        let found = self.look_up(picks, &warps);
        let mut loss = 0.0;
        for (i, ((pick, warp), found)) in picks.iter().zip(&warps).zip(&found).enumerate() {
            let (far, pull) = WarpLoss::map(found.map, warp);
            if self.stage == Stage::Map {
                loss += far;
                pull.iter()
                    .enumerate()
                    .for_each(|(c, s)| gradient.plane(0, c)[i] = *s as f32);
                continue;
            }
            let entry = &self.set.entries[pick.entry];
            let (value, by_g, by_slopes) = WarpLoss::density(found.log_luminance, warp);
            loss += value + MAP_WEIGHT * far;
            for c in 0..2 {
                gradient.plane(0, c)[i] = (by_g[c] + MAP_WEIGHT * pull[c]) as f32;
                for (j, slope) in by_slopes[c].iter().enumerate() {
                    gradient.plane(1 + j, c)[i] = *slope as f32;
                }
            }
            let own = DVec3::from_array(found.log_f_cos.map(f64::exp));
            let target = WarpLoss::weight(entry, warp, own, found.other);
            for c in 0..3 {
                let weight = f64::from(outputs.plane(0, 2 + c)[i]).exp() / entry.albedo[c];
                let scale = weight.max(1.0);
                let error = (weight - target[c]) / scale;
                loss += WEIGHT_WEIGHT * error * error;
                gradient.plane(0, 2 + c)[i] = (2.0 * WEIGHT_WEIGHT * error * weight / scale) as f32;
            }
        }
        loss
    }
}
