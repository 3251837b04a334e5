//! Layers on whole vectors of queries. Lanes are queries; a block of output rows × query columns stays in registers while
//! it runs over the inputs, so every weight is loaded once per block. Short activations are applied before the block
//! leaves its registers, long ones to whole panels.

use super::columns::{Activate, Columns};
use super::layer::{Layer, PANEL, Panel};
use super::vector::Vector;

impl Layer {
    /// Writes its rows to `out` from `inputs`, which has a row for all of its inputs.
    #[inline(always)]
    pub fn run<V: Vector, C: Columns<V, N>, A: Activate, const N: usize>(
        &self,
        inputs: &[[V; N]],
        out: &mut [[V; N]],
    ) {
        for (p, out) in out[..self.outputs()].chunks_mut(PANEL).enumerate() {
            let block = Block {
                layer: self,
                weights: self.panel(p),
                bias: &self.bias()[p * PANEL..],
                inputs: &inputs[..self.inputs()],
            };
            block.rows::<C, A>(out);
            if !A::IS_SHORT {
                // Once for the whole panel: after every block, the processor would wait for the end of the formula.
                C::finish_all::<A>(out);
            }
        }
    }
}

/// One panel on its way through a tile.
struct Block<'a, V, const N: usize> {
    layer: &'a Layer,
    weights: &'a [Panel],
    bias: &'a [f32],
    inputs: &'a [[V; N]],
}

impl<V: Vector, const N: usize> Block<'_, V, N> {
    /// Writes the sums of all rows to `out`, behind a short activation, in blocks that fit into the registers with their
    /// inputs and a weight.
    #[inline(always)]
    fn rows<C: Columns<V, N>, A: Activate>(&self, out: &mut [[V; N]]) {
        let mut at = 0;
        match (N, V::REGISTERS) {
            (1, 32..) => at = self.blocks::<C, A, 16>(at, out),
            (1, _) | (2, 32..) => at = self.blocks::<C, A, 8>(at, out),
            // Six and twice five: four would have too few sums to hide that each waits for the one before.
            (2, _) if out.len() == PANEL => {
                at = self.blocks::<C, A, 6>(at, &mut out[..6]);
                at = self.blocks::<C, A, 5>(at, out);
            }
            (2, _) => {
                at = self.blocks::<C, A, 6>(at, out);
                at = self.blocks::<C, A, 5>(at, out);
            }
            // The outputs of a sampling network.
            (4, 32..) if out.len() == 5 => at = self.blocks::<C, A, 5>(at, out),
            (3, 32..) => at = self.blocks::<C, A, 8>(at, out),
            (3.., ..32) => at = self.blocks::<C, A, 3>(at, out),
            _ => {}
        }
        if N < 3 || V::REGISTERS >= 32 {
            at = self.blocks::<C, A, 4>(at, out);
        }
        at = self.blocks::<C, A, 2>(at, out);
        self.blocks::<C, A, 1>(at, out);
    }

    /// Writes the sums of the rows of `out` from `at` on, as long as there are `R` of them; the first that is left.
    #[inline(always)]
    fn blocks<C: Columns<V, N>, A: Activate, const R: usize>(&self, at: usize, out: &mut [[V; N]]) -> usize {
        let (blocks, _) = out[at..].as_chunks_mut::<R>();
        for (block, out) in blocks.iter_mut().enumerate() {
            // Whole first: a loop that picks rows out of the sums would keep them in memory throughout.
            *out = self.sums::<C, R>(at + R * block);
            if A::IS_SHORT {
                C::finish::<A, R>(out);
            }
        }
        at + R * blocks.len()
    }

    /// The sums of the `R` rows from `at` on.
    #[inline(always)]
    fn sums<C: Columns<V, N>, const R: usize>(&self, at: usize) -> [[V; N]; R] {
        assert!(at + R <= PANEL);
        let zero = self.inputs[0][0].splat(0.0);
        let mut sums = [[zero; N]; R];
        for live in self.layer.live() {
            let weights = &self.weights[live.clone()];
            for (panel, input) in weights.iter().zip(&self.inputs[live.clone()]) {
                for (sum, &weight) in sums.iter_mut().zip(&panel.0[at..at + R]) {
                    let weight = zero.splat(weight);
                    for (sum, &input) in sum.iter_mut().zip(input) {
                        *sum = weight.mul_add(input, *sum);
                    }
                }
            }
        }
        // The bias comes last, as in other engines' matrix products: the same order of the same roundings leaves the
        // fewest differences from them.
        for (sum, &bias) in sums.iter_mut().zip(&self.bias[at..at + R]) {
            C::add_bias(sum, zero.splat(bias));
        }
        sums
    }
}
