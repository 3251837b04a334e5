//! Text in pictures: titles, captions and numbers, in the monospaced font Hack, which is bundled.
//!
//! It has ASCII and the signs of our labels: Greek letters, °, ×, ², ≤, ≥ and dashes.

use ab_glyph::{Font, FontRef, GlyphId, PxScale, ScaleFont};
use std::sync::LazyLock;

/// Height of a line of text, pixels: the smallest at which the exponents of numbers can be read.
pub const HEIGHT: usize = 16;

/// Height of a line of a heading, pixels.
pub const HEADING: usize = 22;

/// The font. It is part of the program, so a damaged one would be a mistake of the build.
static FONT: LazyLock<FontRef<'static>> = LazyLock::new(|| {
    FontRef::try_from_slice(epaint_default_fonts::HACK_REGULAR).expect("the bundled font is whole")
});

/// Whole pixels from one letter to the next in lines of `height`, so that all letters are smoothed alike.
fn advance(height: usize) -> usize {
    let font = FONT.as_scaled(PxScale::from(height as f32));
    font.h_advance(font.glyph_id('0')).round() as usize
}

/// Width of `text` in a line of `height`, pixels.
pub fn width(text: &str, height: usize) -> usize {
    text.chars().count() * advance(height)
}

/// Calls `put(x, y, share)` for every pixel of `text`, from the top left of a line of `height`; `share` in (0, 1] is
/// the part of the pixel that is inked. Letters that the font does not have are left blank.
pub fn draw(text: &str, height: usize, mut put: impl FnMut(usize, usize, f32)) {
    let scale = PxScale::from(height as f32);
    let baseline = FONT.as_scaled(scale).ascent().round();
    let step = advance(height);
    for (i, letter) in text.chars().enumerate() {
        let id = FONT.glyph_id(letter);
        if id == GlyphId(0) {
            continue;
        }
        let place = ab_glyph::point((i * step) as f32, baseline);
        let Some(outline) = FONT.outline_glyph(id.with_scale_and_position(scale, place)) else {
            continue;
        };
        let corner = outline.px_bounds().min;
        outline.draw(|x, y, share| {
            let (x, y) = (corner.x + x as f32, corner.y + y as f32);
            if share > 0.0 && x >= 0.0 && y >= 0.0 {
                put(x as usize, y as usize, share.min(1.0));
            }
        });
    }
}

/// `text` in lines of `height` that are at most `room` pixels wide, broken at spaces, and inside words that are longer.
pub fn wrap(text: &str, height: usize, room: usize) -> Vec<String> {
    let columns = (room / advance(height)).max(1);
    let mut lines = Vec::new();
    let mut line = String::new();
    let mut used = 0;
    for (i, word) in text.split(' ').enumerate() {
        if i > 0 && used + 1 + word.chars().count() <= columns {
            line.push(' ');
            used += 1;
        } else if i > 0 {
            lines.push(std::mem::take(&mut line));
            used = 0;
        }
        for letter in word.chars() {
            if used == columns {
                lines.push(std::mem::take(&mut line));
                used = 0;
            }
            line.push(letter);
            used += 1;
        }
    }
    lines.push(line);
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels by which the smoothed edge of a letter may leave its box.
    const OVERHANG: usize = 1;

    #[test]
    fn every_sign_of_our_labels_is_drawn_inside_its_box() {
        let ascii: String = (' '..='~').collect();
        for height in [HEIGHT, HEADING] {
            for letter in ascii.chars().chain("θαφ°×²≤≥–−±·…⁻¹".chars()) {
                let (mut right, mut bottom, mut ink) = (0, 0, 0.0);
                draw(&letter.to_string(), height, |x, y, share| {
                    (right, bottom, ink) = (right.max(x + 1), bottom.max(y + 1), ink + share);
                });
                assert_eq!(ink > 0.0, letter != ' ', "{letter}");
                assert!(
                    right <= width("0", height) + OVERHANG && bottom <= height + OVERHANG,
                    "{letter}: {right}, {bottom}"
                );
            }
        }
        draw("漢", HEIGHT, |_, _, _| panic!("an unknown letter is blank"));
    }

    #[test]
    fn letters_stand_side_by_side() {
        let left = |text: &str| {
            let mut left = usize::MAX;
            draw(text, HEIGHT, |x, _, _| left = left.min(x));
            left
        };
        assert_eq!(left(" 0"), left("0") + width(" ", HEIGHT));
        assert_eq!(width("θ 45°", HEIGHT), 5 * width("0", HEIGHT));
    }

    #[test]
    fn long_lines_are_broken_between_words() {
        let room = width("12345678", HEIGHT);
        assert_eq!(wrap("one two three", HEIGHT, room), ["one two", "three"]);
        assert_eq!(wrap("a 1234567890", HEIGHT, room), ["a", "12345678", "90"]);
        assert_eq!(wrap("", HEIGHT, room), [""]);
    }
}
