//! Dense layers alone, on every tier: exact where every sum is, and within what the theory of rounding allows elsewhere.

use bake_runtime::native::{Layers, Tier};
use bake_runtime::spec::Activation;
use bake_runtime::{Dense, Rng};

/// Widths that meet every tail of vectors, panels and blocks of rows.
const WIDTHS: [usize; 12] = [1, 2, 3, 5, 7, 15, 16, 17, 31, 33, 64, 128];
/// Batches of a single query to all tails of a tile, and of several tiles.
const BATCHES: [usize; 23] = [
    1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 64, 65, 200,
];
/// Integers below this in magnitude are f32, and so are their sums and products that stay below it.
const EXACT: i64 = 1 << 24;
/// Unit roundoff of f32.
const ROUNDOFF: f64 = 1.0 / (1u64 << 24) as f64;
/// Largest magnitude of an integer weight, bias or input.
const INTEGER: i64 = 3;

/// Layers of these widths, of integers that are f32.
fn integer_layers(widths: &[usize], rng: &mut Rng) -> Vec<Dense> {
    let layer = |pair: &[usize]| Dense {
        weight: (0..pair[0] * pair[1]).map(|_| integer(rng) as f32).collect(),
        bias: (0..pair[1]).map(|_| integer(rng) as f32).collect(),
        inputs: pair[0],
        outputs: pair[1],
    };
    widths.windows(2).map(layer).collect()
}

fn integer(rng: &mut Rng) -> i64 {
    (rng.bits() % (2 * INTEGER as u64 + 1)) as i64 - INTEGER
}

/// What `layers` make of `input` in integers, with rectifiers between them.
fn in_integers(layers: &[Dense], input: &[i64]) -> Vec<i64> {
    let mut values = input.to_vec();
    for (i, layer) in layers.iter().enumerate() {
        let rows = layer.weight.chunks_exact(layer.inputs).zip(&layer.bias);
        let sums = rows.map(|(weights, bias)| {
            let products = weights.iter().zip(&values).map(|(w, x)| *w as i64 * x);
            let sizes: i64 = products.clone().map(i64::abs).sum();
            assert!(
                sizes + INTEGER < EXACT,
                "the test's own numbers leave the integers of f32"
            );
            products.sum::<i64>() + *bias as i64
        });
        let last = i + 1 == layers.len();
        values = sums.map(|sum| if last { sum } else { sum.max(0) }).collect();
    }
    values
}

/// Runs `layers` on queries, each a row.
fn run(layers: &[Dense], tier: Tier, queries: &[Vec<f32>]) -> Vec<Vec<f32>> {
    let packed = Layers::new(layers, Activation::Relu, tier).expect("the tier is available, and layers fit");
    let outputs = layers.last().expect("there are layers").outputs;
    let columns: Vec<Vec<f32>> = (0..layers[0].inputs)
        .map(|c| queries.iter().map(|row| row[c]).collect())
        .collect();
    let columns: Vec<&[f32]> = columns.iter().map(Vec::as_slice).collect();
    let mut out = vec![vec![f32::NAN; queries.len()]; outputs];
    let mut slices: Vec<&mut [f32]> = out.iter_mut().map(Vec::as_mut_slice).collect();
    packed.run(&columns, &mut slices).expect("equal lengths");
    (0..queries.len())
        .map(|i| out.iter().map(|column| column[i]).collect())
        .collect()
}

fn assert_exact(widths: &[usize], batch: usize, rng: &mut Rng) {
    let layers = integer_layers(widths, rng);
    let queries: Vec<Vec<i64>> = (0..batch)
        .map(|_| (0..widths[0]).map(|_| integer(rng)).collect())
        .collect();
    let expected: Vec<Vec<i64>> = queries.iter().map(|row| in_integers(&layers, row)).collect();
    let queries: Vec<Vec<f32>> = queries
        .iter()
        .map(|row| row.iter().map(|x| *x as f32).collect())
        .collect();
    for tier in Tier::available() {
        for (i, (found, expected)) in run(&layers, tier, &queries).iter().zip(&expected).enumerate() {
            let found: Vec<f64> = found.iter().map(|v| f64::from(*v)).collect();
            let expected: Vec<f64> = expected.iter().map(|v| *v as f64).collect();
            assert_eq!(
                found, expected,
                "{tier:?}, widths {widths:?}, query {i} of {batch}"
            );
        }
    }
}

#[test]
fn sums_of_small_integers_are_exact() {
    let mut rng = Rng::new(&[0x17e6]);
    // Every pair of widths in one layer, then batches of all sizes between two hidden layers.
    for inputs in WIDTHS {
        for outputs in WIDTHS {
            for batch in [1, 17, 65] {
                assert_exact(&[inputs, outputs], batch, &mut rng);
            }
        }
    }
    for batch in BATCHES {
        for (i, width) in WIDTHS.into_iter().enumerate() {
            let [before, after] = [i + 5, i + 8].map(|i| WIDTHS[i % WIDTHS.len()]);
            assert_exact(&[before, width, after], batch, &mut rng);
        }
        assert_exact(&[5, 16, 7, 3], batch, &mut rng);
        assert_exact(&[3, 7, 5, 2, 1], batch, &mut rng);
    }
}

/// Any order of n additions, fused or not, is off by at most γ_n·Σ|w·x| with γ_n = n·u/(1 − n·u) (Higham 2002, §3.1), and the
/// bias is one more term.
#[test]
fn sums_of_any_numbers_are_within_the_bound_of_their_length() {
    let mut rng = Rng::new(&[0x6a3a]);
    let mut worst = 0.0f64;
    for inputs in WIDTHS {
        for (outputs, batch) in [(1, 65), (17, 7), (33, 200), (64, 1), (7, 20), (128, 16)] {
            // Sizes over six decades, so that sums cancel and swallow.
            let mut number = || ((2.0 * rng.uniform() - 1.0) * 10f64.powf(6.0 * rng.uniform() - 3.0)) as f32;
            let layer = Dense {
                weight: (0..inputs * outputs).map(|_| number()).collect(),
                bias: (0..outputs).map(|_| number()).collect(),
                inputs,
                outputs,
            };
            let queries: Vec<Vec<f32>> = (0..batch)
                .map(|_| (0..inputs).map(|_| number()).collect())
                .collect();
            let terms = (inputs + 1) as f64;
            let gamma = terms * ROUNDOFF / (1.0 - terms * ROUNDOFF);
            for tier in Tier::available() {
                let found = run(std::slice::from_ref(&layer), tier, &queries);
                for (found, query) in found.iter().zip(&queries) {
                    let rows = layer.weight.chunks_exact(inputs).zip(&layer.bias);
                    for ((weights, bias), found) in rows.zip(found) {
                        let products = weights.iter().zip(query);
                        let products = products.map(|(w, x)| f64::from(*w) * f64::from(*x));
                        let sum = products.clone().sum::<f64>() + f64::from(*bias);
                        let sizes = products.map(f64::abs).sum::<f64>() + f64::from(bias.abs());
                        let share = (f64::from(*found) - sum).abs() / (gamma * sizes);
                        assert!(
                            share <= 1.0,
                            "{tier:?}, {inputs} × {outputs}, batch of {batch}: {found} instead of {sum}, {share:.2} bounds"
                        );
                        worst = worst.max(share);
                    }
                }
            }
        }
    }
    eprintln!("largest error of a sum: {worst:.3} of its bound");
}
