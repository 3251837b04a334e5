//! Our optimiser: Muon for hidden matrices, Adam for everything else, with a state that can be saved.
//!
//! Sources: Kingma and Ba 2015, *Adam*; Jordan et al. 2024, *Muon: An optimizer for hidden layers* (momentum,
//! orthogonalised by five steps of a quintic Newton–Schulz iteration). candle's AdamW keeps its moments to
//! itself, so a run could not be resumed with it.

/// Decay of the first moment, of Adam and of Muon's momentum.
const BETA_1: f32 = 0.9;
/// Decay of Adam's second moment.
const BETA_2: f32 = 0.999;
/// Keeps Adam's step finite where a gradient is zero.
const EPSILON: f32 = 1e-8;
/// Coefficients of the quintic iteration (Jordan et al. 2024).
const QUINTIC: [f32; 3] = [3.4445, -4.775, 2.0315];
/// Number of iterations.
const QUINTIC_STEPS: usize = 5;

/// One parameter tensor with its moments.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// `[outputs, inputs]`, or `[outputs, 1]` for a bias.
    pub shape: (usize, usize),
    /// Values, row-major.
    pub value: Vec<f32>,
    /// First moment or momentum.
    pub first: Vec<f32>,
    /// Second moment; unused by Muon.
    pub second: Vec<f32>,
    /// Whether Muon moves it.
    pub hidden: bool,
}

/// All parameters of one network.
#[derive(Clone, Debug, PartialEq)]
pub struct Optimiser {
    /// In the order of [`crate::nn::mlp::Mlp::vars`].
    pub parameters: Vec<Parameter>,
    /// Steps taken.
    pub step: u64,
}

/// c = a·b for row-major `[m, k]` and `[k, n]`.
fn product(a: &[f32], b: &[f32], (m, k, n): (usize, usize, usize)) -> Vec<f32> {
    let mut c = vec![0.0; m * n];
    for i in 0..m {
        for l in 0..k {
            let factor = a[i * k + l];
            for j in 0..n {
                c[i * n + j] += factor * b[l * n + j];
            }
        }
    }
    c
}

fn transposed(a: &[f32], rows: usize, columns: usize) -> Vec<f32> {
    (0..columns * rows)
        .map(|k| a[(k % rows) * columns + k / rows])
        .collect()
}

/// The orthogonal matrix nearest to `gradient` (rows ≤ columns after a transpose), approximately.
fn orthogonalised(gradient: &[f32], (rows, columns): (usize, usize)) -> Vec<f32> {
    let norm = gradient.iter().map(|g| g * g).sum::<f32>().sqrt() + 1e-7;
    let tall = rows > columns;
    let (m, n) = if tall { (columns, rows) } else { (rows, columns) };
    let mut x: Vec<f32> = gradient.iter().map(|g| g / norm).collect();
    if tall {
        x = transposed(&x, rows, columns);
    }
    for _ in 0..QUINTIC_STEPS {
        let gram = product(&x, &transposed(&x, m, n), (m, n, m));
        let square = product(&gram, &gram, (m, m, m));
        let mix: Vec<f32> = gram
            .iter()
            .zip(&square)
            .map(|(a, b)| QUINTIC[1] * a + QUINTIC[2] * b)
            .collect();
        let turn = product(&mix, &x, (m, m, n));
        x.iter_mut()
            .zip(&turn)
            .for_each(|(v, t)| *v = QUINTIC[0] * *v + t);
    }
    if tall { transposed(&x, m, n) } else { x }
}

impl Optimiser {
    /// Takes over `(shape, values)` of every parameter; `hidden` names those that Muon moves.
    pub fn new(parameters: Vec<((usize, usize), Vec<f32>, bool)>) -> Optimiser {
        let parameters = parameters
            .into_iter()
            .map(|(shape, value, hidden)| {
                let zeros = vec![0.0; value.len()];
                Parameter {
                    shape,
                    first: zeros.clone(),
                    second: zeros,
                    value,
                    hidden,
                }
            })
            .collect();
        Optimiser { parameters, step: 0 }
    }

    /// Moves every parameter against its gradient.
    pub fn descend(&mut self, gradients: &[Vec<f32>], rate: f32) {
        self.step += 1;
        let steps = self.step.min(i32::MAX as u64) as i32;
        let (unbias_1, unbias_2) = (1.0 / (1.0 - BETA_1.powi(steps)), 1.0 / (1.0 - BETA_2.powi(steps)));
        for (p, gradient) in self.parameters.iter_mut().zip(gradients) {
            p.first
                .iter_mut()
                .zip(gradient)
                .for_each(|(m, g)| *m = BETA_1 * *m + (1.0 - BETA_1) * g);
            if p.hidden {
                let (rows, columns) = p.shape;
                let scale = rate * (rows as f32 / columns as f32).max(1.0).sqrt();
                let step = orthogonalised(&p.first, p.shape);
                p.value.iter_mut().zip(&step).for_each(|(v, s)| *v -= scale * s);
                continue;
            }
            p.second
                .iter_mut()
                .zip(gradient)
                .for_each(|(v, g)| *v = BETA_2 * *v + (1.0 - BETA_2) * g * g);
            for ((value, m), v) in p.value.iter_mut().zip(&p.first).zip(&p.second) {
                *value -= rate * m * unbias_1 / ((v * unbias_2).sqrt() + EPSILON);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The quintic drives singular values into about [0.7, 1.2], not to 1 exactly (Jordan et al. 2024).
    const SINGULAR_RANGE: std::ops::Range<f32> = 0.6..1.3;

    #[test]
    fn orthogonalised_rows_have_about_unit_length() {
        let g: Vec<f32> = (0..12).map(|i| ((i * 7919 % 23) as f32 - 11.0) * 0.1).collect();
        for shape in [(3, 4), (4, 3)] {
            let o = orthogonalised(&g, shape);
            let o = if shape.0 > shape.1 {
                transposed(&o, shape.0, shape.1)
            } else {
                o
            };
            for row in o.chunks_exact(4) {
                let length = row.iter().map(|v| v * v).sum::<f32>().sqrt();
                assert!(SINGULAR_RANGE.contains(&length), "{length}");
            }
        }
    }

    #[test]
    fn both_rules_find_the_minimum_of_a_bowl() {
        let target = [0.5f32, -0.25, 0.75, 1.0];
        for hidden in [false, true] {
            let mut optimiser = Optimiser::new(vec![((2, 2), vec![0.0; 4], hidden)]);
            for step in 0..2000 {
                let gradient = optimiser.parameters[0]
                    .value
                    .iter()
                    .zip(&target)
                    .map(|(v, t)| v - t)
                    .collect();
                optimiser.descend(&[gradient], 0.02 * (1.0 - step as f32 / 2000.0));
            }
            let worst = optimiser.parameters[0]
                .value
                .iter()
                .zip(&target)
                .map(|(v, t)| (v - t).abs());
            assert!(worst.fold(0.0, f32::max) < 0.01);
        }
    }
}
