//! Agreement of backends with each other and with the f64 oracle, over random queries in the whole domain.

use super::Runners;
use super::batch::{points, views};
use crate::error::Result;
use crate::places::value_at;
use bake_runtime::backend::{Backend, BakedMaterial};
use bake_runtime::bsdf::direction;
use bake_runtime::oracle::OracleSample;
use bake_runtime::spec::DISK_HEIGHT_MIN;
use bake_runtime::{Material, Network, Rng, oracle};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

#[cfg(test)]
mod tests;

/// Random queries against the f64 oracle.
const QUERIES: usize = 1 << 14;
/// Largest polar angle of the queries, degrees.
const THETA_MAX_DEG: f64 = 89.99;
/// Numbers u₀ as near as this to the share of the first chart are left out: the answer jumps there, and rounding decides
/// which side of the jump is taken.
const SHARE_MARGIN: f64 = 1e-5;
/// Directions on the disk as low as this are left out. The Jacobian jumps to 0 at [`DISK_HEIGHT_MIN`] and goes as 1/z above:
/// positions that are off by δ change it by the share δ/z². Behind frequencies of 2¹¹ f32 leaves δ of some 1e-4, a quarter
/// here; behind one-blob encodings it is 1e-6.
const HEIGHT_MARGIN: f64 = 20.0 * DISK_HEIGHT_MIN;
/// Key of the queries.
const KEY: u64 = 0x9a12;

/// Columns of an answer: wi and weight of the learned estimator, wi and jacobian of the exact one, f_cos, pdf.
const OUTPUTS: usize = 14;

/// Largest differences between ways to run the networks, as |a − b| / max(1, |b|).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Parity {
    /// onnxruntime against native.
    pub ort_vs_native_max: Option<f64>,
    /// Native against the f64 oracle.
    pub native_vs_f64_max: f64,
    /// onnxruntime against the f64 oracle.
    pub ort_vs_f64_max: Option<f64>,
}

/// Inputs of all three networks, structure of arrays.
struct Queries {
    params: Vec<Vec<f32>>,
    wo: [Vec<f32>; 3],
    u: [Vec<f32>; 2],
    wi: [Vec<f32>; 3],
}

impl Queries {
    fn new(material: &Material) -> Queries {
        let mut rng = Rng::new(&[KEY]);
        let free = material.free();
        let mut q = Queries {
            params: vec![Vec::with_capacity(QUERIES); free.len()],
            wo: Default::default(),
            u: Default::default(),
            wi: Default::default(),
        };
        let draw = |rng: &mut Rng| direction(THETA_MAX_DEG * rng.uniform(), 360.0 * rng.uniform());
        for _ in 0..QUERIES {
            for (column, (label, min, max)) in q.params.iter_mut().zip(&free) {
                column.push(value_at(label, *min, *max, rng.uniform()) as f32);
            }
            let (wo, wi) = (draw(&mut rng), draw(&mut rng));
            for c in 0..3 {
                q.wo[c].push(wo[c] as f32);
                q.wi[c].push(wi[c] as f32);
            }
            // Multiples of 2⁻²⁴, as a renderer's f32 uniforms are.
            q.u.iter_mut()
                .for_each(|u| u.push((rng.bits() >> 40) as f32 * (1.0 / (1u64 << 24) as f32)));
        }
        q
    }

    fn run(&self, backend: &dyn Backend) -> Result<Vec<Vec<f32>>> {
        let mut out = vec![vec![0.0; QUERIES]; OUTPUTS];
        let [x, y, z, r, g, b, jx, jy, jz, jacobian, er, eg, eb, pdf] = &mut out[..] else {
            unreachable!()
        };
        let params: Vec<&[f32]> = self.params.iter().map(Vec::as_slice).collect();
        let points = points(&params, &self.wo);
        let (u, wi) = (views(&self.u), views(&self.wi));
        backend.sample_learned(points, u, [x, y, z], [r, g, b])?;
        backend.sample_jacobian(points, u, [jx, jy, jz], jacobian)?;
        backend.eval(points, wi, [er, eg, eb])?;
        backend.pdf(points, wi, pdf)?;
        Ok(out)
    }

    /// The oracle's answer to query `i`; `None` next to a jump.
    fn truth(&self, material: &BakedMaterial, i: usize) -> Option<[f64; OUTPUTS]> {
        let three = |c: &[Vec<f32>; 3]| c.each_ref().map(|c| f64::from(c[i]));
        let params: Vec<f64> = self.params.iter().map(|c| c[i].into()).collect();
        let (wo, wi) = (three(&self.wo), three(&self.wi));
        let u = self.u.each_ref().map(|c| f64::from(c[i]));
        let network = &material.sample;
        let drawn = oracle::sample(network, &params, wo, u);
        let jumps = is_next_to_a_jump(network, &params, wo, u, &drawn);
        let mut answer = [0.0; OUTPUTS];
        answer[..3].copy_from_slice(&drawn.wi);
        answer[3..6].copy_from_slice(&drawn.weight);
        answer[6..9].copy_from_slice(&drawn.wi);
        answer[9] = oracle::jacobian(&drawn, &material.pdf, &params, wo);
        answer[10..13].copy_from_slice(&oracle::eval(&material.eval, &params, wo, wi));
        answer[13] = oracle::pdf(&material.pdf, &params, wo, wi).0;
        (!jumps).then_some(answer)
    }
}

/// Whether rounding may take the sample `drawn` for `params`, `wo` and `u` to another chart, or past the rim of the disk.
pub fn is_next_to_a_jump(
    network: &Network,
    params: &[f64],
    wo: [f64; 3],
    u: [f64; 2],
    drawn: &OracleSample,
) -> bool {
    let (folded, _) = oracle::fold(network.spec.symmetry, wo);
    match &oracle::charts_of(network, params, folded)[..] {
        [(first, _), _] => (u[0] - first).abs() < SHARE_MARGIN,
        [] => drawn.wi[2] < HEIGHT_MARGIN,
        _ => false,
    }
}

/// |a − b| / max(1, |b|); what is no finite number is as far off as can be.
pub fn difference(a: f32, b: f64) -> f64 {
    let difference = (f64::from(a) - b).abs() / b.abs().max(1.0);
    if difference.is_finite() {
        difference
    } else {
        f64::MAX
    }
}

/// Largest [`difference`] of the queries that have an answer; b gives output c of query i.
fn largest(a: &[Vec<f32>], truth: &[Option<[f64; OUTPUTS]>], b: impl Fn(usize, usize) -> f64) -> f64 {
    let answered = (0..QUERIES).filter(|i| truth[*i].is_some());
    let differences = answered.flat_map(|i| {
        let b = &b;
        let columns = a.iter().enumerate();
        columns.map(move |(c, column)| difference(column[i], b(c, i)))
    });
    differences.fold(0.0, f64::max)
}

/// Measures the three differences; those with onnxruntime are `None` without it.
///
/// # Errors
/// Whatever a backend reports.
pub(super) fn parity(material: &BakedMaterial, runners: &Runners) -> Result<Parity> {
    let q = Queries::new(&material.sample.spec.material);
    let truth: Vec<_> = (0..QUERIES)
        .into_par_iter()
        .map(|i| q.truth(material, i))
        .collect();
    let exact = |c: usize, i: usize| truth[i].map_or(f64::NAN, |answer| answer[c]);
    let native = q.run(runners.native)?;
    let ort = runners.ort.map(|ort| q.run(ort)).transpose()?;
    Ok(Parity {
        ort_vs_native_max: ort
            .as_ref()
            .map(|o| largest(o, &truth, |c, i| native[c][i].into())),
        native_vs_f64_max: largest(&native, &truth, exact),
        ort_vs_f64_max: ort.as_ref().map(|o| largest(o, &truth, exact)),
    })
}
