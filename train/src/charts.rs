//! The network that predicts the charts of a slice from its place in the domain: fitted charts are its targets, relative
//! to the analytic ones that it starts from.

use crate::Tick;
use crate::error::Result;
use crate::fused::{Features, Outputs, OutputsMut, TileLoss};
use crate::lobes::{ALBEDO_MIN, Lobe, LobeSlice};
use crate::places::Place;
use crate::presets;
use crate::training::run::Plan;
use crate::training::trainer::Trainer;
use bake_runtime::features::Point;
use bake_runtime::network::Dense;
use bake_runtime::oracle::{self, fold, predict_charts};
use bake_runtime::simd::Simd;
use bake_runtime::spec::{Activation, ChartsSpec, SHARE_MIN, Symmetry};
use bake_runtime::{Material, NetworkSpec, Rng};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

/// Walks behind the charts of a slice: where its light goes on average is known long before every direction of it is.
const WALKS: usize = 256;
/// Seed of the walks.
const WALK_SEED: u64 = 2;

/// A trained network of charts.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartsNetwork {
    /// Its description.
    pub spec: ChartsSpec,
    /// How queries are folded.
    pub symmetry: Symmetry,
    /// Nonlinearity of its hidden layers.
    pub activation: Activation,
    /// Its layers.
    pub layers: Vec<Dense>,
}

/// What the charts of one slice should be.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// Outputs of the network.
    outputs: Vec<f32>,
    /// How much each counts: nothing where a lobe is black.
    weights: Vec<f32>,
}

impl ChartsNetwork {
    /// The charts at `params` and `wo`, which need not be folded.
    pub fn predict(&self, params: &[f64], wo: [f64; 3]) -> oracle::Charts {
        let (folded, _) = fold(self.symmetry, wo);
        predict_charts(&self.spec, &self.layers, self.activation, params, folded)
    }

    /// A hash of its weights.
    pub fn hash(&self) -> u64 {
        let weights = self.layers.iter().flat_map(|l| l.weight.iter().chain(&l.bias));
        crate::maps::hash(weights.map(|w| u64::from(w.to_bits())))
    }

    /// Fits the charts of `material` at `places` and trains the network that `spec` describes on them.
    ///
    /// # Errors
    /// [`crate::Error::Slice`] for a slice without light; as [`Trainer::run`].
    pub fn train(
        spec: &NetworkSpec,
        plan: Plan,
        material: &Material,
        places: &[Place],
        folder: &Path,
        tick: Tick,
    ) -> Result<ChartsNetwork> {
        let charts = spec
            .charts()
            .cloned()
            .unwrap_or_else(|| unreachable!("the warp preset has charts"));
        let context = format!("{material:?} {} places, {charts:?}", places.len());
        let batch = plan.batch;
        let trainer = Trainer::new(plan, &spec.frame_layers(), spec.activation, folder, &context)?;
        let targets = Arc::new(match trainer.is_finished() {
            true => Vec::new(),
            false => fit(material, &charts, places, tick)?,
        });
        let rows = Arc::new(places.iter().map(|place| features(&charts, place)).collect());
        let loss = |_: u64, rng: &mut Rng| {
            let picks = (0..batch).map(|_| (rng.uniform() * places.len() as f64) as usize);
            let batch = ChartsLoss {
                rows: Arc::clone(&rows),
                targets: targets.clone(),
                picks: picks.collect(),
            };
            Ok((1, batch))
        };
        let mlp = trainer.run(loss, tick)?;
        Ok(ChartsNetwork {
            spec: charts,
            symmetry: spec.symmetry,
            activation: spec.activation,
            layers: mlp.to_dense(),
        })
    }
}

/// Features of the frame network at `place`, whose `wo` is folded.
fn features(charts: &ChartsSpec, place: &Place) -> Vec<f32> {
    let mut out = Vec::new();
    Point::new(&place.parameters, place.wo, Some(charts)).append(&charts.inputs, &mut out);
    out.into_iter().map(|v| v as f32).collect()
}

/// Fits the charts of every place.
fn fit(material: &Material, charts: &ChartsSpec, places: &[Place], tick: Tick) -> Result<Vec<Target>> {
    let lobes = presets::lobes(material.family);
    let done = AtomicU64::new(0);
    places
        .par_iter()
        .map(|place| {
            let bsdf = material.bind(&place.parameters)?;
            let slice = LobeSlice::new(&bsdf, DVec3::from_array(place.wo), WALKS, WALK_SEED)?;
            crate::maps::advance(&done, places.len(), tick)?;
            Ok(target(&slice, charts, lobes, place))
        })
        .collect()
}

fn target(slice: &LobeSlice, charts: &ChartsSpec, lobes: &[Lobe], place: &Place) -> Target {
    let alpha = charts.alpha_at(&place.parameters);
    let energies: Vec<f64> = lobes.iter().map(|lobe| slice.energy(*lobe)).collect();
    let (mut outputs, mut weights) = (Vec::new(), Vec::new());
    for ((lobe, anchor), energy) in lobes.iter().zip(&charts.anchors).zip(&energies) {
        let start = anchor.chart(place.wo, alpha);
        let fitted = match *energy > ALBEDO_MIN {
            true => slice.fitted_from(*lobe, &start),
            false => start,
        };
        outputs.extend(fitted.frame.to_outputs(&start.frame).map(|v| v as f32));
        weights.resize(outputs.len(), if *energy > ALBEDO_MIN { 1.0 } else { 0.0 });
    }
    if let [first, second] = energies[..] {
        let share = (first / (first + second)).clamp(SHARE_MIN, 1.0 - SHARE_MIN);
        outputs.push((share / (1.0 - share)).ln() as f32);
        weights.push(SHARE_WEIGHT);
    }
    Target { outputs, weights }
}

/// How much the logit of the share counts beside the outputs of a frame: a share a tenth off costs a percent of variance.
const SHARE_WEIGHT: f32 = 0.3;

/// Mean weighted L1 distance to the targets.
struct ChartsLoss {
    rows: Arc<Vec<Vec<f32>>>,
    targets: Arc<Vec<Target>>,
    picks: Vec<usize>,
}

impl TileLoss for ChartsLoss {
    #[inline(always)]
    fn features<S: Simd>(&self, _: S, queries: Range<usize>, rows: &mut Features) {
        for (i, k) in self.picks[queries].iter().enumerate() {
            rows.row(0, i).copy_from_slice(&self.rows[*k]);
        }
    }

    #[inline(always)]
    fn loss<S: Simd>(
        &self,
        _: S,
        queries: Range<usize>,
        outputs: &Outputs,
        gradient: &mut OutputsMut,
    ) -> f64 {
        let picks = &self.picks[queries];
        let count = self.targets[0].outputs.len();
        let mut loss = 0.0;
        for output in 0..count {
            let values = outputs.plane(0, output);
            for (i, slope) in gradient.plane(0, output).iter_mut().enumerate() {
                let target = &self.targets[picks[i]];
                let (error, weight) = (values[i] - target.outputs[output], target.weights[output]);
                *slope = weight * error.signum();
                loss += f64::from(weight * error.abs());
            }
        }
        loss
    }
}
