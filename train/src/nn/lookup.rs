//! Lookup of many splines at learned positions, as one candle operation with its gradient.

use crate::spline::EdgeSpline;
use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Storage, Tensor, bail};
use std::sync::Arc;

/// Row b of the input is a position in the square; the output is `splines[indices[b]]` there.
///
/// candle keeps an operation alive as long as its results, so the splines are shared and not borrowed.
pub struct Lookup {
    /// The splines of all slices.
    pub splines: Arc<Vec<EdgeSpline>>,
    /// Which spline each row uses.
    pub indices: Arc<Vec<usize>>,
}

impl CustomOp1 for Lookup {
    fn name(&self) -> &'static str {
        "spline_lookup"
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (rows, two) = layout.shape().dims2()?;
        let Some((start, end)) = layout.contiguous_offsets() else {
            bail!("spline_lookup needs contiguous positions")
        };
        if two != 2 || rows != self.indices.len() {
            bail!(
                "spline_lookup: {rows} × {two} positions for {} indices",
                self.indices.len()
            );
        }
        let positions = &storage.as_slice::<f32>()?[start..end];
        let at = |(k, p): (&usize, &[f32])| self.splines[*k].at([f64::from(p[0]), f64::from(p[1])]).0 as f32;
        let values = self
            .indices
            .iter()
            .zip(positions.chunks_exact(2))
            .map(at)
            .collect();
        Ok((CpuStorage::F32(values), Shape::from(rows)))
    }

    fn bwd(&self, positions: &Tensor, _result: &Tensor, gradient: &Tensor) -> Result<Option<Tensor>> {
        let gradient = gradient.contiguous()?;
        let (ps, gs) = (positions.storage_and_layout(), gradient.storage_and_layout());
        let (Storage::Cpu(pc), Storage::Cpu(gc)) = (&*ps.0, &*gs.0) else {
            bail!("spline_lookup runs on the CPU only")
        };
        let slice = |storage: &CpuStorage, layout: &Layout| match layout.contiguous_offsets() {
            Some((a, b)) => Ok(storage.as_slice::<f32>()?[a..b].to_vec()),
            None => bail!("spline_lookup needs contiguous positions"),
        };
        let (p, g) = (slice(pc, ps.1)?, slice(gc, gs.1)?);
        let mut out = Vec::with_capacity(p.len());
        for ((k, p), g) in self.indices.iter().zip(p.chunks_exact(2)).zip(&g) {
            let (_, slope) = self.splines[*k].at([f64::from(p[0]), f64::from(p[1])]);
            out.extend(slope.map(|s| s as f32 * g));
        }
        Ok(Some(Tensor::from_vec(
            out,
            positions.shape(),
            positions.device(),
        )?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spline::edge_cell_centre;
    use candle_core::{Device, Var};

    /// Central differences with step 1e-3 in f32 of a function of order 1.
    const DIFFERENCE_TOL: f32 = 5e-3;

    #[test]
    fn gradient_is_that_of_the_spline() -> Result<()> {
        let values: Vec<f64> = (0..256)
            .map(|k| edge_cell_centre(k, 16))
            .map(|s| (3.0 * s[0]).sin() * s[1])
            .collect();
        let splines = Arc::new(vec![EdgeSpline::new(&values, 16)]);
        let look = |x: &Tensor| {
            x.apply_op1(Lookup {
                splines: splines.clone(),
                indices: Arc::new(vec![0]),
            })
        };
        let at = |p: [f32; 2]| {
            look(&Tensor::new(&[p], &Device::Cpu)?)?
                .sum_all()?
                .to_scalar::<f32>()
        };
        let p = [0.37f32, 0.61];
        let x = Var::new(&[p], &Device::Cpu)?;
        let gradient = look(x.as_tensor())?
            .sum_all()?
            .backward()?
            .get(&x)
            .expect("used")
            .to_vec2::<f32>()?;
        let h = 1e-3;
        let dx = (at([p[0] + h, p[1]])? - at([p[0] - h, p[1]])?) / (2.0 * h);
        let dy = (at([p[0], p[1] + h])? - at([p[0], p[1] - h])?) / (2.0 * h);
        assert!((gradient[0][0] - dx).abs() < DIFFERENCE_TOL && (gradient[0][1] - dy).abs() < DIFFERENCE_TOL);
        Ok(())
    }
}
