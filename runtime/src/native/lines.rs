//! Layers on few queries. Lanes are rows of a layer: a query alone would leave the lanes of [`super::kernel`] empty.
//!
//! Every sum is made of the same products in the same order as there, so that both give the same bits.

use super::columns::{Activate, Columns};
use super::layer::{Layer, PANEL, Panel};
use super::vector::Vector;

/// Most columns that go through a layer together: queries, or the value and tangents of one.
pub const LINES_MAX: usize = 4;

/// Columns of numbers: one line of numbers for each, whole panels long.
pub type Lines = [Vec<f32>; LINES_MAX];

/// Queries of a tile up to which lines are faster than a vector of queries: with more, fewer lanes of that are empty.
pub const fn few<V: Vector>() -> usize {
    V::LANES * 3 / 8
}

impl Layer {
    /// Writes its rows to the first `K` lines of `to`, up to whole panels, from those of `from`; `zero` is only the proof.
    #[inline(always)]
    pub fn run_lines<V: Vector, C: Columns<V, K>, A: Activate, const K: usize>(
        &self,
        zero: V,
        from: &Lines,
        to: &mut Lines,
    ) {
        let vectors = self.outputs().div_ceil(V::LANES);
        // Sums wait for the sum before them, so several vectors take turns; more than these would not stay in registers.
        let mut at = 0;
        if K == 1 {
            while at + 8 <= vectors {
                self.block::<V, C, A, K, 8>(zero, at, from, to);
                at += 8;
            }
        }
        if K < LINES_MAX {
            while at + 4 <= vectors {
                self.block::<V, C, A, K, 4>(zero, at, from, to);
                at += 4;
            }
        }
        while at + 2 <= vectors {
            self.block::<V, C, A, K, 2>(zero, at, from, to);
            at += 2;
        }
        while at < vectors {
            self.block::<V, C, A, K, 1>(zero, at, from, to);
            at += 1;
        }
    }

    /// `B` vectors of rows from vector `first` on.
    #[inline(always)]
    fn block<V: Vector, C: Columns<V, K>, A: Activate, const K: usize, const B: usize>(
        &self,
        zero: V,
        first: usize,
        from: &Lines,
        to: &mut Lines,
    ) {
        let per_panel = PANEL / V::LANES;
        let mut panels: [&[Panel]; B] = [&[]; B];
        for (b, panel) in panels.iter_mut().enumerate() {
            *panel = self.panel((first + b) / per_panel);
        }
        let mut sums = [[zero; K]; B];
        for live in self.live() {
            // All as long as each other, which spares the loop its checks.
            let count = live.len();
            let mut weights = panels;
            for weights in &mut weights {
                *weights = &weights[live.clone()][..count];
            }
            let mut lines: [&[f32]; K] = [&[]; K];
            for (line, from) in lines.iter_mut().zip(from) {
                *line = &from[live.clone()][..count];
            }
            for i in 0..count {
                let mut inputs = [zero; K];
                for (input, line) in inputs.iter_mut().zip(&lines) {
                    *input = zero.splat(line[i]);
                }
                for (b, (sums, panel)) in sums.iter_mut().zip(&weights).enumerate() {
                    let weight = zero.load(&V::arrays(&panel[i].0)[(first + b) % per_panel]);
                    for (sum, &input) in sums.iter_mut().zip(&inputs) {
                        *sum = weight.mul_add(input, *sum);
                    }
                }
            }
        }
        for (b, sums) in sums.iter_mut().enumerate() {
            C::add_bias(sums, zero.load(&V::arrays(self.bias())[first + b]));
        }
        C::finish::<A, B>(&mut sums);
        for (b, sums) in sums.iter().enumerate() {
            for (value, line) in sums.iter().zip(&mut *to) {
                value.write(&mut V::arrays_mut(line)[first + b]);
            }
        }
    }
}
