//! Grey-scale pictures: known pixels of every kind of file, their squares, and files that are no pictures.

use bake_scenes::exr_file::write_rgb;
use bake_scenes::grey_picture::{GreyPicture, read_grey};
use jpeg_encoder::{ColorType, Encoder};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Rounding of a few products in f64.
const ROUNDING: f64 = 1e-12;

/// Linear value of the sRGB code 188 of 255: ((188/255 + 0.055)/1.055)^2.4.
const CODE_188: f64 = 0.502_886_458_033_020_9;

/// A JPEG of even colour comes back within a code or two: steps of 1/255 are at most 0.009 in linear values.
const JPEG_ERROR: f64 = 0.02;

/// The f32 of OpenEXR.
const SINGLE: f64 = 1e-6;

fn png_file(path: &Path, size: [u32; 2], color: png::ColorType, depth: png::BitDepth, samples: &[u8]) {
    let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), size[0], size[1]);
    encoder.set_color(color);
    encoder.set_depth(depth);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(samples).unwrap();
    writer.finish().unwrap();
}

fn assert_values(path: &Path, expected: &[f64], tolerance: f64) {
    let picture = read_grey(path).unwrap();
    assert_eq!(picture.width * picture.height, picture.values.len());
    assert_eq!(picture.values.len(), expected.len());
    for (got, expected) in picture.values.iter().zip(expected) {
        assert!(
            (got - expected).abs() <= tolerance,
            "{}: {:?} instead of {expected}",
            path.display(),
            picture.values
        );
    }
}

#[test]
fn pixels_of_png_are_linear_luminances_from_the_bottom() {
    use png::{BitDepth, ColorType};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.png");
    // Top row first in the file, last in memory.
    png_file(
        &path,
        [2, 2],
        ColorType::Grayscale,
        BitDepth::Eight,
        &[255, 188, 0, 188],
    );
    assert_values(&path, &[0.0, CODE_188, 1.0, CODE_188], ROUNDING);
    // 188·257 is the same share of 65 535.
    let wide = (188_u16 * 257).to_be_bytes();
    png_file(&path, [1, 1], ColorType::Grayscale, BitDepth::Sixteen, &wide);
    assert_values(&path, &[CODE_188], ROUNDING);
    png_file(
        &path,
        [2, 1],
        ColorType::Rgb,
        BitDepth::Eight,
        &[255, 0, 0, 0, 0, 188],
    );
    assert_values(&path, &[0.2126, 0.0722 * CODE_188], ROUNDING);
    png_file(&path, [1, 1], ColorType::Rgba, BitDepth::Eight, &[0, 255, 0, 51]);
    assert_values(&path, &[0.7152 * 0.2], ROUNDING);
    png_file(
        &path,
        [1, 1],
        ColorType::GrayscaleAlpha,
        BitDepth::Eight,
        &[188, 51],
    );
    assert_values(&path, &[CODE_188 * 0.2], ROUNDING);
    // Eight pixels of one bit.
    png_file(&path, [8, 1], ColorType::Grayscale, BitDepth::One, &[0b1000_0001]);
    assert_values(&path, &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], ROUNDING);
}

#[test]
fn pixels_of_jpeg_and_exr_are_linear_luminances() {
    let folder = tempfile::tempdir().unwrap();
    // The kind of file is told by its content.
    let path = folder.path().join("picture");
    for (color, pixel, expected) in [
        (ColorType::Luma, vec![188], CODE_188),
        (ColorType::Rgb, vec![188, 188, 188], CODE_188),
        (ColorType::Rgb, vec![0, 255, 0], 0.7152),
    ] {
        let encoder = Encoder::new_file(&path, 100).unwrap();
        encoder.encode(&pixel.repeat(9 * 7), 9, 7, color).unwrap();
        assert_eq!(
            (read_grey(&path).unwrap().width, read_grey(&path).unwrap().height),
            (9, 7)
        );
        assert_values(&path, &[expected; 9 * 7], JPEG_ERROR);
    }
    let pixels = [[1.0, 0.0, 0.0], [100.0, 100.0, 100.0]];
    write_rgb(&path, [1, 2], &pixels, &BTreeMap::new()).unwrap();
    assert_values(&path, &[100.0, 0.2126], 100.0 * SINGLE);
}

#[test]
fn squares_are_cropped_at_the_centre_and_keep_the_mean() {
    // Columns 0, 1, … 6 by three rows: the square is columns 2 to 4.
    let values: Vec<f64> = (0..21).map(|k| (k % 7) as f64 + 10.0 * (k / 7) as f64).collect();
    let picture = GreyPicture {
        width: 7,
        height: 3,
        values,
    };
    let same = picture.to_square(3);
    let expected = [2.0, 3.0, 4.0, 12.0, 13.0, 14.0, 22.0, 23.0, 24.0];
    for side in [1, 2, 3, 5, 64] {
        let square = picture.to_square(side);
        assert_eq!(square.len(), side * side);
        let mean = square.iter().sum::<f64>() / square.len() as f64;
        assert!((mean - 13.0).abs() < 13.0 * ROUNDING, "{side}: {mean}");
    }
    assert!(
        same.iter().zip(expected).all(|(a, b)| (a - b).abs() < ROUNDING),
        "{same:?}"
    );
    // An odd rest is cropped by half a pixel on either side.
    let odd = GreyPicture {
        width: 1,
        height: 2,
        values: vec![1.0, 4.0],
    };
    assert_eq!(odd.to_square(1), [2.5]);
}

#[test]
fn files_that_are_no_pictures_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.png");
    let refused = |path: &PathBuf, part: &str| {
        let text = read_grey(path).unwrap_err().to_string();
        assert!(
            text.contains("picture.png") && text.contains(part) && !text.contains('\n'),
            "{text}"
        );
    };
    refused(&path, "No such file");
    fs::write(&path, "width 3").unwrap();
    refused(&path, "neither PNG, JPEG nor OpenEXR");
    fs::write(&path, "").unwrap();
    refused(&path, "neither PNG, JPEG nor OpenEXR");
    png_file(
        &path,
        [2, 2],
        png::ColorType::Grayscale,
        png::BitDepth::Eight,
        &[1, 2, 3, 4],
    );
    let whole = fs::read(&path).unwrap();
    fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    refused(&path, "not an image this program can use");
    // Width 0, in the first chunk; its checksum is wrong then, too.
    let mut empty = whole.clone();
    empty[16..20].fill(0);
    fs::write(&path, &empty).unwrap();
    refused(&path, "not an image this program can use");
    // A head that promises 65 536² pixels.
    let huge = fs::File::create(&path).unwrap();
    let mut head = png::Encoder::new(huge, 1 << 16, 1 << 16).write_header().unwrap();
    head.write_chunk(png::chunk::IDAT, &[]).unwrap();
    drop(head);
    refused(&path, "65536 × 65536 pixels");
    let noise: Vec<u8> = (0..64 * 64_u32)
        .map(|k| (k.wrapping_mul(2_654_435_761) >> 24) as u8)
        .collect();
    let encoder = Encoder::new_file(&path, 100).unwrap();
    encoder.encode(&noise, 64, 64, ColorType::Luma).unwrap();
    assert_eq!(read_grey(&path).unwrap().values.len(), noise.len());
    let whole = fs::read(&path).unwrap();
    for length in [30, whole.len() / 2] {
        fs::write(&path, &whole[..length]).unwrap();
        refused(&path, "not an image this program can use");
    }
    // A height of 0, five bytes after the marker of the frame.
    let frame = whole.windows(2).position(|two| two == [0xff, 0xc0]).unwrap();
    let mut flat = whole;
    flat[frame + 5..frame + 7].fill(0);
    fs::write(&path, &flat).unwrap();
    refused(&path, "not an image this program can use");
    write_rgb(&path, [1, 1], &[[f32::NAN; 3]], &BTreeMap::new()).unwrap();
    refused(&path, "texel (0, 0)");
}
