//! Pictures to look at: 8-bit sRGB PNG, one image or several side by side.

use crate::error::{Error, Result};
use crate::image::{Image, same_size};
use bake_runtime::network::write_atomically;
use std::path::Path;

/// Values up to here are shown as they are; brighter ones are bent so that highlights keep their colour.
pub const SHOULDER: f32 = 0.8;

/// Width in pixels and value of the line between pictures.
const SEPARATOR: (usize, u8) = (2, 255);

/// Display value in [0, 1) of `radiance`, linear before the sRGB transfer function.
///
/// v = radiance · 2^exposure; v up to [`SHOULDER`], above it SHOULDER + (1 − SHOULDER)·(1 − e^(−x)) with
/// x = (v − SHOULDER)/(1 − SHOULDER): level slope at the joint, 1 at infinity. Negative and NaN become 0.
pub fn tone(radiance: f32, exposure: f32) -> f32 {
    let v = (radiance * exposure.exp2()).max(0.0);
    if v <= SHOULDER {
        v
    } else {
        1.0 - (1.0 - SHOULDER) * ((SHOULDER - v) / (1.0 - SHOULDER)).exp()
    }
}

/// 8-bit sRGB code of the linear value `v` in [0, 1] (IEC 61966-2-1).
pub fn srgb_code(v: f32) -> u8 {
    let encoded = if v <= 0.003_130_8 {
        12.92 * v
    } else {
        1.055 * v.powf(1.0 / 2.4) - 0.055
    };
    (encoded * 255.0).round() as u8
}

/// Writes `images`, all of one size, side by side with a thin white line between them; whole or not at all.
///
/// `exposure`: stops, see [`tone`].
///
/// # Errors
/// [`Error::ImageSize`]; [`Error::Runtime`] naming the file that could not be written.
pub fn write_png(path: &Path, images: &[&Image], exposure: f32) -> Result<()> {
    let [first, ..] = images else {
        return Err(Error::image_file(path, "there is no image to write"));
    };
    images.iter().try_for_each(|image| same_size(first, image))?;
    let (gap, gap_value) = SEPARATOR;
    let mut pixels = Vec::new();
    for row in 0..first.height {
        for (i, image) in images.iter().enumerate() {
            if i > 0 {
                pixels.extend(std::iter::repeat_n(gap_value, 3 * gap));
            }
            let line = &image.rgb[row * image.width..(row + 1) * image.width];
            pixels.extend(line.iter().flatten().map(|&v| srgb_code(tone(v, exposure))));
        }
    }
    let width = images.len() * first.width + (images.len() - 1) * gap;
    write_codes(path, [width, first.height], &pixels)
}

/// Writes a picture of `size` = width, height, as sRGB codes, three a pixel; whole or not at all.
///
/// # Errors
/// [`Error::ImageFile`] when the codes do not fill the size; [`Error::Runtime`] naming the file that could not be
/// written.
pub fn write_codes(path: &Path, size: [usize; 2], codes: &[u8]) -> Result<()> {
    let bytes = encode(size[0], size[1], codes).map_err(|e| Error::image_file(path, e.to_string()))?;
    Ok(write_atomically(path, &bytes)?)
}

fn encode(width: usize, height: usize, pixels: &[u8]) -> std::result::Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels)?;
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tone_curve_is_monotone_and_smooth_at_its_joint() {
        let values: Vec<f32> = (0..200).map(|i| tone(i as f32 * 0.01, 0.0)).collect();
        assert!(values.windows(2).all(|w| w[0] < w[1]) && values.iter().all(|v| *v < 1.0));
        assert!((tone(0.81, 0.0) - 0.81).abs() < 3e-4, "slope 1 at the joint");
        assert_eq!(
            [tone(0.25, 1.0), tone(-1.0, 0.0), tone(f32::NAN, 0.0)],
            [0.5, 0.0, 0.0]
        );
        assert_eq!(
            [srgb_code(0.0), srgb_code(0.215_86), srgb_code(1.0)],
            [0, 128, 255]
        );
    }

    #[test]
    fn montage_holds_every_image() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("montage.png");
        let (dark, mut bright) = (Image::new(4, 3), Image::new(4, 3));
        bright.rgb.fill([0.5; 3]);
        write_png(&path, &[&dark, &bright], 0.0).unwrap();
        let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&path).unwrap()));
        let mut reader = decoder.read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), (4 + SEPARATOR.0 as u32 + 4, 3));
        assert_eq!(
            [pixels[0], pixels[3 * 4], pixels[3 * 6]],
            [0, SEPARATOR.1, srgb_code(0.5)]
        );
        let mismatch = write_png(&path, &[&dark, &Image::new(3, 3)], 0.0);
        assert!(matches!(mismatch, Err(Error::ImageSize { .. })));
    }
}
