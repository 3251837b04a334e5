//! Sampling queries: (wo, u) ↦ wi with the learned weight, or with the signed Jacobian determinant.

use super::kernel::{Buffers, Columns, Layer, Linear, Silu, TANGENT_COLUMNS, Tangents, Values};
use super::lobe::{Lobe, square_to_hemisphere};
use super::math::exp;
use super::program::{Program, grazing_columns};
use super::tile::{Cameras, Column, finite_or_zero, queries, read, write};
use super::vector::{Simd, Task, Vector};
use crate::error::Result;
use crate::frame::FRAME_OUTPUTS;
use crate::network::Network;
use crate::spec::{EXPONENT_MAX, Role, U_MIN, WARP_SHIFT_MAX};

/// The largest u that a warp head uses: the last f32 below 1.
const U_MAX: f32 = 1.0 - f32::EPSILON / 2.0;

/// A sampling network and the buffers it runs in.
pub struct Sampler<V, const N: usize> {
    program: Program,
    /// The last layer's rows of the warp alone: without the weight, which needs no tangents.
    shift: Layer,
    /// See [`Program::first_slopes`].
    slopes: Vec<[f32; 2]>,
    values: Buffers<V, N>,
    tangents: Buffers<V, TANGENT_COLUMNS>,
}

impl<V: Vector, const N: usize> Sampler<V, N> {
    /// Packs `network`; `zero` makes the buffers.
    ///
    /// # Errors
    /// Those of [`Program::new`].
    pub fn new(network: &Network, zero: V) -> Result<Self> {
        let program = Program::new(network, Role::Sample)?;
        let last = network.net.last().expect("a checked network has layers");
        let slopes = program.first_slopes(&network.net[0]);
        let (values, tangents) = (
            Buffers::new(program.width, zero),
            Buffers::new(program.width, zero),
        );
        Ok(Sampler {
            shift: Layer::first_rows(last, 2),
            slopes,
            values,
            tangents,
            program,
        })
    }
}

/// Where the lights of one tile go.
struct Tile<V, const N: usize> {
    cameras: Cameras<V, N>,
    u: [Column<V, N>; 2],
    frames: [Column<V, N>; FRAME_OUTPUTS],
}

impl<V: Vector, const N: usize> Tile<V, N> {
    /// Reads a tile, runs the frame network and leaves the network's features in `sampler.values`.
    #[inline(always)]
    fn read<S: Simd<Vector = V>>(
        simd: S,
        sampler: &mut Sampler<V, N>,
        wo: [&[f32]; 3],
        u: [&[f32]; 2],
        start: usize,
    ) -> Self {
        let program = &sampler.program;
        let cameras = Cameras::read(simd, program.symmetry, wo, start);
        let mut u: [Column<V, N>; 2] = [read(simd, u[0], start), read(simd, u[1], start)];
        for column in &mut u {
            for value in column {
                *value = value.clamp(U_MIN as f32, U_MAX);
            }
        }
        let features = grazing_columns(&cameras.wo);
        let frames = program.frame_outputs(&features, &mut sampler.values);
        program.encode(&features, &u, sampler.values.input());
        Tile { cameras, u, frames }
    }

    /// Writes `wi` of vector `q` from the warp; returns π·det A/(n³·z) and the query's validity.
    #[inline(always)]
    fn write_light(
        &self,
        program: &Program,
        warp: &[Warp<V>; 2],
        wi: &mut [&mut [f32]; 3],
        start: usize,
        q: usize,
    ) -> (V, V) {
        let lobe: Lobe<V> = program.lobe(&self.frames, &self.cameras, q);
        let [wx, wy] = warp;
        let local = square_to_hemisphere([wx.h, wy.h], [wx.complement, wy.complement]);
        let ([x, y, z], area) = lobe.to_direction(local);
        // A direction that is not finite, of a `wo` far from unit length, is no direction.
        let validity = self.cameras.validity[q] + x.abs() + y.abs() + z;
        let one = z.splat(1.0);
        write(
            finite_or_zero(self.cameras.signs[0][q] * x, validity),
            wi[0],
            start,
            q,
        );
        write(
            finite_or_zero(self.cameras.signs[1][q] * y, validity),
            wi[1],
            start,
            q,
        );
        // Where it is not valid the height is 1, not 0.
        write(
            V::select(validity.less(z.splat(f32::INFINITY)), z, one),
            wi[2],
            start,
            q,
        );
        (area, validity)
    }
}

/// One coordinate of the warp head, h = u/(u + (1 − u)·e⁻ᵍ).
struct Warp<V> {
    /// Position in the frame's square.
    h: V,
    /// 1 − h, with its own relative precision.
    complement: V,
    u: V,
    g: V,
}

impl<V: Vector> Warp<V> {
    /// The head on the output `g`.
    #[inline(always)]
    fn new(u: V, g: V) -> Self {
        let max = WARP_SHIFT_MAX as f32;
        let rest = (u.splat(1.0) - u) * exp(-g.clamp(-max, max));
        let sum = u + rest;
        Warp {
            h: u / sum,
            complement: rest / sum,
            u,
            g,
        }
    }

    /// (∂h/∂g, ∂h/∂u at fixed g); the first is 0 where g is clamped.
    #[inline(always)]
    fn slopes(&self) -> (V, V) {
        let zero = self.u.splat(0.0);
        let product = self.h * self.complement;
        let inside = self.g.abs().less(self.u.splat(WARP_SHIFT_MAX as f32));
        let direct = product / (self.u * (self.u.splat(1.0) - self.u));
        (V::select(inside, product, zero), direct)
    }
}

/// The learned estimator on a batch.
pub struct Learned<'a, S: Simd, const N: usize> {
    pub simd: S,
    pub sampler: &'a mut Sampler<S::Vector, N>,
    pub wo: [&'a [f32]; 3],
    pub u: [&'a [f32]; 2],
    pub wi: [&'a mut [f32]; 3],
    pub weight: [&'a mut [f32]; 3],
}

impl<S: Simd, const N: usize> Task for Learned<'_, S, N> {
    #[inline(always)]
    fn run(mut self) {
        for start in (0..self.wo[0].len()).step_by(queries::<S::Vector, N>()) {
            let tile = Tile::read(self.simd, self.sampler, self.wo, self.u, start);
            let Sampler { program, values, .. } = &mut *self.sampler;
            let out =
                values.run::<Silu<Values>, Linear<Values>>(program.features, &program.hidden, &program.last);
            for q in 0..N {
                let warp = [
                    Warp::new(tile.u[0][q], out[0][q]),
                    Warp::new(tile.u[1][q], out[1][q]),
                ];
                let (_, validity) = tile.write_light(program, &warp, &mut self.wi, start, q);
                for (weight, exponent) in self.weight.iter_mut().zip(&out[2..]) {
                    let max = EXPONENT_MAX as f32;
                    let value = exp(exponent[q].clamp(-max, max));
                    write(finite_or_zero(value, validity), weight, start, q);
                }
            }
        }
    }
}

/// The exact estimators on a batch.
pub struct Jacobian<'a, S: Simd, const N: usize> {
    pub simd: S,
    pub sampler: &'a mut Sampler<S::Vector, N>,
    pub wo: [&'a [f32]; 3],
    pub u: [&'a [f32]; 2],
    pub wi: [&'a mut [f32]; 3],
    pub jacobian: &'a mut [f32],
}

impl<S: Simd, const N: usize> Task for Jacobian<'_, S, N> {
    #[inline(always)]
    fn run(mut self) {
        for start in (0..self.wo[0].len()).step_by(queries::<S::Vector, N>()) {
            let tile = Tile::read(self.simd, self.sampler, self.wo, self.u, start);
            let Sampler {
                program,
                shift,
                slopes,
                values,
                tangents,
            } = &mut *self.sampler;
            // Only the value enters the first layer; its tangents are constants.
            let first = program.hidden.first().unwrap_or(shift);
            let sums = values.run::<Linear<Values>, Linear<Values>>(program.features, &[], first);
            for q in 0..N {
                let entered = sums.iter().zip(&*slopes).zip(tangents.input());
                let out = match program.hidden.split_first() {
                    Some((_, rest)) => {
                        for ((sum, &[dx, dy]), row) in entered {
                            let x = sum[q];
                            *row = Silu::<Tangents>::finish([x, x.splat(dx), x.splat(dy)]);
                        }
                        tangents.run::<Silu<Tangents>, Linear<Tangents>>(first.outputs(), rest, shift)
                    }
                    None => {
                        for ((sum, &[dx, dy]), row) in entered {
                            *row = [sum[q], sum[q].splat(dx), sum[q].splat(dy)];
                        }
                        tangents.input()
                    }
                };
                let ([gx, xx, xy], [gy, yx, yy]) = (out[0], out[1]);
                let warp = [Warp::new(tile.u[0][q], gx), Warp::new(tile.u[1][q], gy)];
                let (area, validity) = tile.write_light(program, &warp, &mut self.wi, start, q);
                let ((shift_x, direct_x), (shift_y, direct_y)) = (warp[0].slopes(), warp[1].slopes());
                let diagonal = shift_x.mul_add(xx, direct_x) * shift_y.mul_add(yy, direct_y);
                let det = diagonal - shift_x * xy * (shift_y * yx);
                write(finite_or_zero(det * area, validity), self.jacobian, start, q);
            }
        }
    }
}
