//! Bias and SiLU on a value and its tangents, as one candle operation.
//!
//! The rows of the input are stacked columns: first the values, then, where the loss needs the Jacobian of the
//! network, one block of rows per tangent. With z = x + b on the value rows: value ↦ s(z), tangent ż ↦ s'(z)·ż.
//! candle would take a dozen passes over memory for this and its gradient; here it is one each.

use candle_core::{CpuStorage, CustomOp2, Layout, Result, Shape, Storage, Tensor, bail};

/// The operation; `columns` is 1 for plain values, 3 for values with two tangents.
#[derive(Clone, Copy, Debug)]
pub struct BiasSilu {
    /// Number of stacked blocks of rows.
    pub columns: usize,
}

/// e^x for training, relative error below [`EXP_RELATIVE_ERROR`] on [−87, 87], in arithmetic the compiler vectorises.
///
/// x = n·ln 2 + r with |r| ≤ ln 2 / 2; e^r by its Taylor polynomial of degree 6.
#[inline]
pub fn fast_exp(x: f32) -> f32 {
    /// 1.5·2²³: adding it rounds to an integer held in the low mantissa bits.
    const ROUND: f32 = 12_582_912.0;
    let x = x.clamp(-87.0, 87.0);
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = (x - n * 0.693_145_75) - n * 1.428_606_8e-6;
    let p = 1.0
        + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0))))));
    let scale = f32::from_bits((shifted.to_bits() << 23).wrapping_add(127 << 23));
    p * scale
}

/// Bound of [`fast_exp`]: truncation after r⁶/720 plus a few roundings.
pub const EXP_RELATIVE_ERROR: f32 = 5e-7;

#[inline]
fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + fast_exp(-x))
}

fn contiguous<'a>(storage: &'a CpuStorage, layout: &Layout) -> Result<&'a [f32]> {
    match layout.contiguous_offsets() {
        Some((start, end)) => Ok(&storage.as_slice::<f32>()?[start..end]),
        None => bail!("bias_silu needs contiguous inputs"),
    }
}

impl CustomOp2 for BiasSilu {
    fn name(&self) -> &'static str {
        "bias_silu"
    }

    fn cpu_fwd(
        &self,
        s1: &CpuStorage,
        l1: &Layout,
        s2: &CpuStorage,
        l2: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (rows, width) = l1.shape().dims2()?;
        let (x, bias) = (contiguous(s1, l1)?, contiguous(s2, l2)?);
        if bias.len() != width || rows % self.columns != 0 {
            bail!(
                "bias_silu: {rows} rows of {width} in {} columns with {} biases",
                self.columns,
                bias.len()
            );
        }
        let block = rows / self.columns * width;
        let mut y = vec![0f32; x.len()];
        for start in (0..block).step_by(width) {
            for (i, b) in bias.iter().enumerate() {
                let z = x[start + i] + b;
                y[start + i] = z * sigmoid(z);
            }
        }
        for tangent in 1..self.columns {
            for start in (0..block).step_by(width) {
                let t = tangent * block + start;
                let (value, source, target) =
                    (&x[start..start + width], &x[t..t + width], &mut y[t..t + width]);
                for i in 0..width {
                    let z = value[i] + bias[i];
                    let s = sigmoid(z);
                    target[i] = source[i] * s * (1.0 + z * (1.0 - s));
                }
            }
        }
        Ok((CpuStorage::F32(y), l1.shape().clone()))
    }

    fn bwd(
        &self,
        x: &Tensor,
        bias: &Tensor,
        _y: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let (rows, width) = x.dims2()?;
        let gradient = gradient.contiguous()?;
        let (xs, bs, gs) = (
            x.storage_and_layout(),
            bias.storage_and_layout(),
            gradient.storage_and_layout(),
        );
        let (Storage::Cpu(xc), Storage::Cpu(bc), Storage::Cpu(gc)) = (&*xs.0, &*bs.0, &*gs.0) else {
            bail!("bias_silu runs on the CPU only")
        };
        let (x_values, b, g) = (
            contiguous(xc, xs.1)?,
            contiguous(bc, bs.1)?,
            contiguous(gc, gs.1)?,
        );
        let block = rows / self.columns * width;
        let mut dx = vec![0f32; x_values.len()];
        let mut db = vec![0f32; width];
        for start in (0..block).step_by(width) {
            let (values, rest) = dx.split_at_mut(block);
            let dz = &mut values[start..start + width];
            for i in 0..width {
                let z = x_values[start + i] + b[i];
                let s = sigmoid(z);
                dz[i] = g[start + i] * s * (1.0 + z * (1.0 - s));
            }
            for tangent in 1..self.columns {
                let t = tangent * block + start;
                let target = &mut rest[t - block..t - block + width];
                for i in 0..width {
                    let z = x_values[start + i] + b[i];
                    let s = sigmoid(z);
                    // s''(z) = σ(1−σ)(2 + z(1−2σ)).
                    dz[i] += g[t + i] * x_values[t + i] * s * (1.0 - s) * (2.0 + z * (1.0 - 2.0 * s));
                    target[i] = g[t + i] * s * (1.0 + z * (1.0 - s));
                }
            }
            for i in 0..width {
                db[i] += dz[i];
            }
        }
        let device = x.device();
        Ok((
            Some(Tensor::from_vec(dx, (rows, width), device)?),
            Some(Tensor::from_vec(db, width, device)?),
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::Rng;
    use candle_core::{Device, Var};

    /// f32 round-off of sums over 40 rows, relative to the largest gradient.
    const GRADIENT_TOL: f32 = 2e-6;

    #[test]
    fn exp_holds_its_bound() {
        for i in -870_000..870_000 {
            let x = i as f32 * 1e-4;
            let error = (f64::from(fast_exp(x)) / f64::from(x).exp() - 1.0).abs();
            assert!(error < f64::from(EXP_RELATIVE_ERROR), "{x}: {error}");
        }
    }

    /// The oracle: the same function of candle's own operations, differentiated by candle.
    #[test]
    fn agrees_with_plain_candle_forward_and_backward() -> Result<()> {
        let (rows, width) = (20, 8);
        let mut rng = Rng::new(&[3]);
        let mut random = |n: usize| {
            (0..n)
                .map(|_| 4.0 * rng.uniform() as f32 - 2.0)
                .collect::<Vec<_>>()
        };
        let x = Var::from_vec(random(3 * rows * width), (3 * rows, width), &Device::Cpu)?;
        let bias = Var::from_vec(random(width), width, &Device::Cpu)?;
        let weights = Tensor::from_vec(random(3 * rows * width), (3 * rows, width), &Device::Cpu)?;
        let ours = x
            .as_tensor()
            .apply_op2(bias.as_tensor(), BiasSilu { columns: 3 })?;
        let z = x.narrow(0, 0, rows)?.broadcast_add(bias.as_tensor())?;
        let s = candle_nn::ops::sigmoid(&z)?;
        let slope = (&s * ((&z * (1.0 - &s)?)? + 1.0)?)?;
        let tangents = [1, 2].map(|t| x.narrow(0, t * rows, rows).and_then(|v| v * &slope));
        let [a, b] = tangents;
        let plain = Tensor::cat(&[(&z * &s)?, a?, b?], 0)?;
        let largest = |t: &Tensor| t.abs()?.flatten_all()?.max(0)?.to_scalar::<f32>();
        assert!(largest(&(&ours - &plain)?)? < GRADIENT_TOL * largest(&plain)?);
        let (go, gp) = (
            (&ours * &weights)?.sum_all()?.backward()?,
            (&plain * &weights)?.sum_all()?.backward()?,
        );
        for var in [&x, &bias] {
            let (o, p) = (go.get(var).expect("used"), gp.get(var).expect("used"));
            assert!(largest(&(o - p)?)? < GRADIENT_TOL * largest(p)?);
        }
        Ok(())
    }
}
