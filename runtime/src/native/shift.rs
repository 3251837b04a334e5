//! The shift g of a warp, or the position on the disk, with its derivatives by u: the part of a sampling network that u
//! goes through, on a value and two tangents side by side.

use super::columns::{Activate, Columns, Linear, Relu, Silu, TANGENT_COLUMNS, Tangents};
use super::encode::{Feature, encode_tangents};
use super::layer::{Layer, PANEL};
use super::program::Program;
use super::scratch::SlopeBuffers;
use super::stack::{Stack, is_few};
use super::tile::Column;
use super::vector::{Simd, Task, Vector, lanes};
use crate::encoding::{Encoding, Quantity};
use crate::spec::Activation;

/// Outputs of a sampling network that make the position.
const COORDINATES: usize = 2;

/// A value and its derivatives by u₀ and u₁.
pub type Slopes<V> = [V; TANGENT_COLUMNS];

/// See the top of the file.
pub struct Shift {
    /// The first layer.
    pub first: Layer,
    /// The first layer without what u adds to it.
    pub others: Layer,
    /// The inputs of that.
    pub other_inputs: Vec<Feature>,
    /// What u adds to the first layer.
    own: Layer,
    /// How u enters.
    own_inputs: Vec<Feature>,
    /// The tangents of the first layer, where they do not depend on u; whole panels long.
    constant: Option<[Vec<f32>; 2]>,
    /// What follows the first layer.
    rest: Stack,
}

impl Shift {
    /// The shift of the sampling network `program`.
    pub fn new(program: &Program) -> Self {
        let mut layers = program.net.hidden.clone();
        // The weight needs no tangents.
        layers.extend(program.net.last.as_ref().map(|last| last.first_rows(COORDINATES)));
        let first = layers.remove(0);
        let last = layers.pop();
        let (own_inputs, other_inputs): (Vec<Feature>, Vec<Feature>) = program
            .inputs
            .iter()
            .cloned()
            .partition(|input| input.quantity == Quantity::U);
        let rows = |inputs: &[Feature]| inputs.iter().map(|input| input.rows.clone()).collect();
        let constant = own_inputs
            .iter()
            .all(|input| matches!(input.encoding, Encoding::Centred | Encoding::Identity))
            .then(|| constant_slopes(&first, &own_inputs));
        Shift {
            others: first.of_inputs(rows(&other_inputs)),
            own: first.of_inputs(rows(&own_inputs)).without_bias(),
            rest: Stack {
                activation: program.net.activation,
                inputs: first.outputs(),
                hidden: layers,
                last,
            },
            first,
            own_inputs,
            other_inputs,
            constant,
        }
    }
}

/// Runs a shift on the tiles of a batch.
pub struct Shifter<'a, V> {
    /// The shift.
    pub shift: &'a Shift,
    /// Where it runs.
    pub buffers: &'a mut SlopeBuffers<V>,
    /// Queries of the tile that count.
    pub live: usize,
}

impl<V: Vector> Shifter<'_, V> {
    /// Both coordinates for vector `q` of the first layer's `sums`, which `u` has entered.
    #[inline(always)]
    pub fn after<S: Simd<Vector = V>, const N: usize>(
        &mut self,
        simd: S,
        sums: &[Column<V, N>],
        q: usize,
        u: [V; 2],
    ) -> [Slopes<V>; COORDINATES] {
        self.run(simd, sums, q, u, true)
    }

    /// Both coordinates for vector `q` of the sums of [`Shift::others`], and for `u`.
    #[inline(always)]
    pub fn at<S: Simd<Vector = V>, const N: usize>(
        &mut self,
        simd: S,
        sums: &[Column<V, N>],
        q: usize,
        u: [V; 2],
    ) -> [Slopes<V>; COORDINATES] {
        self.run(simd, sums, q, u, false)
    }

    #[inline(always)]
    fn run<S: Simd<Vector = V>, const N: usize>(
        &mut self,
        simd: S,
        sums: &[Column<V, N>],
        q: usize,
        u: [V; 2],
        entered: bool,
    ) -> [Slopes<V>; COORDINATES] {
        let mut out = [[simd.splat(0.0); TANGENT_COLUMNS]; COORDINATES];
        simd.enter(Enter {
            shift: self.shift,
            buffers: self.buffers,
            live: self.live,
            sums,
            q,
            u,
            entered,
            out: &mut out,
        });
        out
    }
}

/// Both ways to run a shift: a task of its own, so that they share one copy of its code.
struct Enter<'a, V, const N: usize> {
    shift: &'a Shift,
    buffers: &'a mut SlopeBuffers<V>,
    live: usize,
    sums: &'a [Column<V, N>],
    q: usize,
    u: [V; 2],
    /// Whether u is in the sums.
    entered: bool,
    out: &'a mut [Slopes<V>; COORDINATES],
}

impl<V: Vector, const N: usize> Task for Enter<'_, V, N> {
    #[inline(always)]
    fn run(self) {
        match (&self.shift.rest.last, self.shift.rest.activation) {
            (None, _) => self.activate::<Linear>(),
            (Some(_), Activation::Silu) => self.activate::<Silu>(),
            (Some(_), Activation::Relu) => self.activate::<Relu>(),
        }
    }
}

impl<V: Vector, const N: usize> Enter<'_, V, N> {
    #[inline(always)]
    fn activate<A: Activate>(self) {
        match is_few::<V, N>(self.live) {
            true => self.lines::<A>(),
            false => self.rows::<A>(),
        }
    }

    /// A vector of queries at a time.
    #[inline(always)]
    fn rows<A: Activate>(self) {
        let shift = self.shift;
        let SlopeBuffers { entry, layers } = self.buffers;
        let entry_rows = &mut layers.input()[..self.sums.len()];
        let entered = self.sums.iter().zip(&mut *entry_rows);
        match shift.constant.as_ref().filter(|_| self.entered) {
            Some([along_x, along_y]) => {
                for ((sum, row), (&dx, &dy)) in entered.zip(along_x.iter().zip(along_y)) {
                    let x = sum[self.q];
                    *row = [x, x.splat(dx), x.splat(dy)];
                }
            }
            None => {
                encode_tangents(&shift.own_inputs, self.u, entry.input());
                let own = entry.tangent_sums(&shift.own);
                for ((sum, row), &[x, dx, dy]) in entered.zip(own) {
                    let sum = sum[self.q];
                    let x = if self.entered { sum } else { sum + x };
                    *row = [x, dx, dy];
                }
            }
        }
        Tangents::finish_all::<A>(entry_rows);
        let rows = layers.layers::<Tangents, A>(&shift.rest);
        *self.out = [rows[0], rows[1]];
    }

    /// One query at a time, of the few there are.
    #[inline(always)]
    fn lines<A: Activate>(self) {
        let (shift, zero) = (self.shift, self.u[0].splat(0.0));
        let SlopeBuffers { entry, layers } = self.buffers;
        let constant = shift.constant.as_ref().filter(|_| self.entered);
        if constant.is_none() {
            encode_tangents(&shift.own_inputs, self.u, entry.input());
        }
        let vectors = shift.first.outputs().div_ceil(V::LANES);
        let mut out = [[lanes(zero); TANGENT_COLUMNS]; COORDINATES];
        for query in 0..self.live {
            for (sum, to) in self.sums.iter().zip(&mut layers.lines[0][0]) {
                *to = lanes(sum[self.q])[query];
            }
            if constant.is_none() {
                entry.line_sums(&shift.own, query, zero);
            }
            let from = &mut layers.lines[0];
            for v in 0..vectors {
                let x = zero.load(&V::arrays(&from[0])[v]);
                let row = match constant {
                    Some([along_x, along_y]) => {
                        let [dx, dy] = [along_x, along_y].map(|slopes| &V::arrays(slopes)[v]);
                        [x, zero.load(dx), zero.load(dy)]
                    }
                    None => {
                        let own = &entry.lines[1];
                        let at = |line: usize| &V::arrays(&own[line])[v];
                        let own = [zero.load(at(0)), zero.load(at(1)), zero.load(at(2))];
                        let x = if self.entered { x } else { x + own[0] };
                        [x, own[1], own[2]]
                    }
                };
                for (value, line) in A::tangents(row).into_iter().zip(&mut *from) {
                    value.write(&mut V::arrays_mut(line)[v]);
                }
            }
            let rows = shift
                .rest
                .run_lines::<V, Tangents, A, TANGENT_COLUMNS>(zero, &mut layers.lines);
            for (c, out) in out.iter_mut().enumerate() {
                for (out, line) in out.iter_mut().zip(&layers.lines[rows]) {
                    out[query] = line[c];
                }
            }
        }
        for (to, from) in self.out.iter_mut().zip(&out) {
            for (to, from) in to.iter_mut().zip(from) {
                *to = zero.load(&V::arrays(from)[0]);
            }
        }
    }
}

/// ∂(first layer)/∂u per row, from what `inputs` of u alone add to it; whole panels long.
fn constant_slopes(first: &Layer, inputs: &[Feature]) -> [Vec<f32>; 2] {
    [0, 1].map(|coordinate: usize| {
        let slope = |row: usize| {
            let terms = inputs.iter().map(|input| {
                let slope = if input.encoding == Encoding::Centred {
                    2.0
                } else {
                    1.0
                };
                slope * first.weight(row, input.rows.start + coordinate)
            });
            terms.sum()
        };
        let mut slopes: Vec<f32> = (0..first.outputs()).map(slope).collect();
        slopes.resize(first.outputs().next_multiple_of(PANEL), 0.0);
        slopes
    })
}
