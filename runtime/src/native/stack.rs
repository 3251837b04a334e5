//! Layers that follow each other, and the buffers they go through.

use super::columns::{Activate, Columns, Linear, Relu, Silu, TANGENT_COLUMNS, Tangents, Values};
use super::layer::{Layer, PANEL};
use super::lines::{LINES_MAX, Lines, few};
use super::vector::{Simd, Task, Vector, lanes};
use crate::spec::Activation;
use std::marker::PhantomData;

/// Hidden layers with an activation, and a last one without.
#[derive(Clone)]
pub struct Stack {
    /// Nonlinearity of the hidden layers.
    pub activation: Activation,
    /// Number of rows that enter.
    pub inputs: usize,
    /// Hidden layers.
    pub hidden: Vec<Layer>,
    /// The last layer; without it the rows of the layer before stand.
    pub last: Option<Layer>,
}

impl Stack {
    /// Number of rows that leave.
    pub fn outputs(&self) -> usize {
        let last = self.last.as_ref().or(self.hidden.last());
        last.map_or(self.inputs, Layer::outputs)
    }

    /// Which of two buffers that are written alternately holds the rows of the last layer, if the first is its input.
    #[inline(always)]
    fn ends_in(&self) -> usize {
        (self.hidden.len() + usize::from(self.last.is_some())) % 2
    }

    /// Runs all layers on the first `K` of `lines[0]`; which of `lines` holds the rows of the last.
    #[inline(always)]
    pub fn run_lines<V: Vector, C: Columns<V, K>, A: Activate, const K: usize>(
        &self,
        zero: V,
        lines: &mut [Lines; 2],
    ) -> usize {
        let [first, second] = lines;
        let (mut from, mut to) = (first, second);
        for layer in &self.hidden {
            layer.run_lines::<V, C, A, K>(zero, from, to);
            std::mem::swap(&mut from, &mut to);
        }
        if let Some(last) = &self.last {
            last.run_lines::<V, C, Linear, K>(zero, from, to);
        }
        self.ends_in()
    }
}

/// Buffers that layers write alternately: rows of vectors, and for few queries lines of numbers.
pub struct Buffers<V, const N: usize> {
    rows: [Vec<[V; N]>; 2],
    /// What [`Buffers::keep`] kept.
    kept: Vec<[V; N]>,
    /// As long as `rows`, up to whole panels.
    pub lines: [Lines; 2],
}

impl<V: Vector, const N: usize> Buffers<V, N> {
    /// Buffers for layers of no rows; see [`Buffers::fit`].
    pub const EMPTY: Self = Buffers {
        rows: [const { Vec::new() }; 2],
        kept: Vec::new(),
        lines: [const { [const { Vec::new() }; LINES_MAX] }; 2],
    };

    /// Makes room for layers of up to `width` rows.
    pub fn fit(&mut self, width: usize, zero: V) {
        if self.rows[0].len() < width {
            self.rows = [vec![[zero; N]; width], vec![[zero; N]; width]];
            self.kept = vec![[zero; N]; width];
            let whole = width.next_multiple_of(PANEL);
            for line in self.lines.as_flattened_mut() {
                line.resize(whole, 0.0);
            }
        }
    }

    /// The buffer whose rows [`Buffers::run`] takes as input.
    #[inline(always)]
    pub fn input(&mut self) -> &mut [[V; N]] {
        &mut self.rows[0]
    }

    /// Keeps the first `count` rows of [`Buffers::input`] from what layers write there.
    #[inline(always)]
    pub fn keep(&mut self, count: usize) {
        self.kept[..count].copy_from_slice(&self.rows[0][..count]);
    }

    /// [`Buffers::input`], and the rows that are kept.
    #[inline(always)]
    pub fn input_and_kept(&mut self) -> (&mut [[V; N]], &[[V; N]]) {
        (&mut self.rows[0], &self.kept)
    }

    /// Runs `stack` on the first rows of [`Buffers::input`], as many as it takes, of which the first `live` queries count;
    /// the rows of its last layer.
    #[inline(always)]
    pub fn run<S: Simd<Vector = V>>(&mut self, simd: S, stack: &Stack, live: usize) -> &[[V; N]] {
        let mut out = 0;
        simd.enter(Forward {
            buffers: self,
            stack,
            live,
            out: &mut out,
        });
        &self.rows[out][..stack.outputs()]
    }

    /// Runs `layer` alone on the first rows of [`Buffers::input`], without an activation, as [`Buffers::run`] does.
    #[inline(always)]
    pub fn sums<S: Simd<Vector = V>>(&mut self, simd: S, layer: &Layer, live: usize) -> &[[V; N]] {
        if is_few::<V, N>(live) {
            self.by_lines(simd.splat(0.0), live, layer);
        } else {
            let [from, to] = &mut self.rows;
            layer.run::<V, Values, Linear, N>(from, to);
        }
        &self.rows[1][..layer.outputs()]
    }

    /// Runs all layers of `stack` on other columns, compiled into its caller; the rows of the last.
    #[inline(always)]
    pub fn layers<C: Columns<V, N>, A: Activate>(&mut self, stack: &Stack) -> &[[V; N]] {
        let out = self.run_layers::<C, A>(stack);
        &self.rows[out][..stack.outputs()]
    }

    /// Runs all layers of `stack`, from the first buffer on; which buffer holds the rows of the last.
    #[inline(always)]
    fn run_layers<C: Columns<V, N>, A: Activate>(&mut self, stack: &Stack) -> usize {
        let [first, second] = &mut self.rows;
        let (mut from, mut to) = (first, second);
        for layer in &stack.hidden {
            layer.run::<V, C, A, N>(from, to);
            std::mem::swap(&mut from, &mut to);
        }
        if let Some(last) = &stack.last {
            last.run::<V, C, Linear, N>(from, to);
        }
        stack.ends_in()
    }

    /// Takes the first `live` queries, [`LINES_MAX`] or one at a time, from the first rows to lines, through `layers`, and
    /// to the second rows.
    #[inline(always)]
    fn by_lines(&mut self, zero: V, live: usize, layers: &impl Chain) {
        let Buffers {
            rows: [from, to],
            lines,
            ..
        } = self;
        let mut at = 0;
        while at < live {
            let count = LINES_MAX.min(live - at);
            for (i, row) in from[..layers.inputs()].iter().enumerate() {
                let lanes = lanes(row[0]);
                for (k, line) in lines[0][..count].iter_mut().enumerate() {
                    line[i] = lanes[at + k];
                }
            }
            let out = match count {
                1 => layers.run::<V, 1>(zero, lines),
                _ => layers.run::<V, LINES_MAX>(zero, lines),
            };
            for (i, row) in to[..layers.outputs()].iter_mut().enumerate() {
                let mut lanes = lanes(row[0]);
                for (k, line) in lines[out][..count].iter().enumerate() {
                    lanes[at + k] = line[i];
                }
                row[0] = zero.load(&V::arrays(&lanes)[0]);
            }
            at += count;
        }
    }
}

/// What lines of queries go through.
trait Chain {
    /// Number of rows that enter.
    fn inputs(&self) -> usize;

    /// Number of rows that leave.
    fn outputs(&self) -> usize;

    /// Runs the first `K` of `lines[0]`; which of `lines` holds the result.
    fn run<V: Vector, const K: usize>(&self, zero: V, lines: &mut [Lines; 2]) -> usize;
}

/// A layer alone, without an activation.
impl Chain for Layer {
    fn inputs(&self) -> usize {
        self.inputs()
    }

    fn outputs(&self) -> usize {
        self.outputs()
    }

    #[inline(always)]
    fn run<V: Vector, const K: usize>(&self, zero: V, lines: &mut [Lines; 2]) -> usize {
        let [from, to] = lines;
        self.run_lines::<V, Values, Linear, K>(zero, from, to);
        1
    }
}

/// A stack with its activation as a type.
struct Activated<'a, A>(&'a Stack, PhantomData<A>);

impl<A: Activate> Chain for Activated<'_, A> {
    fn inputs(&self) -> usize {
        self.0.inputs
    }

    fn outputs(&self) -> usize {
        self.0.outputs()
    }

    #[inline(always)]
    fn run<V: Vector, const K: usize>(&self, zero: V, lines: &mut [Lines; 2]) -> usize {
        self.0.run_lines::<V, Values, A, K>(zero, lines)
    }
}

impl<V: Vector> Buffers<V, TANGENT_COLUMNS> {
    /// The sums of `layer` on the first rows, values and tangents.
    #[inline(always)]
    pub fn tangent_sums(&mut self, layer: &Layer) -> &[[V; TANGENT_COLUMNS]] {
        let [from, to] = &mut self.rows;
        layer.run::<V, Tangents, Linear, TANGENT_COLUMNS>(from, to);
        &to[..layer.outputs()]
    }

    /// The same of one query, in the second lines.
    #[inline(always)]
    pub fn line_sums(&mut self, layer: &Layer, query: usize, zero: V) {
        let [from, to] = &mut self.lines;
        for live in layer.live() {
            for i in live.clone() {
                for (line, column) in from.iter_mut().zip(self.rows[0][i]) {
                    line[i] = lanes(column)[query];
                }
            }
        }
        layer.run_lines::<V, Tangents, Linear, TANGENT_COLUMNS>(zero, from, to);
    }
}

/// Whether a tile of `N` vectors with `live` queries takes lines.
#[inline(always)]
pub fn is_few<V: Vector, const N: usize>(live: usize) -> bool {
    N == 1 && live <= few::<V>()
}

/// [`Buffers::run`]: a task of its own, so that all queries share one copy of its code.
struct Forward<'a, V, const N: usize> {
    buffers: &'a mut Buffers<V, N>,
    stack: &'a Stack,
    live: usize,
    out: &'a mut usize,
}

impl<V: Vector, const N: usize> Task for Forward<'_, V, N> {
    #[inline(always)]
    fn run(self) {
        match self.stack.activation {
            Activation::Silu => self.activate::<Silu>(),
            Activation::Relu => self.activate::<Relu>(),
        }
    }
}

impl<V: Vector, const N: usize> Forward<'_, V, N> {
    #[inline(always)]
    fn activate<A: Activate>(self) {
        let Forward {
            buffers,
            stack,
            live,
            out,
        } = self;
        if is_few::<V, N>(live) {
            let zero = buffers.rows[0][0][0].splat(0.0);
            buffers.by_lines(zero, live, &Activated::<A>(stack, PhantomData));
            *out = 1;
        } else {
            *out = buffers.run_layers::<Values, A>(stack);
        }
    }
}
