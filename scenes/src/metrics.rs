//! Errors of images against a converged reference.

use crate::error::Result;
use crate::image::{Image, same_size};

/// Added to the squared reference, so that dark pixels do not rule the relative error.
pub const RELMSE_EPSILON: f64 = 0.01;

/// Mean over pixels and channels of (x − r)² / (r² + [`RELMSE_EPSILON`]).
///
/// # Errors
/// [`crate::Error::ImageSize`].
pub fn relmse(image: &Image, reference: &Image) -> Result<f64> {
    same_size(image, reference)?;
    let pairs = image.rgb.iter().flatten().zip(reference.rgb.iter().flatten());
    let sum: f64 = pairs
        .map(|(&x, &r)| relative_square(f64::from(x) - f64::from(r), f64::from(r)))
        .sum();
    Ok(sum / (3 * image.rgb.len()) as f64)
}

fn relative_square(difference: f64, reference: f64) -> f64 {
    difference * difference / (reference * reference + RELMSE_EPSILON)
}

/// The two parts of a method's relative squared error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorSplit {
    /// Systematic part; its estimate may be slightly negative where there is none. The reference's own noise
    /// counts as bias.
    pub bias2: f64,
    /// Part that changes from seed to seed, of one image.
    pub variance: f64,
}

/// Splits the relative squared error of `images`, at least two of one method with different seeds.
///
/// With n images x_k of mean m: variance = mean over pixels of Σ(x_k − m)²/(n − 1), and
/// bias² = mean of (m − r)² − variance/n, both over r² + [`RELMSE_EPSILON`].
///
/// # Errors
/// [`crate::Error::ImageSize`].
pub fn error_split(images: &[Image], reference: &Image) -> Result<ErrorSplit> {
    images.iter().try_for_each(|image| same_size(image, reference))?;
    let n = images.len() as f64;
    let (mut of_mean, mut variance) = (0.0, 0.0);
    for i in 0..reference.rgb.len() {
        for c in 0..3 {
            let r = f64::from(reference.rgb[i][c]);
            let mean = images.iter().map(|x| f64::from(x.rgb[i][c])).sum::<f64>() / n;
            of_mean += relative_square(mean - r, r);
            variance += images
                .iter()
                .map(|x| relative_square(f64::from(x.rgb[i][c]) - mean, r))
                .sum::<f64>()
                / (n - 1.0);
        }
    }
    let values = (3 * reference.rgb.len()) as f64;
    let variance = variance / values;
    Ok(ErrorSplit {
        bias2: of_mean / values - variance / n,
        variance,
    })
}

/// Means of one square of two images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileDifference {
    /// Leftmost pixel.
    pub x: usize,
    /// Topmost pixel.
    pub y: usize,
    /// Mean of the image over mean of the reference, minus 1, RGB; 0 where both are black.
    pub relative: [f64; 3],
    /// Standard error of `relative` from both images' variances, taking samples as independent, RGB.
    pub standard_error: [f64; 3],
}

/// Compares the means of every `side` × `side` square; those at the right and bottom edges may be smaller.
///
/// # Errors
/// [`crate::Error::ImageSize`].
pub fn tile_differences(image: &Image, reference: &Image, side: usize) -> Result<Vec<TileDifference>> {
    same_size(image, reference)?;
    let mut tiles = Vec::new();
    for y in (0..image.height).step_by(side) {
        for x in (0..image.width).step_by(side) {
            let rows = y..(y + side).min(image.height);
            let pixels: Vec<usize> = rows
                .flat_map(|row| (x..(x + side).min(image.width)).map(move |column| (row, column)))
                .map(|(row, column)| row * image.width + column)
                .collect();
            let mut tile = TileDifference {
                x,
                y,
                relative: [0.0; 3],
                standard_error: [0.0; 3],
            };
            for c in 0..3 {
                let sum = |array: &[[f32; 3]]| pixels.iter().map(|&i| f64::from(array[i][c])).sum::<f64>();
                let spread = |image: &Image| sum(&image.variance) / image.spp.max(1) as f64;
                let (x, r) = (sum(&image.rgb), sum(&reference.rgb));
                if r > 0.0 {
                    tile.relative[c] = x / r - 1.0;
                    tile.standard_error[c] = (spread(image) + spread(reference)).sqrt() / r;
                } else if x != 0.0 {
                    tile.relative[c] = f64::INFINITY;
                }
            }
            tiles.push(tile);
        }
    }
    Ok(tiles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::Rng;

    fn flat(value: f32) -> Image {
        let mut image = Image::new(40, 33);
        image.rgb.fill([value; 3]);
        image.spp = 1;
        image
    }

    #[test]
    fn relmse_of_flat_images() {
        // (3 − 2)² / (4 + 0.01).
        assert!((relmse(&flat(3.0), &flat(2.0)).unwrap() - 1.0 / 4.01).abs() < 1e-12);
        assert!(relmse(&flat(1.0), &Image::new(1, 1)).is_err());
    }

    /// Five standard errors of a variance estimated from 4·3960 squared uniforms.
    const SPLIT_TOL: f64 = 0.04;

    #[test]
    fn split_finds_the_bias_and_noise_put_in() {
        // Truth 1, bias 0.5, noise uniform of width 1: bias² 0.25/1.01, variance 1/12/1.01.
        let images: Vec<Image> = (0..4)
            .map(|seed| {
                let mut rng = Rng::new(&[seed]);
                let mut image = flat(0.0);
                image
                    .rgb
                    .iter_mut()
                    .flatten()
                    .for_each(|v| *v = 1.0 + rng.uniform() as f32);
                image
            })
            .collect();
        let split = error_split(&images, &flat(1.0)).unwrap();
        assert!((split.bias2 / (0.25 / 1.01) - 1.0).abs() < SPLIT_TOL, "{split:?}");
        assert!(
            (split.variance / (1.0 / 12.0 / 1.01) - 1.0).abs() < SPLIT_TOL,
            "{split:?}"
        );
    }

    #[test]
    fn tiles_cover_the_image_and_find_a_local_difference() {
        let mut image = flat(1.0);
        image.rgb[32 * 40 + 39] = [2.0; 3];
        image.variance.fill([4.0; 3]);
        let tiles = tile_differences(&image, &flat(1.0), 32).unwrap();
        assert_eq!(
            tiles.iter().map(|t| (t.x, t.y)).collect::<Vec<_>>(),
            [(0, 0), (32, 0), (0, 32), (32, 32)]
        );
        // The last tile has 8 pixels, one of them doubled: 9/8 − 1; standard error √(8·4)/8.
        assert!((tiles[3].relative[0] - 0.125).abs() < 1e-12);
        assert!((tiles[3].standard_error[1] - 32f64.sqrt() / 8.0).abs() < 1e-12);
        assert_eq!(tiles[0].relative, [0.0; 3]);
    }
}
