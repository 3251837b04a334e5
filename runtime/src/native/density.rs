//! Density queries: (wo, wi) ↦ `f_cos` or pdf, the frame's density times the exponential of the outputs.

use super::kernel::{Buffers, Linear, Silu, Values};
use super::math::exp;
use super::program::{Program, grazing_columns};
use super::tile::{Cameras, finite_or_zero, queries, write};
use super::vector::{Simd, Task, Vector};
use crate::error::Result;
use crate::network::Network;
use crate::spec::{EXPONENT_MAX, Role};

/// An evaluation or pdf network and the buffers it runs in.
pub struct Densities<V, const N: usize> {
    program: Program,
    values: Buffers<V, N>,
}

impl<V: Vector, const N: usize> Densities<V, N> {
    /// Packs `network`; `zero` makes the buffers.
    ///
    /// # Errors
    /// Those of [`Program::new`].
    pub fn new(network: &Network, role: Role, zero: V) -> Result<Self> {
        let program = Program::new(network, role)?;
        Ok(Densities {
            values: Buffers::new(program.width, zero),
            program,
        })
    }
}

/// A batch with `K` outputs per query.
pub struct Density<'a, S: Simd, const N: usize, const K: usize> {
    pub simd: S,
    pub densities: &'a mut Densities<S::Vector, N>,
    pub wo: [&'a [f32]; 3],
    pub wi: [&'a [f32]; 3],
    pub out: [&'a mut [f32]; K],
}

impl<S: Simd, const N: usize, const K: usize> Task for Density<'_, S, N, K> {
    #[inline(always)]
    fn run(mut self) {
        let Densities { program, values } = self.densities;
        let zero = self.simd.splat(0.0);
        for start in (0..self.wo[0].len()).step_by(queries::<S::Vector, N>()) {
            let mut cameras = Cameras::read(self.simd, program.symmetry, self.wo, start);
            let wi = cameras.read_lights(self.simd, self.wi, start);
            let features = grazing_columns(&cameras.wo);
            let frames = program.frame_outputs(&features, values);
            let mut local = [[zero; N]; 3];
            let mut density = [zero; N];
            for q in 0..N {
                let lobe = program.lobe(&frames, &cameras, q);
                let (direction, value) = lobe.to_local([wi[0][q], wi[1][q], wi[2][q]]);
                density[q] = value;
                for (column, component) in local.iter_mut().zip(direction) {
                    column[q] = component;
                }
            }
            program.encode(&features, &local, values.input());
            let rows =
                values.run::<Silu<Values>, Linear<Values>>(program.features, &program.hidden, &program.last);
            let max = EXPONENT_MAX as f32;
            for (out, row) in self.out.iter_mut().zip(rows) {
                for q in 0..N {
                    let value = density[q] * exp(row[q].clamp(-max, max));
                    write(finite_or_zero(value, cameras.validity[q]), out, start, q);
                }
            }
        }
    }
}
