//! The dark paper on which pictures are laid out, with their captions.

use crate::error::Result;
use crate::label;
use crate::picture::write_codes;
use std::path::Path;

/// Pixels between pictures and around them.
pub const MARGIN: usize = 12;

/// Pixels between lines of text, and between a caption and its picture.
pub const LEADING: usize = 4;

/// Codes of the paper, of text, and of text that can be overlooked.
pub const PAPER: [u8; 3] = [28, 29, 31];
pub const INK: [u8; 3] = [226, 228, 232];
pub const FAINT: [u8; 3] = [148, 152, 160];

/// A picture of sRGB codes.
pub struct Sheet {
    width: usize,
    height: usize,
    codes: Vec<u8>,
}

impl Sheet {
    /// Blank paper.
    pub fn new(width: usize, height: usize) -> Sheet {
        Sheet {
            width,
            height,
            codes: PAPER.repeat(width * height),
        }
    }

    /// Sets a pixel; one outside the sheet is left out.
    pub fn put(&mut self, x: usize, y: usize, code: [u8; 3]) {
        if x < self.width && y < self.height {
            let first = 3 * (y * self.width + x);
            self.codes[first..first + 3].copy_from_slice(&code);
        }
    }

    /// The code of a pixel; outside it is paper.
    pub fn at(&self, x: usize, y: usize) -> [u8; 3] {
        match x < self.width && y < self.height {
            true => std::array::from_fn(|c| self.codes[3 * (y * self.width + x) + c]),
            false => PAPER,
        }
    }

    /// Writes a line of `text` of the given height, its top left corner at `corner`.
    pub fn text(&mut self, corner: [usize; 2], height: usize, ink: [u8; 3], text: &str) {
        label::draw(text, height, |x, y, share| {
            let (x, y) = (corner[0] + x, corner[1] + y);
            self.put(x, y, mixed(self.at(x, y), ink, share));
        });
    }

    /// Makes it at least `height` high.
    pub fn extend(&mut self, height: usize) {
        if height > self.height {
            self.height = height;
            let missing = self.width * height - self.codes.len() / 3;
            self.codes.extend(PAPER.repeat(missing));
        }
    }

    /// Writes `text` into a column `room` pixels wide, in as many lines as it takes, and gives the row below the last.
    pub fn paragraph(
        &mut self,
        corner: [usize; 2],
        room: usize,
        height: usize,
        ink: [u8; 3],
        text: &str,
    ) -> usize {
        let mut top = corner[1];
        for line in label::wrap(text, height, room) {
            self.extend(top + height + LEADING);
            self.text([corner[0], top], height, ink, &line);
            top += height + LEADING;
        }
        top
    }

    /// Lays down a square of codes, `side`², row by row from the top, its top left corner at `corner`.
    pub fn tile(&mut self, corner: [usize; 2], side: usize, codes: &[[u8; 3]]) {
        for (k, code) in codes.iter().enumerate() {
            self.put(corner[0] + k % side, corner[1] + k / side, *code);
        }
    }

    /// Writes it as PNG, whole or not at all.
    ///
    /// # Errors
    /// See [`write_codes`].
    pub fn write(&self, path: &Path) -> Result<()> {
        write_codes(path, [self.width, self.height], &self.codes)
    }
}

/// `a` where `share` is 0 or less, `b` where it is 1 or more.
pub fn mixed(a: [u8; 3], b: [u8; 3], share: f32) -> [u8; 3] {
    let share = share.clamp(0.0, 1.0);
    std::array::from_fn(|c| (f32::from(a[c]) + share * (f32::from(b[c]) - f32::from(a[c]))).round() as u8)
}
