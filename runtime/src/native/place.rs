//! What the networks of a tile share, before u or wi enters: its cameras, where charts start from, and what the frame
//! network says.

use super::chart::{Chart, Start};
use super::encode::{Feature, Scalars};
use super::math::sigmoid;
use super::program::{Program, bind_first_layer, renumbered};
use super::stack::{Buffers, Stack};
use super::tile::{Cameras, Column, Tile, read_parameter};
use super::vector::{Simd, Task, Vector};
use crate::anchor::{ANCHOR_SCALARS, Anchor};
use crate::backend::Points;
use crate::encoding::Quantity;
use crate::frame::FRAME_OUTPUTS;
use crate::spec::{CHARTS_MAX, ChartsSpec, Input, Roughness, SHARE_MIN};

/// Outputs of a frame network with [`CHARTS_MAX`] charts.
const OUTPUTS_MAX: usize = FRAME_OUTPUTS * CHARTS_MAX + 1;

/// The charts of a network, ready for vectors.
#[derive(Clone)]
pub struct Frames {
    anchors: Vec<Anchor>,
    alpha: [Roughness; 2],
    inputs: Vec<Feature>,
    net: Stack,
    /// Whether the mirror chart is needed at all.
    mirror: bool,
    /// Whether an input takes its scalars.
    scalars: bool,
}

impl Frames {
    /// The charts of `spec` with the frame network `net`; `asked` are all inputs of the network and of its frame network.
    pub fn new<'a>(spec: &ChartsSpec, net: Stack, mut asked: impl Iterator<Item = &'a Input>) -> Frames {
        let scalars = asked.any(|input| input.quantity == Quantity::Anchor);
        Frames {
            anchors: spec.anchors.clone(),
            alpha: spec.alpha,
            inputs: Feature::all(&spec.inputs),
            net,
            mirror: scalars || spec.anchors.contains(&Anchor::Mirror),
            scalars,
        }
    }

    /// Inputs of the frame network.
    pub fn inputs(&self) -> &[Feature] {
        &self.inputs
    }

    /// See [`Program::bound`].
    pub fn bind(&mut self, values: &[Option<f64>]) {
        bind_first_layer(&mut self.net, &mut self.inputs, values);
        for alpha in &mut self.alpha {
            let all: Vec<f64> = values.iter().map(|value| value.unwrap_or(0.0)).collect();
            let known = alpha.at(&all);
            if let Roughness::Free { parameter, .. } = alpha {
                match values[*parameter] {
                    Some(_) => *alpha = Roughness::Fixed(known),
                    None => *parameter = renumbered(*parameter, values),
                }
            }
        }
    }

    /// Number of charts.
    pub fn charts(&self) -> usize {
        self.anchors.len()
    }
}

/// The shading points of one tile. Kept where it is from tile to tile: it is large, and nothing moves it.
pub struct Place<V, const N: usize> {
    /// The cameras.
    pub cameras: Cameras<V, N>,
    mirror: [Start<V>; N],
    anchor: [Column<V, N>; ANCHOR_SCALARS],
    frames: [Column<V, N>; OUTPUTS_MAX],
}

impl<V: Vector, const N: usize> Place<V, N> {
    /// No points yet; see [`Place::read`].
    pub fn none(zero: V) -> Self {
        Place {
            cameras: Cameras::none(zero),
            mirror: [Start::identity(zero); N],
            anchor: [[zero; N]; ANCHOR_SCALARS],
            frames: [[zero; N]; OUTPUTS_MAX],
        }
    }

    /// Reads `tile`, and runs the frame network of `program`.
    #[inline(always)]
    pub fn read<S: Simd<Vector = V>>(
        &mut self,
        simd: S,
        program: &Program,
        tile: Tile,
        buffers: &mut Buffers<V, N>,
    ) {
        self.cameras
            .read(simd, program.symmetry, &tile.points, tile.start);
        if let Some(frames) = &program.frames {
            simd.enter(Predict {
                simd,
                frames,
                tile,
                place: self,
                buffers,
            });
        }
    }

    /// What inputs are made of in `tile`, as far as neither u nor wi is concerned.
    #[inline(always)]
    pub fn scalars<'s>(&'s self, tile: &Tile<'s>) -> Scalars<'s, V, N> {
        Scalars {
            params: tile.points.params,
            start: tile.start,
            wo: &self.cameras.wo,
            anchor: &self.anchor,
            u: &[],
            chart: &[],
            wi: &[],
            local: [&[]; CHARTS_MAX],
        }
    }

    /// Chart `c` of vector `q`.
    #[inline(always)]
    pub fn chart(&self, frames: &Frames, c: usize, q: usize) -> Chart<V> {
        Chart::new(self.outputs(c, q), &self.anchor_start(frames, c, q))
    }

    /// The first chart of vector `q` where `first` holds, the second elsewhere.
    #[inline(always)]
    pub fn drawn_chart(&self, frames: &Frames, first: V::Mask, q: usize) -> Chart<V> {
        let mut outputs = self.outputs(0, q);
        for (output, other) in outputs.iter_mut().zip(self.outputs(1, q)) {
            *output = V::select(first, *output, other);
        }
        let (one, other) = (self.anchor_start(frames, 0, q), self.anchor_start(frames, 1, q));
        Chart::new(outputs, &Start::select(first, &one, &other))
    }

    /// Share of the samples that the first of two charts gets in vector `q`.
    #[inline(always)]
    pub fn share(&self, q: usize) -> V {
        let least = SHARE_MIN as f32;
        sigmoid(self.frames[OUTPUTS_MAX - 1][q]).clamp(least, 1.0 - least)
    }

    #[inline(always)]
    fn outputs(&self, c: usize, q: usize) -> [V; FRAME_OUTPUTS] {
        let mut outputs = [self.frames[0][q]; FRAME_OUTPUTS];
        for (output, column) in outputs.iter_mut().zip(&self.frames[FRAME_OUTPUTS * c..]) {
            *output = column[q];
        }
        outputs
    }

    #[inline(always)]
    fn anchor_start(&self, frames: &Frames, c: usize, q: usize) -> Start<V> {
        match frames.anchors[c] {
            Anchor::Mirror => self.mirror[q],
            Anchor::Diffuse => Start::identity(self.frames[0][q]),
        }
    }
}

/// The part of [`Place::read`] that charts need: a task of its own, so that all queries share one copy of its code.
struct Predict<'a, S: Simd, const N: usize> {
    simd: S,
    frames: &'a Frames,
    tile: Tile<'a>,
    place: &'a mut Place<S::Vector, N>,
    buffers: &'a mut Buffers<S::Vector, N>,
}

impl<S: Simd, const N: usize> Task for Predict<'_, S, N> {
    #[inline(always)]
    fn run(self) {
        let Predict {
            simd,
            frames,
            tile,
            place,
            buffers,
        } = self;
        if frames.mirror {
            let [x, y] = frames.alpha;
            let x: Column<S::Vector, N> = roughness(simd, x, &tile.points, tile.start);
            let y: Column<S::Vector, N> = roughness(simd, y, &tile.points, tile.start);
            for q in 0..N {
                place.mirror[q] = Start::mirror(place.cameras.wo(q), [x[q], y[q]]);
            }
        }
        if frames.scalars {
            for q in 0..N {
                for (column, scalar) in place.anchor.iter_mut().zip(place.mirror[q].scalars()) {
                    column[q] = scalar;
                }
            }
        }
        place.scalars(&tile).encode(simd, &frames.inputs, buffers);
        buffers.keep(frames.net.inputs);
        let rows = buffers.run(simd, &frames.net, tile.live);
        for (column, row) in place.frames.iter_mut().zip(rows) {
            *column = *row;
        }
    }
}

/// [`Roughness::at`] in a tile.
#[inline(always)]
fn roughness<S: Simd, const N: usize>(
    simd: S,
    roughness: Roughness,
    points: &Points,
    start: usize,
) -> Column<S::Vector, N> {
    match roughness {
        Roughness::Fixed(value) => [simd.splat(value as f32); N],
        Roughness::Free {
            parameter,
            factor,
            power,
        } => {
            let mut column: Column<S::Vector, N> = read_parameter(simd, points.params[parameter], start);
            for p in &mut column {
                let raised = if power == 2 { *p * *p } else { *p };
                *p = (raised * p.splat(factor as f32)).max(p.splat(Roughness::MIN as f32));
            }
            column
        }
    }
}
