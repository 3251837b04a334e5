//! Sampling queries: (parameters, wo, u) ↦ wi with the learned weight, or with the signed Jacobian determinant.

use super::batch::Tiles;
use super::density::{Densities, Parts};
use super::head::{Head, disk_direction};
use super::invert::Inversions;
use super::math::exp;
use super::place::Place;
use super::program::Program;
use super::scratch::Work;
use super::shift::{Shift, Shifter};
use super::square::square_to_hemisphere;
use super::tile::{Column, Tile, finite_or_zero, is_finite, read, write};
use super::vector::{Simd, Vector};
use crate::backend::Points;
use crate::error::Result;
use crate::network::Network;
use crate::spec::{CHARTS_MAX, EXPONENT_MAX, Role, U_MIN};

/// The largest u that a warp head uses: the last f32 below 1.
const U_MAX: f32 = 1.0 - f32::EPSILON / 2.0;

/// A sampling network.
pub struct Sampler {
    /// The network.
    pub program: Program,
    /// Its position with derivatives.
    pub shift: Shift,
}

impl Sampler {
    /// Packs `network`.
    ///
    /// # Errors
    /// Those of [`Program::new`].
    pub fn new(network: &Network) -> Result<Self> {
        Ok(Sampler::of(Program::new(network, Role::Sample)?))
    }

    fn of(program: Program) -> Self {
        Sampler {
            shift: Shift::new(&program),
            program,
        }
    }

    /// See [`Program::bound`].
    pub fn bound(&self, values: &[Option<f64>]) -> Self {
        Sampler::of(self.program.bound(values))
    }

    /// Reads `tile`, runs the frame network, draws charts and leaves the network's features in the values of `work`.
    #[inline(always)]
    fn draw<S: Simd<Vector = V>, V: Vector, const N: usize>(
        &self,
        simd: S,
        tile: Tile,
        u: [&[f32]; 2],
        work: Work<V, N>,
    ) -> Draw<V, N> {
        let Work { values, place, .. } = work;
        place.read(simd, &self.program, tile, values);
        let one = simd.splat(1.0);
        let mut draw = Draw {
            u: [read(simd, u[0], tile.start), read(simd, u[1], tile.start)],
            rest: [[one; N]; 2],
            chart: [one; N],
            share: [one; N],
        };
        for (column, rest) in draw.u.iter_mut().zip(&mut draw.rest) {
            for (value, rest) in column.iter_mut().zip(rest) {
                *value = value.clamp(U_MIN as f32, U_MAX);
                *rest = one - *value;
            }
        }
        if self.program.charts() == CHARTS_MAX {
            let edge = U_MIN as f32;
            for q in 0..N {
                let (share, u) = (place.share(q), draw.u[0][q]);
                let other = one - share;
                let first = u.less(share);
                draw.chart[q] = V::select(first, one, -one);
                draw.share[q] = V::select(first, share, other);
                // Distances from both ends of the chart, each where it keeps its digits: the first end of the second
                // chart has lost them to the split already.
                let rest = V::select(first, share - u, draw.rest[0][q]) / draw.share[q];
                let into = V::select(first, u / share, one - rest);
                draw.u[0][q] = into.clamp(edge, 1.0 - edge);
                draw.rest[0][q] = rest.clamp(edge, 1.0 - edge);
            }
        }
        let mut scalars = place.scalars(&tile);
        scalars.u = &draw.u;
        scalars.chart = std::slice::from_ref(&draw.chart);
        scalars.encode(simd, &self.program.inputs, values);
        draw
    }
}

/// What was drawn in one tile before the network said where it lies.
struct Draw<V, const N: usize> {
    /// In the drawn chart.
    u: [Column<V, N>; 2],
    /// 1 − u, with its own relative precision.
    rest: [Column<V, N>; 2],
    /// 1 where the first chart was drawn, −1 where the second.
    chart: Column<V, N>,
    /// The drawn chart's share.
    share: Column<V, N>,
}

/// A light of one vector of queries.
struct Light<V> {
    /// Unit direction, not folded; (0, 0, 1) where it is not valid.
    wi: [V; 3],
    /// dω/dh over the share of the drawn chart, sr.
    area: V,
    /// Finite in valid queries.
    validity: V,
}

impl<V: Vector, const N: usize> Draw<V, N> {
    /// The head on the outputs `g` of vector `q`.
    #[inline(always)]
    fn heads(&self, program: &Program, g: [V; 2], q: usize) -> [Head<V>; 2] {
        match program.frames {
            Some(_) => [
                Head::new(self.u[0][q], self.rest[0][q], g[0]),
                Head::new(self.u[1][q], self.rest[1][q], g[1]),
            ],
            None => [Head::on_disk(g[0]), Head::on_disk(g[1])],
        }
    }

    /// Where the light of vector `q` is.
    #[inline(always)]
    fn light(&self, program: &Program, place: &Place<V, N>, heads: &[Head<V>; 2], q: usize) -> Light<V> {
        let zero = self.chart[q].splat(0.0);
        let (w, area) = match &program.frames {
            Some(frames) => {
                let [x, y] = heads;
                let local = square_to_hemisphere([x.h, y.h], [x.complement, y.complement]);
                if frames.charts() == CHARTS_MAX {
                    let first = zero.less(self.chart[q]);
                    let (w, area) = place.drawn_chart(frames, first, q).to_direction(local);
                    (w, area / self.share[q])
                } else {
                    place.chart(frames, 0, q).to_direction(local)
                }
            }
            None => disk_direction(heads),
        };
        let [x, y, z] = place.cameras.unfold(w, q);
        // A direction that is not finite, of a `wo` far from unit length, is no direction.
        let validity = place.cameras.validity[q] + x.abs() + y.abs() + z;
        Light {
            wi: [
                finite_or_zero(x, validity),
                finite_or_zero(y, validity),
                V::select(is_finite(validity), z, z.splat(1.0)),
            ],
            area,
            validity,
        }
    }
}

/// The learned estimator on a batch.
pub struct Learned<'a, S: Simd> {
    pub simd: S,
    pub sampler: &'a Sampler,
    pub points: Points<'a>,
    pub u: [&'a [f32]; 2],
    pub wi: [&'a mut [f32]; 3],
    pub weight: [&'a mut [f32]; 3],
}

impl<S: Simd> Tiles<S::Vector> for Learned<'_, S> {
    fn count(&self) -> usize {
        self.points.len()
    }

    #[inline(always)]
    fn tile<const N: usize>(&mut self, start: usize, live: usize, mut work: Work<S::Vector, N>) {
        let tile = Tile {
            points: self.points,
            start,
            live,
        };
        let draw = self.sampler.draw(self.simd, tile, self.u, work.again());
        let Work { values, place, .. } = work;
        let program = &self.sampler.program;
        let out = values.run(self.simd, &program.net, live);
        for q in 0..N {
            let heads = draw.heads(program, [out[0][q], out[1][q]], q);
            let light = draw.light(program, place, &heads, q);
            for (component, out) in light.wi.into_iter().zip(&mut self.wi) {
                write(component, out, start, q);
            }
            for (weight, exponent) in self.weight.iter_mut().zip(&out[2..]) {
                let max = EXPONENT_MAX as f32;
                let value = exp(exponent[q].clamp(-max, max));
                write(finite_or_zero(value, light.validity), weight, start, q);
            }
        }
    }
}

/// Where the weights come from by which several charts share what all of them could have drawn.
pub enum Partition<'a> {
    /// There is one chart.
    None,
    /// Densities of the pdf network.
    Learned(&'a Densities),
    /// Densities by inversion of the map, which are counted.
    Exact(&'a mut Inversions),
}

/// The exact estimators on a batch.
pub struct Jacobian<'a, S: Simd> {
    pub simd: S,
    pub sampler: &'a Sampler,
    pub partition: Partition<'a>,
    pub points: Points<'a>,
    pub u: [&'a [f32]; 2],
    pub wi: [&'a mut [f32]; 3],
    pub jacobian: &'a mut [f32],
}

impl<S: Simd> Tiles<S::Vector> for Jacobian<'_, S> {
    fn count(&self) -> usize {
        self.points.len()
    }

    #[inline(always)]
    fn tile<const N: usize>(&mut self, start: usize, live: usize, mut work: Work<S::Vector, N>) {
        let (simd, zero) = (self.simd, self.simd.splat(0.0));
        let tile = Tile {
            points: self.points,
            start,
            live,
        };
        let draw = self.sampler.draw(simd, tile, self.u, work.again());
        let Work {
            values,
            slopes,
            place,
        } = work.again();
        let Sampler { program, shift } = self.sampler;
        let mut shifter = Shifter {
            shift,
            buffers: slopes,
            live,
        };
        let (mut wi, mut jacobian, mut validity) = ([[zero; N]; 3], [zero; N], [zero; N]);
        let sums = values.sums(simd, &shift.first, live);
        for q in 0..N {
            let u = [draw.u[0][q], draw.u[1][q]];
            let [[gx, xx, xy], [gy, yx, yy]] = shifter.after(simd, sums, q, u);
            let heads = draw.heads(program, [gx, gy], q);
            let light = draw.light(program, place, &heads, q);
            let (shift_x, shift_y) = (heads[0].by_shift(), heads[1].by_shift());
            let (direct_x, direct_y) = match program.frames {
                Some(_) => (heads[0].by_u(), heads[1].by_u()),
                None => (zero, zero),
            };
            let diagonal = shift_x.mul_add(xx, direct_x) * shift_y.mul_add(yy, direct_y);
            let det = diagonal - shift_x * xy * (shift_y * yx);
            jacobian[q] = det * light.area;
            validity[q] = light.validity;
            for (column, component) in wi.iter_mut().zip(light.wi) {
                column[q] = component;
            }
        }
        for q in 0..N {
            for (column, out) in wi.iter().zip(&mut self.wi) {
                write(column[q], out, start, q);
            }
        }
        let parts = match &mut self.partition {
            Partition::None => None,
            Partition::Learned(pdf) => {
                let parts: Parts<S::Vector, N, 1> = pdf.parts(simd, tile, &mut wi, work);
                let [[first], [second]] = parts.charts;
                Some([first, second])
            }
            Partition::Exact(inversions) => {
                work.place.cameras.fold_lights(&mut wi);
                Some(self.sampler.invert(simd, tile, &wi, work, inversions))
            }
        };
        for q in 0..N {
            let mut value = jacobian[q];
            if let Some([first, second]) = &parts {
                let is_first = zero.less(draw.chart[q]);
                let drawn = Vector::select(is_first, first[q], second[q]);
                value = value * (drawn / (first[q] + second[q]));
            }
            write(finite_or_zero(value, validity[q]), self.jacobian, start, q);
        }
    }
}
