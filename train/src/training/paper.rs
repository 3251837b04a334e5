//! The losses of the paper (*BSDF Importance Baking*, §5.2) with their gradients, on plain slices.
//!
//! Every norm is a sum over the outputs of one sample, as the text has it, and every loss the mean over samples.
//! Predictions are what the heads give, after their sigmoid or exponential. Where a prediction hits its target,
//! the gradient of the distance is 0. Targets are not negative; a prediction at or below −1 has no logarithm, and the
//! loss is not finite then, which stops a run.

/// ε in the divisor of [`smape`].
const SMAPE_EPSILON: f64 = 0.01;
/// λ, the share of the weights in [`sampling`].
const WEIGHT_SHARE: f64 = 0.4;
/// Outputs of the evaluation network: RGB.
const CHANNELS: usize = 3;
/// Outputs of the sampling network that say where: the incident direction on the disk.
const POSITIONS: usize = 2;
/// Outputs of the sampling network: position, then weight RGB.
const SAMPLE_OUTPUTS: usize = POSITIONS + CHANNELS;

/// The evaluation network's loss: ‖p − g‖₁ / (sg‖p‖₁ + sg‖g‖₁ + ε) per RGB sample, where no gradient flows through
/// sg (symmetric mean absolute percentage error).
///
/// `prediction`, `target` and `gradient` are rows `[samples][3]` of f_cos; the gradient by the prediction is written
/// to `gradient`.
pub fn smape(prediction: &[f32], target: &[f32], gradient: &mut [f32]) -> f64 {
    let share = 1.0 / (prediction.len() / CHANNELS) as f64;
    let rows = prediction
        .chunks_exact(CHANNELS)
        .zip(target.chunks_exact(CHANNELS))
        .zip(gradient.chunks_exact_mut(CHANNELS));
    let mut sum = 0.0;
    for ((p, g), slope) in rows {
        let norm = |v: &[f32]| v.iter().map(|x| f64::from(x.abs())).sum::<f64>();
        let scale = share / (norm(p) + norm(g) + SMAPE_EPSILON);
        for ((p, g), s) in p.iter().zip(g).zip(slope) {
            sum += distance(*p, *g, scale, s);
        }
    }
    sum
}

/// The pdf network's loss: |log(1 + p) − log(1 + g)|.
///
/// `prediction`, `target` and `gradient` hold one density per sample; the gradient by the prediction is written to
/// `gradient`.
pub fn log_l1(prediction: &[f32], target: &[f32], gradient: &mut [f32]) -> f64 {
    let share = 1.0 / prediction.len() as f64;
    let rows = prediction.iter().zip(target).zip(gradient);
    rows.map(|((p, g), s)| log_distance(*p, *g, share, s)).sum()
}

/// The sampling network's loss: ‖ω̂ − ω‖₁ of the position plus λ·‖log(1 + ŵ) − log(1 + w)‖₁ of the weight.
///
/// `prediction`, `target` and `gradient` are rows `[samples][5]`: the incident direction on the disk, then the
/// weight RGB; the gradient by the prediction is written to `gradient`.
pub fn sampling(prediction: &[f32], target: &[f32], gradient: &mut [f32]) -> f64 {
    let share = 1.0 / (prediction.len() / SAMPLE_OUTPUTS) as f64;
    let mut sum = 0.0;
    for (i, ((p, g), s)) in prediction.iter().zip(target).zip(gradient).enumerate() {
        sum += if i % SAMPLE_OUTPUTS < POSITIONS {
            distance(*p, *g, share, s)
        } else {
            log_distance(*p, *g, share * WEIGHT_SHARE, s)
        };
    }
    sum
}

/// `scale`·|p − g| and its slope.
fn distance(p: f32, g: f32, scale: f64, slope: &mut f32) -> f64 {
    let difference = f64::from(p) - f64::from(g);
    *slope = (scale * sign(difference)) as f32;
    scale * difference.abs()
}

/// `scale`·|log(1 + p) − log(1 + g)| and its slope.
fn log_distance(p: f32, g: f32, scale: f64, slope: &mut f32) -> f64 {
    let (p, g) = (f64::from(p), f64::from(g));
    // One logarithm of the quotient, which keeps its digits where p and g are near each other.
    let difference = ((p - g) / (1.0 + g)).ln_1p();
    *slope = (scale * sign(difference) / (1.0 + p)) as f32;
    scale * difference.abs()
}

/// The sign, 0 for 0.
fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::Rng;
    use candle_core::{Device, Result, Tensor, Var};

    /// Samples compared.
    const SAMPLES: usize = 200;
    /// candle computes in f32: relative to the loss, and to the largest element of the gradient.
    const CANDLE_TOL: f64 = 2e-6;

    type Loss = fn(&[f32], &[f32], &mut [f32]) -> f64;
    type Oracle = fn(&Tensor, &Tensor) -> Result<Tensor>;

    fn log_l1_of(p: &Tensor, g: &Tensor) -> Result<Tensor> {
        ((p + 1.0)?.log()? - (g + 1.0)?.log()?)?.abs()?.sum(1)
    }

    const CASES: [(&str, usize, Loss, Oracle); 3] = [
        ("smape", CHANNELS, smape, |p, g| {
            let norms = (p.abs()?.sum(1)? + g.abs()?.sum(1)?)?;
            ((p - g)?.abs()?.sum(1)? / (norms + 0.01)?.detach())?.mean_all()
        }),
        ("log_l1", 1, log_l1, |p, g| log_l1_of(p, g)?.mean_all()),
        ("sampling", SAMPLE_OUTPUTS, sampling, |p, g| {
            let position = (p.narrow(1, 0, 2)? - g.narrow(1, 0, 2)?)?.abs()?.sum(1)?;
            let weight = log_l1_of(&p.narrow(1, 2, 3)?, &g.narrow(1, 2, 3)?)?;
            (position + (weight * 0.4)?)?.mean_all()
        }),
    ];

    /// Positive numbers over six decades, as densities are.
    fn numbers(width: usize, key: u64) -> Vec<f32> {
        let mut rng = Rng::new(&[61, key]);
        (0..SAMPLES * width)
            .map(|_| 10f32.powf(6.0 * rng.uniform() as f32 - 4.0))
            .collect()
    }

    #[test]
    fn values_and_gradients_are_those_of_autograd() -> Result<()> {
        for (name, width, loss, oracle) in CASES {
            let (p, g) = (numbers(width, 1), numbers(width, 2));
            let mut gradient = vec![f32::NAN; p.len()];
            let value = loss(&p, &g, &mut gradient);
            let shape = (SAMPLES, width);
            let prediction = Var::from_vec(p, shape, &Device::Cpu)?;
            let truth = oracle(&prediction, &Tensor::from_vec(g, shape, &Device::Cpu)?)?;
            let slopes = truth.backward()?;
            let slopes = slopes.get(&prediction).expect("the loss depends on it");
            let slopes = slopes.flatten_all()?.to_vec1::<f32>()?;
            let truth = f64::from(truth.to_scalar::<f32>()?);
            assert!(
                (value - truth).abs() < CANDLE_TOL * truth,
                "{name}: {value} {truth}"
            );
            let largest = slopes.iter().fold(0f32, |m, s| m.max(s.abs()));
            for (found, expected) in gradient.iter().zip(&slopes) {
                let allowed = CANDLE_TOL as f32 * largest;
                assert!((found - expected).abs() <= allowed, "{name}: {found} {expected}");
            }
        }
        Ok(())
    }

    #[test]
    fn smape_of_one_sample_by_hand() {
        let mut gradient = [0.0; 3];
        let value = smape(&[1.0, 2.0, 0.5], &[1.5, 2.0, 0.0], &mut gradient);
        assert!((value - 1.0 / 7.01).abs() < 1e-15);
        // The norms are held fixed: only the numerator has a slope, and none where the channel is met.
        let slope = (1.0 / 7.01) as f32;
        assert_eq!(gradient, [-slope, 0.0, slope]);
    }

    #[test]
    fn losses_at_their_target_are_zero_and_flat() {
        for (name, width, loss, _) in CASES {
            let p = numbers(width, 3);
            let mut gradient = vec![f32::NAN; p.len()];
            assert_eq!(loss(&p, &p, &mut gradient), 0.0, "{name}");
            assert!(gradient.iter().all(|s| *s == 0.0), "{name}");
        }
    }

    #[test]
    fn a_logarithm_of_nothing_is_not_finite() {
        let mut gradient = [0.0];
        for p in [-1.0, -1.5, f32::NAN] {
            assert!(!log_l1(&[p], &[1.0], &mut gradient).is_finite(), "{p}");
        }
    }
}
