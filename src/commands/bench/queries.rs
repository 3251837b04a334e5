//! Batches of queries, the ways to answer them, and how far answers are from f64.

use bake_runtime::bsdf::direction;
use bake_runtime::native::NativeBackend;
use bake_runtime::onnxruntime::OrtBackend;
use bake_runtime::{Backend, BakedMaterial, Network, Points, Result, Rng, oracle};
use bake_train::card::{difference, is_next_to_a_jump};
use serde::Serialize;

/// Largest polar angle of the queries, degrees.
const THETA_MAX_DEG: f64 = 85.0;
/// Largest u: f32 must not round it to 1.
const U_MAX: f64 = 0.999;
/// Key of the queries.
const KEY: u64 = 0xbe7c5;
/// Queries whose answers are compared with f64.
const COMPARED: usize = 256;
/// Columns that the widest answer fills.
const OUTPUTS: usize = 6;

/// What is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Estimator {
    /// Dense layers alone.
    Layers,
    /// Direction and learned weight.
    Learned,
    /// Direction and Jacobian; of two charts with the pdf network's shares.
    Jacobian,
    /// Direction and Jacobian with the exact shares of two charts.
    Mixture,
    /// `f_cos`.
    Eval,
    /// The pdf network.
    Pdf,
    /// The sampler's own density, by inversion.
    ExactPdf,
    /// No query: reading, checking and packing the three files.
    Load,
}

impl Estimator {
    /// The name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Estimator::Layers => "layers",
            Estimator::Learned => "learned",
            Estimator::Jacobian => "jacobian",
            Estimator::Mixture => "mixture",
            Estimator::Eval => "eval",
            Estimator::Pdf => "pdf",
            Estimator::ExactPdf => "exact_pdf",
            Estimator::Load => "load",
        }
    }

    /// Multiply-adds that a query takes; `None` where that depends on the query. An encoding's and a head's arithmetic is not
    /// counted, whoever does it.
    pub fn multiply_adds(self, material: &BakedMaterial) -> Option<usize> {
        let all = |network: &Network| {
            let layers = network.net.iter().chain(&network.frame);
            layers.map(|l| l.inputs * l.outputs).sum()
        };
        match self {
            Estimator::Learned => Some(all(&material.sample)),
            Estimator::Eval => Some(all(&material.eval)),
            Estimator::Pdf => Some(all(&material.pdf)),
            Estimator::Jacobian => {
                let two = material.sample.spec.charts().is_some_and(|c| c.anchors.len() > 1);
                let pdf = if two { all(&material.pdf) } else { 0 };
                Some(with_tangents(&material.sample) + pdf)
            }
            Estimator::Layers | Estimator::Mixture | Estimator::ExactPdf | Estimator::Load => None,
        }
    }
}

/// Multiply-adds of a sampling network without the learned weight, with two tangents wherever u has entered.
fn with_tangents(network: &Network) -> usize {
    use bake_runtime::encoding::{Encoding, Quantity};
    let frame: usize = network.frame.iter().map(|l| l.inputs * l.outputs).sum();
    let Some((last, hidden)) = network.net.split_last() else {
        return frame;
    };
    // The first layer's tangents are constants where u enters as it is.
    let moving = network.spec.inputs.iter().filter(|input| {
        input.quantity == Quantity::U && !matches!(input.encoding, Encoding::Centred | Encoding::Identity)
    });
    let moving: usize = moving.map(|input| input.features()).sum();
    let columns = |i: usize| if i == 0 { 1 } else { 3 };
    let layers = hidden
        .iter()
        .enumerate()
        .map(|(i, l)| columns(i) * l.inputs * l.outputs);
    let first = hidden.first().map_or(2, |l| l.outputs);
    frame + layers.sum::<usize>() + 2 * moving * first + 3 * 2 * last.inputs
}

/// A batch of random queries of one material, and room for its answers.
#[derive(Clone)]
pub struct Batch {
    params: Vec<Vec<f32>>,
    wo: [Vec<f32>; 3],
    u: [Vec<f32>; 2],
    wi: [Vec<f32>; 3],
    out: Vec<Vec<f32>>,
}

/// Something that answers queries.
#[derive(Clone, Copy)]
pub enum Engine<'a> {
    /// Our kernels.
    Native(&'a NativeBackend),
    /// onnxruntime.
    Ort(&'a OrtBackend),
}

impl Batch {
    /// `count` queries of `material`; where `bound`, all with the same parameters. Lights are those that `native` draws.
    pub fn new(material: &BakedMaterial, native: &NativeBackend, count: usize, bound: bool) -> Result<Batch> {
        let mut rng = Rng::new(&[KEY, count as u64]);
        let params = material
            .sample
            .spec
            .material
            .free()
            .into_iter()
            .map(|(_, min, max)| {
                let count = if bound { 1 } else { count };
                (0..count)
                    .map(|_| (min + (max - min) * rng.uniform()) as f32)
                    .collect()
            });
        let params = params.collect();
        let zeros = || vec![0.0f32; count];
        let mut batch = Batch {
            params,
            wo: [zeros(), zeros(), zeros()],
            u: [zeros(), zeros()],
            wi: [zeros(), zeros(), zeros()],
            out: vec![zeros(); OUTPUTS],
        };
        for i in 0..count {
            let wo = direction(THETA_MAX_DEG * rng.uniform(), 360.0 * rng.uniform());
            for c in 0..3 {
                batch.wo[c][i] = wo[c] as f32;
            }
            for column in &mut batch.u {
                column[i] = (U_MAX * rng.uniform()) as f32;
            }
        }
        batch.answer(Engine::Native(native), Estimator::Learned)?;
        for c in 0..3 {
            batch.wi[c].clone_from(&batch.out[c]);
        }
        Ok(batch)
    }

    /// The values of the parameters that all queries share.
    pub fn shared(&self) -> Vec<Option<f32>> {
        self.params.iter().map(|column| column.first().copied()).collect()
    }

    /// The same queries for a material with these parameters bound.
    pub fn unbound(&mut self) {
        self.params.clear();
    }

    /// Answers all queries.
    pub fn answer(&mut self, engine: Engine, estimator: Estimator) -> Result<()> {
        let params: Vec<&[f32]> = self.params.iter().map(Vec::as_slice).collect();
        let points = Points {
            params: &params,
            wo: self.wo.each_ref().map(Vec::as_slice),
        };
        let (u, lights) = (
            self.u.each_ref().map(Vec::as_slice),
            self.wi.each_ref().map(Vec::as_slice),
        );
        let [a, b, c, d, e, f] = &mut self.out[..] else {
            unreachable!("room for {OUTPUTS} columns");
        };
        let backend: &dyn Backend = match engine {
            Engine::Native(native) => native,
            Engine::Ort(ort) => ort,
        };
        match (estimator, engine) {
            (Estimator::Learned, _) => backend.sample_learned(points, u, [a, b, c], [d, e, f]),
            (Estimator::Jacobian, _) => backend.sample_jacobian(points, u, [a, b, c], d),
            (Estimator::Eval, _) => backend.eval(points, lights, [a, b, c]),
            (Estimator::Pdf, _) => backend.pdf(points, lights, a),
            (Estimator::Mixture, Engine::Native(native)) => {
                native.sample_mixture(points, u, [a, b, c], d).map(|_| ())
            }
            (Estimator::ExactPdf, Engine::Native(native)) => native.exact_pdf(points, lights, a).map(|_| ()),
            _ => Ok(()),
        }
    }

    /// What the oracle answers to the first queries; `None` to those next to a jump.
    pub fn truths(&self, material: &BakedMaterial, estimator: Estimator) -> Vec<Option<Vec<f64>>> {
        let compared = 0..self.wo[0].len().min(COMPARED);
        compared.map(|i| self.truth(material, estimator, i)).collect()
    }

    /// Largest |a − b| / max(1, |b|) of the answers against those of the oracle.
    pub fn largest_error(&self, truths: &[Option<Vec<f64>>]) -> f64 {
        let mut largest = 0.0f64;
        for (i, truth) in truths.iter().enumerate() {
            let Some(truth) = truth else {
                continue;
            };
            for (column, &truth) in self.out.iter().zip(truth) {
                largest = largest.max(difference(column[i], truth));
            }
        }
        largest
    }

    fn truth(&self, material: &BakedMaterial, estimator: Estimator, i: usize) -> Option<Vec<f64>> {
        let three = |columns: &[Vec<f32>; 3]| columns.each_ref().map(|column| f64::from(column[i]));
        let param = |column: &Vec<f32>| f64::from(if column.len() == 1 { column[0] } else { column[i] });
        let params: Vec<f64> = self.params.iter().map(param).collect();
        let (wo, wi) = (three(&self.wo), three(&self.wi));
        let u = self.u.each_ref().map(|column| f64::from(column[i]));
        let network = &material.sample;
        let drawn = oracle::sample(network, &params, wo, u);
        let sampled = |values: &[f64]| {
            let jumps = is_next_to_a_jump(network, &params, wo, u, &drawn);
            (!jumps).then(|| [&drawn.wi, values].concat())
        };
        match estimator {
            Estimator::Learned => sampled(&drawn.weight),
            Estimator::Jacobian => sampled(&[oracle::jacobian(&drawn, &material.pdf, &params, wo)]),
            Estimator::Mixture => sampled(&[oracle::mixture_jacobian(&drawn, network, &params, wo)]),
            Estimator::Eval => Some(oracle::eval(&material.eval, &params, wo, wi).to_vec()),
            Estimator::Pdf => Some(vec![oracle::pdf(&material.pdf, &params, wo, wi).0]),
            Estimator::ExactPdf => oracle::exact_pdf(network, &params, wo, wi)
                .filter(|inverted| inverted.unconverged == 0)
                .map(|inverted| vec![inverted.pdf]),
            Estimator::Layers | Estimator::Load => None,
        }
    }
}
