//! Rendered images: mean radiance per pixel, its variance, and what the camera saw first.

use crate::error::{Error, Result};
use std::collections::BTreeMap;

/// A rendered image; pixels row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Samples per pixel.
    pub spp: u64,
    /// Contributions that were infinite or NaN: left out of `rgb`, and always a defect of some method.
    pub non_finite: u64,
    /// Mean radiance.
    pub rgb: Vec<[f32; 3]>,
    /// Sample variance of one sample, 0 when `spp` is 1. Divided by `spp` it is the variance of `rgb` for
    /// independent samples; low-discrepancy samples do better, so it bounds their noise in practice.
    pub variance: Vec<[f32; 3]>,
    /// Mean colour of the first hit ([`bake_runtime::Reference::base_color`]), 0 where nothing was hit.
    pub albedo: Vec<[f32; 3]>,
    /// Mean shading normal at the first hit, world space.
    pub normal: Vec<[f32; 3]>,
    /// Surface number plus one that the first sample hit, 0 where it hit nothing.
    pub object: Vec<f32>,
    /// Free text that travels with the image, e.g. method and seed.
    pub attributes: BTreeMap<String, String>,
}

impl Image {
    /// A black image of no samples.
    pub fn new(width: usize, height: usize) -> Image {
        let black = vec![[0.0; 3]; width * height];
        Image {
            width,
            height,
            spp: 0,
            non_finite: 0,
            rgb: black.clone(),
            variance: black.clone(),
            albedo: black.clone(),
            normal: black,
            object: vec![0.0; width * height],
            attributes: BTreeMap::new(),
        }
    }

    /// Averages in another pass over the same scene: the result is as if both had been rendered at once,
    /// within rounding. Object numbers and attributes stay those of the first pass.
    ///
    /// # Errors
    /// [`Error::ImageSize`].
    pub fn merge(&mut self, pass: &Image) -> Result<()> {
        same_size(self, pass)?;
        if self.spp == 0 {
            self.object.clone_from(&pass.object);
        }
        let (a, b) = (self.spp as f64, pass.spp as f64);
        let count = a + b;
        if pass.spp == 0 {
            return Ok(());
        }
        for i in 0..self.rgb.len() {
            for c in 0..3 {
                let (mean, pass_mean) = (f64::from(self.rgb[i][c]), f64::from(pass.rgb[i][c]));
                let difference = pass_mean - mean;
                // Chan, Golub and LeVeque 1983: sums of squared deviations of two sets.
                let squares = f64::from(self.variance[i][c]) * (a - 1.0).max(0.0)
                    + f64::from(pass.variance[i][c]) * (b - 1.0)
                    + difference * difference * a * b / count;
                self.rgb[i][c] = (mean + difference * b / count) as f32;
                self.variance[i][c] = (squares / (count - 1.0).max(1.0)) as f32;
            }
            for (mean, pass_mean) in [(&mut self.albedo, &pass.albedo), (&mut self.normal, &pass.normal)] {
                for c in 0..3 {
                    mean[i][c] += (pass_mean[i][c] - mean[i][c]) * (b / count) as f32;
                }
            }
        }
        self.spp += pass.spp;
        self.non_finite += pass.non_finite;
        Ok(())
    }
}

/// Checks that two images can be compared pixel by pixel.
///
/// # Errors
/// [`Error::ImageSize`].
pub fn same_size(a: &Image, b: &Image) -> Result<()> {
    let (first, second) = ([a.width, a.height], [b.width, b.height]);
    if first == second {
        Ok(())
    } else {
        Err(Error::ImageSize { first, second })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixel(samples: &[f32]) -> Image {
        let n = samples.len() as f32;
        let mean = samples.iter().sum::<f32>() / n;
        let squares = samples.iter().map(|s| (s - mean) * (s - mean)).sum::<f32>();
        let mut image = Image::new(1, 1);
        image.spp = samples.len() as u64;
        image.rgb[0] = [mean; 3];
        image.variance[0] = [squares / (n - 1.0).max(1.0); 3];
        image
    }

    #[test]
    fn merged_passes_equal_one_render() {
        let mut merged = Image::new(1, 1);
        for pass in [&[1.0, 4.0][..], &[2.0], &[7.0, 0.0, 3.0]] {
            merged.merge(&pixel(pass)).unwrap();
        }
        let whole = pixel(&[1.0, 4.0, 2.0, 7.0, 0.0, 3.0]);
        assert_eq!(merged.spp, 6);
        assert!((merged.rgb[0][0] - whole.rgb[0][0]).abs() < 1e-6);
        assert!((merged.variance[0][0] - whole.variance[0][0]).abs() < 1e-5);
        let message = merged.merge(&Image::new(2, 1)).unwrap_err().to_string();
        assert_eq!(message, "images differ in size: 1×1 and 2×1 pixels");
    }
}
