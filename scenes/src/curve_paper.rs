//! The white paper on which plotters draws, finer than the picture, and writes with our labels.
//!
//! plotters places everything on whole pixels, so that slanted lines are ragged; and of the fonts that it can use
//! without those of the system it drops the space before a letter, which shows in a monospaced one.

use crate::error::Result;
use crate::label;
use crate::picture::write_codes;
use crate::sheet::mixed;
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{BackendColor, BackendCoord, BackendTextStyle, DrawingBackend, DrawingErrorKind};
use std::convert::Infallible;
use std::path::Path;

/// Pixels drawn across and down for one of the picture.
pub const FINE: usize = 3;

/// A white picture of sRGB codes.
pub struct Paper {
    /// Width and height, fine pixels.
    size: [usize; 2],
    codes: Vec<[u8; 3]>,
}

impl Paper {
    /// Blank paper for a picture of `size` = width, height, pixels.
    pub fn new(size: [usize; 2]) -> Paper {
        let size = size.map(|pixels| FINE * pixels);
        Paper {
            size,
            codes: vec![[u8::MAX; 3]; size[0] * size[1]],
        }
    }

    /// Writes the picture, each pixel the mean of its [`FINE`]² fine ones, as PNG, whole or not at all.
    ///
    /// # Errors
    /// See [`write_codes`].
    pub fn write(&self, path: &Path) -> Result<()> {
        let size = self.size.map(|pixels| pixels / FINE);
        let mut sums = vec![0; 3 * size[0] * size[1]];
        for (k, code) in self.codes.iter().enumerate() {
            let [x, y] = [k % self.size[0], k / self.size[0]].map(|pixel| pixel / FINE);
            let pixel = 3 * (y * size[0] + x);
            code.iter()
                .enumerate()
                .for_each(|(c, v)| sums[pixel + c] += usize::from(*v));
        }
        let means: Vec<u8> = sums.into_iter().map(|sum| (sum / (FINE * FINE)) as u8).collect();
        write_codes(path, size, &means)
    }

    /// Blends `share` of `ink` into a pixel; one outside the paper is left out.
    fn blend(&mut self, (x, y): BackendCoord, ink: [u8; 3], share: f32) {
        let [width, height] = self.size;
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else {
            return;
        };
        if x < width && y < height {
            let code = &mut self.codes[y * width + x];
            *code = mixed(*code, ink, share);
        }
    }
}

/// What cannot fail.
type Drawn = std::result::Result<(), DrawingErrorKind<Infallible>>;

impl DrawingBackend for &mut Paper {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        let [width, height] = self.size.map(|pixels| pixels as u32);
        (width, height)
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        Ok(())
    }

    fn draw_pixel(&mut self, point: BackendCoord, colour: BackendColor) -> Drawn {
        let (r, g, b) = colour.rgb;
        self.blend(point, [r, g, b], colour.alpha as f32);
        Ok(())
    }

    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, at: BackendCoord) -> Drawn {
        let (width, height) = self.estimate_text_size(text, style)?;
        let anchor = style.anchor();
        let left = match anchor.h_pos {
            HPos::Left => 0,
            HPos::Center => -(width as i32) / 2,
            HPos::Right => -(width as i32),
        };
        let top = match anchor.v_pos {
            VPos::Top => 0,
            VPos::Center => -(height as i32) / 2,
            VPos::Bottom => -(height as i32),
        };
        let BackendColor {
            alpha,
            rgb: (r, g, b),
        } = style.color();
        label::draw(text, height as usize, |x, y, share| {
            let (x, y) = style.transform().transform(left + x as i32, top + y as i32);
            self.blend((at.0 + x, at.1 + y), [r, g, b], alpha as f32 * share);
        });
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> std::result::Result<(u32, u32), DrawingErrorKind<Infallible>> {
        let height = style.size() as usize;
        Ok((label::width(text, height) as u32, height as u32))
    }
}
