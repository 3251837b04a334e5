//! Numbers that start on a cache line, so that no vector straddles two.

use std::ops::{Deref, DerefMut};

/// f32 in a cache line.
const LINE: usize = 16;

/// A buffer of f32 whose first one starts a cache line of 64 bytes.
#[derive(Debug, Default)]
pub struct Aligned {
    numbers: Vec<f32>,
    start: usize,
    length: usize,
}

impl Aligned {
    /// `length` zeros.
    pub fn zeros(length: usize) -> Aligned {
        let numbers = vec![0.0f32; length + LINE];
        // The offset is below a line; a platform that does not tell it only loses speed.
        let start = numbers.as_ptr().align_offset(LINE * size_of::<f32>()).min(LINE);
        Aligned {
            numbers,
            start,
            length,
        }
    }
}

impl Deref for Aligned {
    type Target = [f32];

    #[inline(always)]
    fn deref(&self) -> &[f32] {
        &self.numbers[self.start..self.start + self.length]
    }
}

impl DerefMut for Aligned {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.numbers[self.start..self.start + self.length]
    }
}
