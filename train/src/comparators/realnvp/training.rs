//! Training of a flow by maximum likelihood on directions drawn from importance maps.

use super::condition::{Condition, Fold};
use super::{LOG_SCALE_MAX, RealNvp, plane, roles, shapes};
use crate::Tick;
use crate::error::{Error, Result};
use crate::maps::MappedSlice;
use crate::nn::mlp::Mlp;
use crate::optimiser::Optimiser;
use crate::training::trainer::SHARDS;
use crate::transport::frame_map::FrameMap;
use bake_runtime::network::Dense;
use bake_runtime::{Material, Rng};
use candle_core::{Device, Tensor, Var};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Key of initial weights and of batches.
const KEY: u64 = 0xf10f;
/// Peak learning rate. On the vase, three couplings and 1000 steps: binning L1 at 45° is 0.095, 0.089, 0.079 and 0.077 with
/// 2e-3, 4e-3, 1e-2 and 2e-2, the last with weights above 150.
const RATE: f64 = 1e-2;
/// Steps over which the rate rises from 0.
const WARM_UP_STEPS: f64 = 50.0;

/// What a flow learns from.
pub struct FlowSet {
    condition: Condition,
    /// Per slice: its map, where its directions are folded to, its features.
    slices: Vec<(FrameMap, Fold, Vec<f32>)>,
}

/// How long a flow is trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Number of steps.
    pub steps: u64,
    /// Samples per step.
    pub batch: usize,
    /// Seed of initial weights and of batches.
    pub seed: u64,
}

impl FlowSet {
    /// Prepares the `slices` of `material`, at least one, whose maps are those of [`crate::transport::Solver::Frame`].
    pub fn new(material: &Material, slices: &[MappedSlice]) -> FlowSet {
        let condition = Condition::new(material);
        let prepare = |slice: &MappedSlice| {
            let wo = DVec3::from_array(slice.wo);
            let fold = condition.fold(wo);
            let features = condition.features(&slice.parameters, fold.apply(wo));
            let features = features.into_iter().map(|v| v as f32).collect();
            (FrameMap::new(&slice.charts), fold, features)
        };
        FlowSet {
            slices: slices.iter().map(prepare).collect(),
            condition,
        }
    }

    /// Number of features of a slice.
    pub fn features(&self) -> usize {
        self.condition.width()
    }

    /// Points of the plane `[size, 2]` under directions drawn from slices, each as likely as any, and the features of
    /// these slices `[size, features]`.
    fn draw(&self, size: usize, rng: &mut Rng) -> Result<(Tensor, Tensor)> {
        let mut points = Vec::with_capacity(2 * size);
        let mut features: Vec<f32> = Vec::with_capacity(size * self.features());
        for _ in 0..size {
            let k = (rng.uniform() * self.slices.len() as f64) as usize;
            let (map, fold, slice) = &self.slices[k];
            let (wi, _) = map.direction(rng.pair());
            points.extend(plane::from_direction(fold.apply(wi)).to_array().map(|v| v as f32));
            features.extend(slice);
        }
        let points = Tensor::from_vec(points, (size, 2), &Device::Cpu)?;
        Ok((
            points,
            Tensor::from_vec(features, (size, self.features()), &Device::Cpu)?,
        ))
    }
}

/// A flow under training: the network of each coupling, from the Gaussian to the slice.
struct Flow(Vec<Mlp>);

impl Flow {
    fn vars(&self) -> Vec<&Var> {
        self.0.iter().flat_map(Mlp::vars).collect()
    }

    /// Ln of the density at `points` `[B, 2]` of the plane under `features` `[B, F]`: `[B]`.
    fn log_density(&self, points: &Tensor, features: &Tensor) -> candle_core::Result<Tensor> {
        let mut x = [points.narrow(1, 0, 1)?, points.narrow(1, 1, 1)?];
        let mut log_det = x[0].zeros_like()?;
        for (i, mlp) in self.0.iter().enumerate().rev() {
            let [kept, moved] = roles(i);
            let output = mlp.forward(&Tensor::cat(&[&x[kept], features], 1)?, 1)?;
            let raw = (output.narrow(1, 0, 1)? * (1.0 / LOG_SCALE_MAX))?;
            let log_scale = (raw.tanh()? * LOG_SCALE_MAX)?;
            x[moved] = ((&x[moved] - output.narrow(1, 1, 1)?)? * log_scale.neg()?.exp()?)?;
            log_det = (log_det + log_scale)?;
        }
        let [x, y] = x;
        let squares = ((x.sqr()? + y.sqr()?)? * -0.5)?;
        ((squares - log_det)? - TAU.ln())?.squeeze(1)
    }

    /// The flow with plain weights.
    fn trained(&self, condition: &Condition) -> Result<RealNvp> {
        let dense = |mlp: &Mlp| -> candle_core::Result<[Dense; 3]> {
            let layers: std::result::Result<[Dense; 3], Vec<Dense>> = mlp.to_dense()?.try_into();
            Ok(layers.expect("as many layers as shapes"))
        };
        Ok(RealNvp {
            condition: condition.clone(),
            couplings: self.0.iter().map(dense).collect::<candle_core::Result<_>>()?,
        })
    }

    /// Mean negative log-density over a shard, and its gradient by every variable.
    fn gradients(&self, points: &Tensor, features: &Tensor) -> Result<(f64, Vec<Vec<f32>>)> {
        let loss = self.log_density(points, features)?.mean_all()?.neg()?;
        let store = loss.backward()?;
        let gradient = |var: &Var| match store.get(var) {
            Some(g) => g.flatten_all()?.to_vec1::<f32>(),
            None => Ok(vec![0.0; var.elem_count()]),
        };
        let all = self
            .vars()
            .into_iter()
            .map(gradient)
            .collect::<candle_core::Result<_>>()?;
        Ok((f64::from(loss.to_scalar::<f32>()?), all))
    }
}

/// Trains a flow of `couplings` couplings; [`super::couplings_of`] gives their number for a number of parameters.
///
/// The result depends on the arguments alone, not on the number of threads.
///
/// # Errors
/// [`Error::Interrupted`] when `tick` breaks, [`Error::Density`] when the likelihood is not finite.
pub fn train(set: &FlowSet, couplings: usize, budget: Budget, tick: Tick) -> Result<RealNvp> {
    // candle would split every product over all cores; the shards already use them.
    gemm::set_threading_threshold(usize::MAX);
    let mut rng = Rng::new(&[KEY, budget.seed]);
    let nets = (0..couplings).map(|_| Mlp::random(&shapes(set.features()), &mut rng));
    let flow = Flow(nets.collect::<candle_core::Result<_>>()?);
    let parameters = flow.vars().into_iter().enumerate().map(|(i, var)| {
        let shape = (var.dim(0)?, var.dims().get(1).copied().unwrap_or(1));
        // Weight, bias, weight, bias, weight, bias: the second weight of each network is the hidden one.
        Ok((shape, var.flatten_all()?.to_vec1::<f32>()?, i % 6 == 2))
    });
    let mut optimiser = Optimiser::new(parameters.collect::<candle_core::Result<_>>()?);
    for step in 0..budget.steps {
        if tick(step, budget.steps).is_break() {
            return Err(Error::Interrupted);
        }
        let shard = |shard: usize| {
            let mut rng = Rng::new(&[KEY, budget.seed, 1 + step, shard as u64]);
            let (points, features) = set.draw(budget.batch / SHARDS, &mut rng)?;
            flow.gradients(&points, &features)
        };
        let shards = (0..SHARDS)
            .into_par_iter()
            .map(shard)
            .collect::<Result<Vec<_>>>()?;
        let loss = shards.iter().map(|(loss, _)| loss).sum::<f64>() / SHARDS as f64;
        if !loss.is_finite() {
            return Err(Error::Density {
                reason: format!("the log-likelihood of the flow is {} at step {step}", -loss),
            });
        }
        let mut total = shards[0].1.clone();
        for (_, part) in &shards[1..] {
            for (sum, part) in total.iter_mut().zip(part) {
                sum.iter_mut().zip(part).for_each(|(s, g)| *s += g);
            }
        }
        total.iter_mut().flatten().for_each(|g| *g /= SHARDS as f32);
        optimiser.descend(&total, rate(step, budget.steps));
        for (var, parameter) in flow.vars().into_iter().zip(&optimiser.parameters) {
            var.set(&Tensor::from_slice(&parameter.value, var.shape(), var.device())?)?;
        }
    }
    flow.trained(&set.condition)
}

/// Learning rate of a step: a short rise, then a cosine to zero.
fn rate(step: u64, steps: u64) -> f32 {
    let cosine = 0.5 * (1.0 + (PI * step as f64 / steps as f64).cos());
    (RATE * cosine * ((step + 1) as f64 / WARM_UP_STEPS).min(1.0)) as f32
}

#[cfg(test)]
mod tests {
    use super::super::tests::random_flow;
    use super::*;
    use crate::card::truth::Truth;
    use crate::comparators::measure::{Target, measure};
    use crate::maps::{self, Charts, Job};
    use crate::{database, transport::Solver};
    use bake_runtime::Family;
    use bake_runtime::bsdf::direction;
    use glam::DVec2;
    use std::ops::ControlFlow;

    /// f32 through four couplings, relative to logarithms of a few units.
    const LOG_DENSITY_TOL: f64 = 2e-5;
    /// What 150 steps of 1024 samples on eight slices reach on another slice: 0.20; untrained 1.38.
    const TRAINED_L1: f64 = 0.3;

    fn vase() -> Material {
        let given = [("alpha", &[0.3, 0.1][..]), ("reflectance", &[1.0, 0.782, 0.344])];
        Material::fixed("vase", Family::Conductor, &given).expect("valid parameters")
    }

    fn set(material: &Material, count: usize) -> FlowSet {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        let places = maps::draw_directions(count);
        let job = Job {
            material,
            places: &places,
            drawn: "training directions",
            charts: Charts::Fitted,
            solver: Solver::Frame,
            cells: 32,
            seed: 1,
        };
        maps::compute(&job, folder.path(), &|_, _| ControlFlow::Continue(())).expect("bright slices");
        let slices = database::load(folder.path(), count, &job.fingerprint()).expect("just written");
        FlowSet::new(material, &slices)
    }

    #[test]
    fn plain_rust_computes_what_candle_does() {
        let flow = random_flow();
        let nets = flow.couplings.iter().map(|layers| Mlp::from_dense(layers));
        let trained = Flow(nets.collect::<candle_core::Result<_>>().expect("plain data"));
        let mut rng = Rng::new(&[0xca]);
        for _ in 0..200 {
            let wo = direction(89.0 * rng.uniform(), 90.0 * rng.uniform());
            let x = DVec2::from_array(rng.pair().map(|u| 8.0 * u - 4.0));
            let features = flow.condition.features(&[], wo);
            let features: Vec<f32> = features.into_iter().map(|v| v as f32).collect();
            let points = Tensor::new(&[x.to_array().map(|v| v as f32)], &Device::Cpu).expect("plain data");
            let features =
                Tensor::from_vec(features, (1, flow.condition.width()), &Device::Cpu).expect("plain data");
            let found = trained
                .log_density(&points, &features)
                .and_then(|t| t.to_vec1::<f32>());
            let found = f64::from(found.expect("one number")[0]);
            let expected = flow.bind(&[], wo).log_density(x);
            assert!(
                (found - expected).abs() < LOG_DENSITY_TOL * expected.abs().max(1.0),
                "{found} {expected}"
            );
        }
        assert_eq!(trained.trained(&flow.condition).expect("plain data"), flow);
    }

    #[test]
    fn training_lowers_the_binning_error() {
        let material = vase();
        let set = set(&material, 8);
        let bsdf = material.conductor().expect("fixed parameters");
        let truth = Truth::new(&bsdf, direction(50.0, 120.0)).expect("a bright slice");
        let target = Target::of_conductor(&bsdf, &truth);
        let after = |steps: u64| {
            let budget = Budget {
                steps,
                batch: 1024,
                seed: 1,
            };
            let flow = train(&set, 3, budget, &|_, _| ControlFlow::Continue(())).expect("finite");
            measure(&flow.bind(&[], truth.wo), &target, 0).binning_l1
        };
        let (before, after) = (after(0), after(150));
        assert!(
            after < TRAINED_L1 && before > 3.0 * TRAINED_L1,
            "{before} {after}"
        );
    }

    #[test]
    fn threads_do_not_change_the_flow_and_ticks_can_stop_it() {
        let set = set(&vase(), 2);
        let budget = Budget {
            steps: 3,
            batch: 256,
            seed: 5,
        };
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("threads");
            pool.install(|| train(&set, 2, budget, &|_, _| ControlFlow::Continue(())))
                .expect("finite")
        };
        assert_eq!(with(1), with(2));
        let stopped = train(&set, 2, budget, &|done, _| match done {
            1 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        });
        assert!(matches!(stopped, Err(Error::Interrupted)));
    }
}
