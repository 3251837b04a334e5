//! Grey-scale pictures read from files, to be sampled as densities.

use crate::box_filter::box_filter;
use crate::error::{Error, Result};
use crate::exr_file;
use std::io::Cursor;
use std::path::Path;
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Weights of linear R, G and B in the luminance (Rec. ITU-R BT.709-6, 3.2).
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// First bytes of the files that can be read (PNG 3rd edition, 5.2; ITU-T T.81, B.1.1.3; OpenEXR file layout).
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
const JPEG: &[u8] = b"\xff\xd8\xff";
const EXR: &[u8] = b"\x76\x2f\x31\x01";

/// Most pixels that are read: 8192². As f64 they take half a gigabyte.
const PIXELS_MAX: usize = 1 << 26;

/// A picture by its linear luminance.
#[derive(Clone, Debug, PartialEq)]
pub struct GreyPicture {
    /// Width in pixels, ≥ 1.
    pub width: usize,
    /// Height in pixels, ≥ 1.
    pub height: usize,
    /// Luminances ≥ 0, x fastest, rows upwards from the bottom of the picture. 1 is the white of PNG and JPEG.
    pub values: Vec<f64>,
}

/// Reads a PNG (8 or 16 bits or fewer, grey, colours or a palette), JPEG or OpenEXR picture; which it is its first
/// bytes tell.
///
/// The codes of PNG and JPEG are taken as sRGB, whatever profile the file holds. The alpha of PNG multiplies: what is
/// transparent is black. OpenEXR is linear already, and its colours are multiplied by its alpha; it needs the channels
/// `R G B`, or `Y`.
///
/// # Errors
/// [`Error::Io`], or [`Error::ImageFile`] when the file is damaged, of another kind, has no pixels or more than 2²⁶, or
/// has a value that is negative, infinite or NaN.
pub fn read_grey(path: &Path) -> Result<GreyPicture> {
    let bytes = std::fs::read(path).map_err(|source| Error::io(path, source))?;
    let rows = if bytes.starts_with(PNG) {
        from_png(&bytes)
    } else if bytes.starts_with(JPEG) {
        from_jpeg(bytes)
    } else if bytes.starts_with(EXR) {
        let (size, texels) = exr_file::read_radiance(path)?;
        let values = texels.iter().map(|rgb| luminance(rgb.map(f64::from)));
        check_size(size).map(|()| (size, values.collect()))
    } else {
        Err("it is neither PNG, JPEG nor OpenEXR".into())
    };
    let ([width, height], downwards) = rows.map_err(|reason| Error::image_file(path, reason))?;
    Ok(GreyPicture {
        width,
        height,
        values: downwards.rchunks(width).flatten().copied().collect(),
    })
}

impl GreyPicture {
    /// Its largest centred square in `side`² pixels, x fastest, y upwards: means over what a pixel covers.
    pub fn to_square(&self, side: usize) -> Vec<f64> {
        let length = self.width.min(self.height);
        let corner = [self.width, self.height].map(|extent| (extent - length) as f64 / 2.0);
        box_filter(
            &self.values,
            [self.width, self.height],
            corner,
            length as f64,
            side,
        )
    }
}

/// Width, height and luminances, row by row from the top; or what is wrong.
type Rows = std::result::Result<([usize; 2], Vec<f64>), String>;

fn from_png(bytes: &[u8]) -> Rows {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(|e| e.to_string())?;
    let size = [reader.info().width, reader.info().height].map(|v| v as usize);
    check_size(size)?;
    let mut samples = vec![0; reader.output_buffer_size().unwrap_or(0)];
    let info = reader.next_frame(&mut samples).map_err(|e| e.to_string())?;
    samples.truncate(info.buffer_size());
    let coded: Vec<f64> = match info.bit_depth {
        png::BitDepth::Sixteen => {
            let wide = samples.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]]));
            wide.map(|code| f64::from(code) / f64::from(u16::MAX)).collect()
        }
        _ => unit(&samples),
    };
    let values = coded
        .chunks_exact(info.color_type.samples())
        .map(|pixel| match *pixel {
            [grey, alpha] => linear(grey) * alpha,
            [r, g, b] => luminance([r, g, b].map(linear)),
            [r, g, b, alpha] => luminance([r, g, b].map(linear)) * alpha,
            _ => linear(pixel[0]),
        });
    Ok((size, values.collect()))
}

fn from_jpeg(bytes: Vec<u8>) -> Rows {
    // What is strict is that the end of the data must not be missing.
    let options = DecoderOptions::default()
        .jpeg_set_out_colorspace(ColorSpace::RGB)
        .set_strict_mode(true);
    let mut decoder = JpegDecoder::new_with_options(Cursor::new(bytes), options);
    // The messages of the decoder end in a line break.
    let reason = |e: DecodeErrors| e.to_string().trim().to_string();
    decoder.decode_headers().map_err(reason)?;
    let size = decoder
        .dimensions()
        .map_or([0; 2], |(width, height)| [width, height]);
    check_size(size)?;
    let samples = decoder.decode().map_err(reason)?;
    let coded = unit(&samples);
    let pixels = coded
        .chunks_exact(3)
        .map(|rgb| luminance([rgb[0], rgb[1], rgb[2]].map(linear)));
    Ok((size, pixels.collect()))
}

fn check_size(size: [usize; 2]) -> std::result::Result<(), String> {
    let [width, height] = size;
    match width.saturating_mul(height) {
        0 => Err("it has no pixels".into()),
        1..=PIXELS_MAX => Ok(()),
        _ => Err(format!(
            "it has {width} × {height} pixels, more than {PIXELS_MAX}"
        )),
    }
}

/// Codes of 8 bits in [0, 1].
fn unit(codes: &[u8]) -> Vec<f64> {
    codes
        .iter()
        .map(|&code| f64::from(code) / f64::from(u8::MAX))
        .collect()
}

/// The linear value of an sRGB code in [0, 1] (IEC 61966-2-1).
fn linear(code: f64) -> f64 {
    match code <= 0.04045 {
        true => code / 12.92,
        false => ((code + 0.055) / 1.055).powf(2.4),
    }
}

fn luminance(rgb: [f64; 3]) -> f64 {
    (0..3).map(|c| LUMINANCE[c] * rgb[c]).sum()
}
