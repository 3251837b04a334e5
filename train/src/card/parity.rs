//! Agreement of backends with each other and with the f64 oracle, over random queries.

use super::Parity;
use super::measure::BackendFactory;
use crate::error::Result;
use bake_runtime::backend::{Backend, BakedMaterial};
use bake_runtime::bsdf::direction;
use bake_runtime::{Points, Rng, oracle};
use rayon::prelude::*;

/// Random queries against the f64 oracle.
const QUERIES: usize = 1 << 14;
/// Largest polar angle of the queries, degrees.
const THETA_MAX_DEG: f64 = 89.99;
/// Key of the queries.
const KEY: u64 = 0x9a12;

/// Inputs of all three networks, structure of arrays.
struct Queries {
    wo: [Vec<f32>; 3],
    u: [Vec<f32>; 2],
    wi: [Vec<f32>; 3],
}

/// All outputs of one backend, column after column.
type Outputs = Vec<Vec<f32>>;

fn queries() -> Queries {
    let mut rng = Rng::new(&[KEY]);
    let mut q = Queries {
        wo: Default::default(),
        u: Default::default(),
        wi: Default::default(),
    };
    let draw = |rng: &mut Rng| direction(THETA_MAX_DEG * rng.uniform(), 360.0 * rng.uniform());
    for _ in 0..QUERIES {
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

fn run(backend: &mut dyn Backend, q: &Queries) -> Result<Outputs> {
    let mut out: Outputs = vec![vec![0.0; QUERIES]; 14];
    let [x, y, z, r, g, b, jx, jy, jz, jacobian, er, eg, eb, pdf] = &mut out[..] else {
        unreachable!()
    };
    let wo = q.wo.each_ref().map(|c| c.as_slice());
    let u = q.u.each_ref().map(|c| c.as_slice());
    let wi = q.wi.each_ref().map(|c| c.as_slice());
    backend.sample_learned(Points::fixed(wo), u, [x, y, z], [r, g, b])?;
    backend.sample_jacobian(Points::fixed(wo), u, [jx, jy, jz], jacobian)?;
    backend.eval(Points::fixed(wo), wi, [er, eg, eb])?;
    backend.pdf(Points::fixed(wo), wi, pdf)?;
    Ok(out)
}

fn run_oracle(material: &BakedMaterial, q: &Queries) -> Vec<[f64; 14]> {
    let at = |i: usize| {
        let three = |c: &[Vec<f32>; 3]| [c[0][i], c[1][i], c[2][i]].map(f64::from);
        let (wo, wi) = (three(&q.wo), three(&q.wi));
        let s = oracle::sample(&material.sample, &[], wo, [q.u[0][i], q.u[1][i]].map(f64::from));
        let e = oracle::eval(&material.eval, &[], wo, wi);
        let p = oracle::pdf(&material.pdf, &[], wo, wi).0;
        let [x, y, z] = s.wi;
        let [r, g, b] = s.weight;
        [
            x,
            y,
            z,
            r,
            g,
            b,
            x,
            y,
            z,
            oracle::jacobian(&s, &material.pdf, &[], wo),
            e[0],
            e[1],
            e[2],
            p,
        ]
    };
    (0..QUERIES).into_par_iter().map(at).collect()
}

/// Largest |a − b| / max(1, |b|).
fn largest(a: &Outputs, b: impl Fn(usize, usize) -> f64) -> f64 {
    let pairs = a
        .iter()
        .enumerate()
        .flat_map(|(c, column)| column.iter().enumerate().map(move |(i, v)| (c, i, *v)));
    pairs
        .map(|(c, i, v)| (f64::from(v) - b(c, i)).abs() / b(c, i).abs().max(1.0))
        .fold(0.0, f64::max)
}

/// Measures the three differences; those with onnxruntime are `None` without it.
///
/// # Errors
/// Whatever a backend reports.
pub fn parity(
    material: &BakedMaterial,
    native: BackendFactory,
    ort: Option<BackendFactory>,
) -> Result<Parity> {
    let q = queries();
    let truth = run_oracle(material, &q);
    let native = run(native()?.as_mut(), &q)?;
    let ort = ort.map(|make| run(make()?.as_mut(), &q)).transpose()?;
    Ok(Parity {
        ort_vs_native_max: ort.as_ref().map(|o| largest(o, |c, i| native[c][i].into())),
        native_vs_f64_max: largest(&native, |c, i| truth[i][c]),
        ort_vs_f64_max: ort.as_ref().map(|o| largest(o, |c, i| truth[i][c])),
    })
}
