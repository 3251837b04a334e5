//! The fused training kernel against candle's autograd, finite differences, and itself on other threads.

use bake_runtime::Rng;
use bake_runtime::simd::{Simd, Tier};
use bake_train::fused::{Features, Fused, FusedLoss, Nonlinearity, Outputs, OutputsMut, Shape, TileLoss};
use candle_core::{D, DType, Device, Result, Tensor, Var};
use std::ops::Range;
use std::sync::{Arc, Mutex};

/// Gradients of a tensor agree to this, relative to the largest of them.
const GRADIENT_TOL: f64 = 1e-5;
/// Losses and outputs, sums of f32 products, agree to this, relative to the largest.
const VALUE_TOL: f64 = 5e-6;
/// Central differences in f64 with steps of [`STEP`]: their error is its square times third derivatives.
const DIFFERENCE_TOL: f64 = 1e-5;
/// Step of the differences.
const STEP: f64 = 1e-4;
/// Range of features and weights.
const SPREAD: f64 = 1.2;

/// Queries with features and coefficients, and a loss with every product of values and tangents.
///
/// With t = Σ k·y over all outputs and columns, the loss of a query is ½t², plus, with its tangents,
/// y_0·(∂₀y_0·∂₁y_1 − ∂₀y_1·∂₁y_0) where there are two.
#[derive(Clone)]
struct Problem {
    inputs: usize,
    outputs: usize,
    columns: usize,
    queries: usize,
    /// `[columns][queries][inputs]`.
    features: Arc<Vec<f32>>,
    /// k `[columns][queries][outputs]`.
    coefficients: Arc<Vec<f32>>,
}

fn random(rng: &mut Rng, count: usize) -> Vec<f32> {
    (0..count)
        .map(|_| (SPREAD * (2.0 * rng.uniform() - 1.0)) as f32)
        .collect()
}

impl Problem {
    fn new(shape: &Shape, columns: usize, queries: usize, rng: &mut Rng) -> Problem {
        let (inputs, outputs) = (shape.inputs(), shape.outputs());
        Problem {
            inputs,
            outputs,
            columns,
            queries,
            features: Arc::new(random(rng, columns * queries * inputs)),
            coefficients: Arc::new(random(rng, columns * queries * outputs)),
        }
    }

    fn coefficient(&self, column: usize, query: usize, output: usize) -> f32 {
        self.coefficients[(column * self.queries + query) * self.outputs + output]
    }

    /// The mean loss of candle's `outputs` `[columns·queries, outputs]`.
    fn plain(&self, outputs: &Tensor) -> Result<Tensor> {
        let (n, shape) = (self.queries, (self.columns * self.queries, self.outputs));
        let k = Tensor::from_slice(&self.coefficients, shape, &Device::Cpu)?.to_dtype(DType::F64)?;
        let t = (outputs * k)?
            .sum(D::Minus1)?
            .reshape((self.columns, n))?
            .sum(0)?;
        let loss = (t.sqr()? * 0.5)?;
        if self.columns != 3 {
            return loss.mean_all();
        }
        let y = |column: usize, output: usize| outputs.narrow(0, column * n, n)?.get_on_dim(1, output);
        let det = ((y(1, 0)? * y(2, 1)?)? - (y(1, 1)? * y(2, 0)?)?)?;
        (loss + (y(0, 0)? * det)?)?.mean_all()
    }
}

impl TileLoss for Problem {
    #[inline(always)]
    fn features<S: Simd>(&self, _: S, queries: Range<usize>, rows: &mut Features) {
        for column in 0..self.columns {
            for (i, query) in queries.clone().enumerate() {
                let start = (column * self.queries + query) * self.inputs;
                rows.row(column, i)
                    .copy_from_slice(&self.features[start..start + self.inputs]);
            }
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
        let mut sum = 0.0;
        for (i, query) in queries.enumerate() {
            let y = |column: usize, output: usize| outputs.plane(column, output)[i];
            let each = || (0..self.columns).flat_map(|c| (0..self.outputs).map(move |o| (c, o)));
            let t: f32 = each().map(|(c, o)| self.coefficient(c, query, o) * y(c, o)).sum();
            for (c, o) in each() {
                gradient.plane(c, o)[i] = t * self.coefficient(c, query, o);
            }
            sum += f64::from(0.5 * t * t);
            if self.columns == 3 {
                let det = y(1, 0) * y(2, 1) - y(1, 1) * y(2, 0);
                sum += f64::from(y(0, 0) * det);
                gradient.plane(0, 0)[i] += det;
                gradient.plane(1, 0)[i] += y(0, 0) * y(2, 1);
                gradient.plane(2, 1)[i] += y(0, 0) * y(1, 0);
                gradient.plane(1, 1)[i] -= y(0, 0) * y(2, 0);
                gradient.plane(2, 0)[i] -= y(0, 0) * y(1, 1);
            }
        }
        sum
    }
}

/// Outputs `[columns·queries, outputs]` of plain candle operations in f64, and (weight, bias) of each layer.
fn plain_network(
    shape: &Shape,
    parameters: &[f32],
    features: &[f32],
    columns: usize,
) -> Result<(Tensor, Vec<Var>)> {
    let tensor = |numbers: &[f32], shape: &[usize]| {
        Tensor::from_slice(numbers, shape, &Device::Cpu)?.to_dtype(DType::F64)
    };
    let rows = features.len() / shape.inputs();
    let queries = rows / columns;
    let mut x = tensor(features, &[rows, shape.inputs()])?;
    let mut vars = Vec::new();
    let mut rest = parameters;
    let last = shape.layers().len() - 1;
    for (i, (inputs, outputs)) in shape.layers().enumerate() {
        let (weight, after) = rest.split_at(inputs * outputs);
        let (bias, after) = after.split_at(outputs);
        rest = after;
        let weight = Var::from_tensor(&tensor(weight, &[outputs, inputs])?)?;
        let bias = Var::from_tensor(&tensor(bias, &[outputs])?)?;
        let z = x.matmul(&weight.t()?)?;
        let value = z.narrow(0, 0, queries)?.broadcast_add(&bias)?;
        let (y, slope) = match shape.nonlinearity() {
            _ if i == last => (value.clone(), value.ones_like()?),
            Nonlinearity::Relu => (value.relu()?, value.ge(0.0)?.to_dtype(DType::F64)?),
            Nonlinearity::Silu => {
                // candle_nn's sigmoid is one operation with its own gradient; this one is plain.
                let sigma = (value.neg()?.exp()? + 1.0)?.recip()?;
                let slope = (&sigma * ((&value * (1.0 - &sigma)?)? + 1.0)?)?;
                ((&value * sigma)?, slope)
            }
        };
        let tangents = (1..columns).map(|t| z.narrow(0, t * queries, queries)? * &slope);
        let blocks = std::iter::once(Ok(y))
            .chain(tangents)
            .collect::<Result<Vec<_>>>()?;
        x = Tensor::cat(&blocks, 0)?;
        vars.extend([weight, bias]);
    }
    Ok((x, vars))
}

/// The largest difference of `found` from `expected`, relative to the largest of `expected`.
fn error(found: &[f32], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let largest = expected.iter().fold(0.0f64, |m, e| m.max(e.abs()));
    let pairs = found.iter().zip(expected);
    pairs.map(|(f, e)| (f64::from(*f) - e).abs()).fold(0.0, f64::max) / largest
}

fn flat(tensor: &Tensor) -> Result<Vec<f64>> {
    tensor.flatten_all()?.to_vec1()
}

/// Widths that fill no vector and no block, and the networks we train.
const WIDTHS: [&[usize]; 5] = [
    &[5, 7, 24, 3],
    &[32, 64, 64, 5],
    &[3, 33, 2],
    &[4, 5],
    &[2, 129, 37, 41, 6],
];

/// (columns, queries) that fill no tile and no shard, up to more columns than a tile has rows.
const CASES: [(usize, usize); 8] = [
    (1, 1),
    (1, 97),
    (1, 801),
    (2, 50),
    (3, 1),
    (3, 71),
    (3, 300),
    (400, 3),
];

#[test]
fn losses_and_gradients_are_those_of_candle() -> Result<()> {
    let mut rng = Rng::new(&[11]);
    for widths in WIDTHS {
        for nonlinearity in [Nonlinearity::Silu, Nonlinearity::Relu] {
            for (columns, queries) in CASES {
                let shape = Shape::new(widths.to_vec(), nonlinearity).expect("valid widths");
                let parameters = random(&mut rng, shape.parameters());
                // Small enough that every layer's numbers stay near 1.
                let scale = 1.0 / (*widths.iter().max().expect("not empty") as f32).sqrt();
                let parameters: Vec<f32> = parameters.iter().map(|p| 2.0 * scale * p).collect();
                let problem = Problem::new(&shape, columns, queries, &mut rng);
                let (outputs, vars) = plain_network(&shape, &parameters, &problem.features, columns)?;
                let plain = problem.plain(&outputs)?;
                let store = plain.backward()?;
                let plain = plain.to_scalar::<f64>()?;
                let size = flat(&outputs)?.iter().fold(1.0f64, |m, y| m.max(y.abs()));
                // Of a sum of squares, and of the product of three outputs, which may cancel.
                let size = plain.abs().max(size.powi(3));
                for tier in Tier::available() {
                    let case = format!("{tier:?} {shape:?} {columns} columns of {queries}");
                    let mut fused = Fused::new(tier, shape.clone(), columns).expect("an available tier");
                    let (value, gradient) = fused.step(&parameters, queries, &problem).expect(&case);
                    assert!(
                        (value - plain).abs() <= VALUE_TOL * size,
                        "{case}: {value}, not {plain}"
                    );
                    let mut rest = &gradient[..];
                    for (i, var) in vars.iter().enumerate() {
                        let (part, after) = rest.split_at(var.elem_count());
                        rest = after;
                        let found = error(part, &flat(store.get(var).expect("used"))?);
                        assert!(found <= GRADIENT_TOL, "{case}, parameter {i}: {found:e}");
                    }
                    let rows = fused.forward(&parameters, &problem.features).expect(&case);
                    let found = error(&rows, &flat(&outputs)?);
                    assert!(found <= VALUE_TOL, "{case}: outputs differ by {found:e}");
                }
            }
        }
    }
    Ok(())
}

#[test]
fn gradients_are_finite_differences_of_the_loss() -> Result<()> {
    let mut rng = Rng::new(&[12]);
    let shape = Shape::new(vec![3, 4, 4, 2], Nonlinearity::Silu).expect("valid widths");
    let (columns, queries) = (3, 5);
    let parameters = random(&mut rng, shape.parameters());
    let problem = Problem::new(&shape, columns, queries, &mut rng);
    let mut fused = Fused::new(Tier::best(), shape.clone(), columns).expect("the best tier");
    let (_, gradient) = fused.step(&parameters, queries, &problem).expect("valid");
    let sizes: Vec<f64> = parameters.iter().map(|p| f64::from(*p)).collect();
    let differences = (0..parameters.len()).map(|i| {
        let at = |step: f64| {
            let mut moved = sizes.clone();
            moved[i] += step;
            loss_in_f64(&problem, &moved)
        };
        (at(STEP) - at(-STEP)) / (2.0 * STEP)
    });
    let found = error(&gradient, &differences.collect::<Vec<_>>());
    assert!(found <= DIFFERENCE_TOL, "{found:e}");
    Ok(())
}

/// The mean loss of a network of widths 3, 4, 4, 2 whose tangents are themselves central differences:
/// nothing here knows a derivative.
fn loss_in_f64(problem: &Problem, parameters: &[f64]) -> f64 {
    let network = |mut x: Vec<f64>| {
        let mut rest = parameters;
        for outputs in [4, 4, 2] {
            let (weight, after) = rest.split_at(x.len() * outputs);
            let (bias, after) = after.split_at(outputs);
            rest = after;
            let z = weight.chunks_exact(x.len()).zip(bias);
            let z = z.map(|(row, b)| b + row.iter().zip(&x).map(|(w, x)| w * x).sum::<f64>());
            x = match outputs {
                4 => z.map(|z| z / (1.0 + (-z).exp())).collect(),
                _ => z.collect(),
            };
        }
        x
    };
    let mut sum = 0.0;
    for query in 0..problem.queries {
        let features = |column: usize| {
            let start = (column * problem.queries + query) * problem.inputs;
            let row = &problem.features[start..start + problem.inputs];
            row.iter().map(|f| f64::from(*f)).collect::<Vec<_>>()
        };
        let moved = |tangent: usize, step: f64| {
            let along = features(tangent);
            network(features(0).iter().zip(along).map(|(x, d)| x + step * d).collect())
        };
        let mut y = vec![network(features(0))];
        for tangent in [1, 2] {
            let (above, below) = (moved(tangent, STEP), moved(tangent, -STEP));
            y.push(
                above
                    .iter()
                    .zip(below)
                    .map(|(a, b)| (a - b) / (2.0 * STEP))
                    .collect(),
            );
        }
        let each = (0..3).flat_map(|c| (0..2).map(move |o| (c, o)));
        let t: f64 = each
            .map(|(c, o)| f64::from(problem.coefficient(c, query, o)) * y[c][o])
            .sum();
        sum += 0.5 * t * t + y[0][0] * (y[1][0] * y[2][1] - y[1][1] * y[2][0]);
    }
    sum / problem.queries as f64
}

#[test]
fn results_do_not_depend_on_threads_or_on_what_ran_before() {
    let mut rng = Rng::new(&[13]);
    let shape = Shape::new(vec![9, 40, 24, 5], Nonlinearity::Silu).expect("valid widths");
    for tier in Tier::available() {
        for (columns, queries) in [(1, 5000), (3, 1501)] {
            let parameters = random(&mut rng, shape.parameters());
            let problem = Problem::new(&shape, columns, queries, &mut rng);
            let small = Problem::new(&shape, columns, 7, &mut rng);
            let run = |threads: usize, before: bool| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                pool.expect("threads").install(|| {
                    let mut fused = Fused::new(tier, shape.clone(), columns).expect("an available tier");
                    if before {
                        fused.step(&parameters, 7, &small).expect("valid");
                    }
                    let step = fused.step(&parameters, queries, &problem).expect("valid");
                    (
                        step,
                        fused.forward(&parameters, &problem.features).expect("valid"),
                    )
                })
            };
            let once = run(1, false);
            assert!(once.0.0.is_finite());
            for (threads, before) in [(1, true), (2, false), (3, true)] {
                assert!(run(threads, before) == once, "{tier:?}, {threads} threads");
            }
        }
    }
}

#[test]
fn candle_sees_one_operation_with_that_gradient() -> Result<()> {
    let mut rng = Rng::new(&[14]);
    let shape = Shape::new(vec![6, 20, 4], Nonlinearity::Silu).expect("valid widths");
    let parameters = random(&mut rng, shape.parameters());
    let problem = Problem::new(&shape, 3, 65, &mut rng);
    let fused = || Fused::new(Tier::best(), shape.clone(), 3).expect("the best tier");
    let shared = || Arc::new(Mutex::new(fused()));
    let (value, gradient) = fused().step(&parameters, 65, &problem).expect("valid");
    let var = Var::from_slice(&parameters, parameters.len(), &Device::Cpu)?;
    let loss = var
        .as_tensor()
        .apply_op1(FusedLoss::new(shared(), 65, problem.clone()))?;
    assert_eq!(loss.to_scalar::<f32>()?, value as f32);
    let store = (loss * 3.0)?.backward()?;
    let found = store.get(&var).expect("used").to_vec1::<f32>()?;
    assert!(found.iter().zip(&gradient).all(|(f, g)| *f == 3.0 * g));
    // Another number of parameters is refused.
    let short = Tensor::zeros(7, DType::F32, &Device::Cpu)?;
    let refused = short.apply_op1(FusedLoss::new(shared(), 65, problem));
    assert!(refused.is_err_and(|e| e.to_string().contains("are 7, but the network has")));
    Ok(())
}

#[test]
fn what_makes_no_sense_is_refused() {
    let shape = || Shape::new(vec![2, 3], Nonlinearity::Relu).expect("valid widths");
    for widths in [vec![], vec![3], vec![3, 0, 2]] {
        assert!(Shape::new(widths, Nonlinearity::Relu).is_err());
    }
    assert!(Fused::new(Tier::Scalar, shape(), 0).is_err());
    let mut fused = Fused::new(Tier::Scalar, shape(), 1).expect("valid");
    let problem = Problem::new(&shape(), 1, 4, &mut Rng::new(&[15]));
    assert!(fused.step(&[0.0; 9], 0, &problem).is_err());
    assert!(fused.step(&[0.0; 8], 4, &problem).is_err());
    assert!(fused.forward(&[0.0; 9], &[0.0; 3]).is_err());
    assert_eq!(fused.forward(&[0.0; 9], &[0.0; 4]).expect("valid"), [0.0; 6]);
}
