//! What a training loss is to the kernel: features of queries, and the loss of their outputs.

use bake_runtime::simd::Simd;
use std::ops::Range;

/// A loss over numbered queries. Both functions are compiled with the tier's instructions where they are
/// `#[inline(always)]`; `simd` makes its vectors, and planes are as unit-stride as vectors want them.
pub trait TileLoss: Sync {
    /// Writes the features of `queries`, one row per query and column. Rows come as zeros.
    fn features<S: Simd>(&self, simd: S, queries: Range<usize>, rows: &mut Features);

    /// The sum of the losses of `queries`, whose `outputs` are given, and its gradient by every output, which
    /// comes as zeros.
    fn loss<S: Simd>(
        &self,
        simd: S,
        queries: Range<usize>,
        outputs: &Outputs,
        gradient: &mut OutputsMut,
    ) -> f64;
}

/// Rows of features of a tile: of values (column 0) and of their derivatives along each tangent.
pub struct Features<'a> {
    rows: &'a mut [f32],
    stride: usize,
    width: usize,
    block: usize,
}

impl<'a> Features<'a> {
    pub(super) fn new(rows: &'a mut [f32], stride: usize, width: usize, block: usize) -> Features<'a> {
        Features {
            rows,
            stride,
            width,
            block,
        }
    }

    /// The features of `query`, counted from the tile's first, in `column`.
    #[inline(always)]
    pub fn row(&mut self, column: usize, query: usize) -> &mut [f32] {
        let start = (column * self.block + query) * self.stride;
        &mut self.rows[start..start + self.width]
    }
}

/// Outputs of a tile, one plane per column and output.
pub struct Outputs<'a> {
    planes: &'a [f32],
    outputs: usize,
    count: usize,
}

impl<'a> Outputs<'a> {
    pub(super) fn new(planes: &'a [f32], outputs: usize, count: usize) -> Outputs<'a> {
        Outputs {
            planes,
            outputs,
            count,
        }
    }

    /// `output` of every query of the tile, in order: its value in column 0, then its derivative along each
    /// tangent.
    #[inline(always)]
    pub fn plane(&self, column: usize, output: usize) -> &'a [f32] {
        let start = (column * self.outputs + output) * self.count;
        &self.planes[start..start + self.count]
    }
}

/// [`Outputs`] to be written.
pub struct OutputsMut<'a> {
    planes: &'a mut [f32],
    outputs: usize,
    count: usize,
}

impl<'a> OutputsMut<'a> {
    pub(super) fn new(planes: &'a mut [f32], outputs: usize, count: usize) -> OutputsMut<'a> {
        OutputsMut {
            planes,
            outputs,
            count,
        }
    }

    /// As [`Outputs::plane`].
    #[inline(always)]
    pub fn plane(&mut self, column: usize, output: usize) -> &mut [f32] {
        let start = (column * self.outputs + output) * self.count;
        &mut self.planes[start..start + self.count]
    }
}
