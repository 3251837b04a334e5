//! Queries of the materials that ship, by tier and batch: `cargo bench -p bake-runtime [FILTER]`. `bake bench` is the one to
//! report; this is for development.

use bake_runtime::native::{Layers, NativeBackend, Tier};
use bake_runtime::spec::Activation;
use bake_runtime::{Backend, BakedMaterial, Dense, Points, Rng};
use divan::Bencher;
use divan::counter::ItemsCount;
use std::path::Path;

/// Materials: the narrowest and the widest networks of our preset.
const MATERIALS: [&str; 2] = ["vase", "conductor"];
/// Queries per call.
const BATCHES: [usize; 3] = [1, 64, 4096];

fn main() {
    divan::main();
}

/// Every material, tier and batch.
fn cases() -> Vec<(&'static str, Tier, usize)> {
    let tiers = Tier::available().into_iter().filter(|tier| *tier != Tier::Scalar);
    let tiers: Vec<Tier> = tiers.collect();
    let of_material = |name| {
        let tiers = tiers.clone();
        tiers
            .into_iter()
            .flat_map(move |tier| BATCHES.map(|batch| (name, tier, batch)))
    };
    MATERIALS.into_iter().flat_map(of_material).collect()
}

/// Runs `ask` on a batch: points, u, lights, and six columns for the answers.
fn run(
    bencher: Bencher,
    (name, tier, count): (&str, Tier, usize),
    ask: impl Fn(&NativeBackend, Points, [&[f32]; 2], [&[f32]; 3], [&mut [f32]; 6]),
) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../scenes/materials")
        .join(name);
    let material = BakedMaterial::load(&folder).expect("it ships");
    let backend = NativeBackend::new(&material, tier).expect("the tier is available");
    let mut rng = Rng::new(&[1]);
    let mut uniform = || -> Vec<f32> { (0..count).map(|_| rng.uniform() as f32).collect() };
    let free = material.sample.spec.material.free();
    let params: Vec<Vec<f32>> = free
        .iter()
        .map(|(_, min, max)| {
            uniform()
                .iter()
                .map(|r| (min + (max - min) * f64::from(*r)) as f32)
                .collect()
        })
        .collect();
    let params: Vec<&[f32]> = params.iter().map(Vec::as_slice).collect();
    let z: Vec<f32> = uniform().iter().map(|r| 0.1 + 0.9 * r).collect();
    let x: Vec<f32> = z.iter().map(|z| (1.0 - z * z).max(0.0).sqrt()).collect();
    let y = vec![0.0; count];
    let (u, v) = (uniform(), uniform());
    let mut out = vec![vec![0.0f32; count]; 6];
    bencher.counter(ItemsCount::new(count)).bench_local(|| {
        let [a, b, c, d, e, f] = &mut out[..] else {
            unreachable!("six of six");
        };
        let points = Points {
            params: &params,
            wo: [&x, &y, &z],
        };
        ask(&backend, points, [&u, &v], [&x, &y, &z], [a, b, c, d, e, f]);
    });
}

#[divan::bench(args = cases())]
fn learned(bencher: Bencher, case: (&str, Tier, usize)) {
    run(bencher, case, |backend, points, u, _, [a, b, c, d, e, f]| {
        backend
            .sample_learned(points, u, [a, b, c], [d, e, f])
            .expect("lengths agree");
    });
}

#[divan::bench(args = cases())]
fn jacobian(bencher: Bencher, case: (&str, Tier, usize)) {
    run(bencher, case, |backend, points, u, _, [a, b, c, d, ..]| {
        backend
            .sample_jacobian(points, u, [a, b, c], d)
            .expect("lengths agree");
    });
}

#[divan::bench(args = cases())]
fn eval(bencher: Bencher, case: (&str, Tier, usize)) {
    run(bencher, case, |backend, points, _, wi, [a, b, c, ..]| {
        backend.eval(points, wi, [a, b, c]).expect("lengths agree");
    });
}

#[divan::bench(args = cases())]
fn exact_pdf(bencher: Bencher, case: (&str, Tier, usize)) {
    run(bencher, case, |backend, points, _, wi, [a, ..]| {
        backend.exact_pdf(points, wi, a).expect("lengths agree");
    });
}

/// Width and batch of layers alone, six of them.
#[divan::bench(args = [(64, 1), (64, 4096), (128, 1), (128, 4096)])]
fn layers(bencher: Bencher, (width, count): (usize, usize)) {
    let widths = [32, width, width, width, width, width, width, 5];
    let mut rng = Rng::new(&[2]);
    let layers: Vec<Dense> = widths
        .windows(2)
        .map(|w| Dense {
            weight: (0..w[0] * w[1]).map(|_| (rng.uniform() - 0.5) as f32).collect(),
            bias: vec![0.1; w[1]],
            inputs: w[0],
            outputs: w[1],
        })
        .collect();
    let layers = Layers::new(&layers, Activation::Relu, Tier::best()).expect("sound layers");
    let inputs: Vec<Vec<f32>> = (0..32)
        .map(|_| (0..count).map(|_| rng.uniform() as f32).collect())
        .collect();
    let inputs: Vec<&[f32]> = inputs.iter().map(Vec::as_slice).collect();
    let mut outputs = vec![vec![0.0f32; count]; 5];
    let mut outputs: Vec<&mut [f32]> = outputs.iter_mut().map(Vec::as_mut_slice).collect();
    bencher.counter(ItemsCount::new(count)).bench_local(|| {
        layers.run(&inputs, &mut outputs).expect("lengths agree");
    });
}
