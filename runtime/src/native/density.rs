//! Density queries: (parameters, wo, wi) ↦ `f_cos` or pdf, of every chart the density times the exponential of the outputs.

use super::batch::Tiles;
use super::math::exp;
use super::program::Program;
use super::scratch::Work;
use super::tile::{Column, Tile, finite_or_zero, read_directions, write};
use super::vector::{Simd, Task, Vector};
use crate::backend::Points;
use crate::error::Result;
use crate::network::Network;
use crate::spec::{CHARTS_MAX, EXPONENT_MAX, Role};

/// An evaluation or pdf network.
pub struct Densities {
    /// The network.
    pub program: Program,
    role: Role,
}

/// What `K` outputs per chart of a tile say.
pub struct Parts<V, const N: usize, const K: usize> {
    /// Per chart: of `f_cos` its own, or of the pdf its share times its density. Without charts the first is all.
    pub charts: [[Column<V, N>; K]; CHARTS_MAX],
    /// Finite in valid queries.
    pub validity: Column<V, N>,
}

impl Densities {
    /// Packs `network`.
    ///
    /// # Errors
    /// Those of [`Program::new`].
    pub fn new(network: &Network, role: Role) -> Result<Self> {
        let program = Program::new(network, role)?;
        Ok(Densities { role, program })
    }

    /// See [`Program::bound`].
    pub fn bound(&self, values: &[Option<f64>]) -> Self {
        Densities {
            program: self.program.bound(values),
            role: self.role,
        }
    }

    /// The parts of `tile` for light from `wi`, not folded yet, which is left folded; `K` is the number of outputs per chart.
    #[inline(always)]
    pub fn parts<S: Simd<Vector = V>, V: Vector, const N: usize, const K: usize>(
        &self,
        simd: S,
        tile: Tile,
        wi: &mut [Column<V, N>; 3],
        work: Work<V, N>,
    ) -> Parts<V, N, K> {
        let zero = simd.splat(0.0);
        let mut parts = Parts {
            charts: [[[zero; N]; K]; CHARTS_MAX],
            validity: [zero; N],
        };
        simd.enter(Measure {
            simd,
            densities: self,
            tile,
            wi,
            work,
            parts: &mut parts,
        });
        parts
    }
}

/// [`Densities::parts`]: a task of its own, so that all queries share one copy of its code.
struct Measure<'a, S: Simd, const N: usize, const K: usize> {
    simd: S,
    densities: &'a Densities,
    tile: Tile<'a>,
    wi: &'a mut [Column<S::Vector, N>; 3],
    work: Work<'a, S::Vector, N>,
    parts: &'a mut Parts<S::Vector, N, K>,
}

impl<S: Simd, const N: usize, const K: usize> Task for Measure<'_, S, N, K> {
    #[inline(always)]
    fn run(self) {
        let Measure { simd, tile, wi, .. } = self;
        let Densities { program, role } = self.densities;
        let Work { values, place, .. } = self.work;
        let zero = simd.splat(0.0);
        place.read(simd, program, tile, values);
        place.cameras.fold_lights(wi);
        let mut local = [[[zero; N]; 3]; CHARTS_MAX];
        let mut density = [[simd.splat(1.0); N]; CHARTS_MAX];
        if let Some(frames) = &program.frames {
            for c in 0..frames.charts() {
                for q in 0..N {
                    let chart = place.chart(frames, c, q);
                    let (direction, value) = chart.to_local([wi[0][q], wi[1][q], wi[2][q]]);
                    density[c][q] = value;
                    for (column, component) in local[c].iter_mut().zip(direction) {
                        column[q] = component;
                    }
                }
            }
            if *role == Role::Pdf && frames.charts() == CHARTS_MAX {
                let [first, second] = &mut density;
                for (q, (first, second)) in first.iter_mut().zip(second).enumerate() {
                    let share = place.share(q);
                    *first = *first * share;
                    *second = *second * (share.splat(1.0) - share);
                }
            }
        }
        let mut scalars = place.scalars(&tile);
        scalars.wi = &wi[..2];
        scalars.local = local.each_ref().map(|local| local.as_slice());
        scalars.encode(simd, &program.inputs, values);
        let rows = values.run(simd, &program.net, tile.live);
        let max = EXPONENT_MAX as f32;
        let charts = self.parts.charts.iter_mut().zip(rows.chunks_exact(K));
        for ((parts, rows), density) in charts.zip(&density) {
            for (part, row) in parts.iter_mut().zip(rows) {
                for q in 0..N {
                    part[q] = density[q] * exp(row[q].clamp(-max, max));
                }
            }
        }
        self.parts.validity = place.cameras.validity;
    }
}

/// A batch with `K` outputs per query.
pub struct Density<'a, S: Simd, const K: usize> {
    pub simd: S,
    pub densities: &'a Densities,
    pub points: Points<'a>,
    pub wi: [&'a [f32]; 3],
    pub out: [&'a mut [f32]; K],
}

impl<S: Simd, const K: usize> Tiles<S::Vector> for Density<'_, S, K> {
    fn count(&self) -> usize {
        self.points.len()
    }

    #[inline(always)]
    fn tile<const N: usize>(&mut self, start: usize, live: usize, work: Work<S::Vector, N>) {
        let two = self.densities.program.charts() == CHARTS_MAX;
        let mut wi = read_directions(self.simd, self.wi, start);
        let tile = Tile {
            points: self.points,
            start,
            live,
        };
        let parts: Parts<S::Vector, N, K> = self.densities.parts(self.simd, tile, &mut wi, work);
        for (k, out) in self.out.iter_mut().enumerate() {
            for q in 0..N {
                let mut value = parts.charts[0][k][q];
                if two {
                    value = value + parts.charts[1][k][q];
                }
                write(finite_or_zero(value, parts.validity[q]), out, start, q);
            }
        }
    }
}
