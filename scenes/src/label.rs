//! Short labels in pictures: angles, in letters of three by five dots.

/// Side of a dot, pixels.
const DOT: usize = 3;

/// Height of a label, pixels.
pub const HEIGHT: usize = 5 * DOT;

/// Dots from one letter to the next.
const ADVANCE: usize = 4;

/// Letters, five rows of three dots each, the left one the highest bit.
const LETTERS: [(char, [u8; 5]); 14] = [
    ('0', [0b111, 0b101, 0b101, 0b101, 0b111]),
    ('1', [0b010, 0b110, 0b010, 0b010, 0b111]),
    ('2', [0b111, 0b001, 0b111, 0b100, 0b111]),
    ('3', [0b111, 0b001, 0b111, 0b001, 0b111]),
    ('4', [0b101, 0b101, 0b111, 0b001, 0b001]),
    ('5', [0b111, 0b100, 0b111, 0b001, 0b111]),
    ('6', [0b111, 0b100, 0b111, 0b101, 0b111]),
    ('7', [0b111, 0b001, 0b010, 0b010, 0b010]),
    ('8', [0b111, 0b101, 0b111, 0b101, 0b111]),
    ('9', [0b111, 0b101, 0b111, 0b001, 0b111]),
    ('.', [0b000, 0b000, 0b000, 0b000, 0b010]),
    (' ', [0; 5]),
    ('°', [0b110, 0b110, 0b000, 0b000, 0b000]),
    ('θ', [0b010, 0b101, 0b111, 0b101, 0b010]),
];

/// Width of `text`, pixels.
pub fn width(text: &str) -> usize {
    (text.chars().count() * ADVANCE).saturating_sub(1) * DOT
}

/// Calls `put(x, y)` for every pixel of `text`, from the top left; letters that it does not know are left blank.
pub fn draw(text: &str, mut put: impl FnMut(usize, usize)) {
    for (i, letter) in text.chars().enumerate() {
        let Some((_, rows)) = LETTERS.iter().find(|(known, _)| *known == letter) else {
            continue;
        };
        for y in 0..HEIGHT {
            for x in 0..3 * DOT {
                if rows[y / DOT] >> (2 - x / DOT) & 1 == 1 {
                    put(i * ADVANCE * DOT + x, y);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_fill_their_box() {
        let text = "θ 12.5°";
        let (mut right, mut bottom, mut count) = (0, 0, 0);
        draw(text, |x, y| {
            (right, bottom, count) = (right.max(x + 1), bottom.max(y + 1), count + 1);
        });
        // The degree sign leaves its last column of dots blank.
        assert_eq!((right, bottom), (width(text) - DOT, HEIGHT));
        assert_eq!(count % (DOT * DOT), 0);
        draw("?", |_, _| panic!("an unknown letter is blank"));
    }
}
