//! The exact density of what a sampling network draws: its map is inverted at a given direction, lane by lane, by
//! Newton's method.
//!
//! In the square of a chart the map is h = σ(logit u + g(u)). With t = logit u, the position of `wi` gives the equation
//! t + g(σ(t)) = logit h, whose Jacobian I + ∂g/∂u·u(1 − u) the network's tangents give. At its solution the density is
//! that of the chart, times u(1 − u)/(h(1 − h)) of both coordinates, over the Jacobian's determinant.

use super::batch::Tiles;
use super::head::is_inside;
use super::math::{EXP_MAX, exp, ln};
use super::sample::Sampler;
use super::scratch::Work;
use super::shift::Shifter;
use super::square::hemisphere_to_square;
use super::tile::{Column, Tile, finite_or_zero, is_finite, read_directions, write};
use super::vector::{Simd, Task, Vector, lanes};
use crate::backend::Points;
use crate::oracle::{DET_MIN, STEP_MAX};
use crate::spec::{CHARTS_MAX, WARP_SHIFT_MAX};

/// Most evaluations of the network per chart and query: on a trained map four suffice on average, and of queries within a
/// degree of the horizon one in 4000 needs more than these.
const STEPS_MAX: usize = 12;

/// Largest residual of t + g − logit h that counts as solved: some roundings of logits up to 28. One step earlier it was
/// about the square root of that.
const RESIDUAL_MAX: f32 = 2e-5;

/// How many inversions a batch took, and how many failed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Inversions {
    /// Charts times queries whose directions are finite and above the horizon.
    pub queries: u64,
    /// Those that did not converge; there the density of the frame stands in.
    pub unconverged: u64,
}

impl Inversions {
    /// Adds one per lane that is valid, and one per lane of these that is `open`.
    #[inline(always)]
    fn add<V: Vector>(&mut self, validity: V, open: V::Mask) {
        let (zero, one) = (validity.splat(0.0), validity.splat(1.0));
        let valid = V::select(is_finite(validity), one, zero);
        let missed = V::select(open, valid, zero);
        let count = |marks: V| lanes(marks).iter().sum::<f32>() as u64;
        self.queries += count(valid);
        self.unconverged += count(missed);
    }
}

impl Sampler {
    /// Of every chart its share times its density at `wi`, sr⁻¹; directions are folded as the cameras of the place in `work`. Zeros on
    /// the disk, whose map need not be one to one.
    #[inline(always)]
    pub fn invert<S: Simd<Vector = V>, V: Vector, const N: usize>(
        &self,
        simd: S,
        tile: Tile,
        wi: &[Column<V, N>; 3],
        work: Work<V, N>,
        inversions: &mut Inversions,
    ) -> [Column<V, N>; CHARTS_MAX] {
        let mut parts = [[simd.splat(0.0); N]; CHARTS_MAX];
        simd.enter(Invert {
            simd,
            sampler: self,
            tile,
            wi,
            work,
            inversions,
            parts: &mut parts,
        });
        parts
    }
}

/// [`Sampler::invert`]: a task of its own, so that both of its callers share one copy of its code.
struct Invert<'a, S: Simd, const N: usize> {
    simd: S,
    sampler: &'a Sampler,
    tile: Tile<'a>,
    wi: &'a [Column<S::Vector, N>; 3],
    work: Work<'a, S::Vector, N>,
    inversions: &'a mut Inversions,
    parts: &'a mut [Column<S::Vector, N>; CHARTS_MAX],
}

impl<S: Simd, const N: usize> Task for Invert<'_, S, N> {
    #[inline(always)]
    fn run(self) {
        let Invert { simd, tile, wi, .. } = self;
        let Sampler { program, shift } = self.sampler;
        let Work {
            values,
            slopes,
            place,
        } = self.work;
        let mut shifter = Shifter {
            shift,
            buffers: slopes,
            live: tile.live,
        };
        let (zero, one) = (simd.splat(0.0), simd.splat(1.0));
        let Some(frames) = &program.frames else {
            return;
        };
        for c in 0..frames.charts() {
            let chart = [if c == 0 { one } else { -one }; N];
            let mut scalars = place.scalars(&tile);
            scalars.chart = std::slice::from_ref(&chart);
            // Where u alone enters, there is one feature of weight 0.
            values.input()[0] = [zero; N];
            scalars.encode(simd, &shift.other_inputs, values);
            let sums = values.sums(simd, &shift.others, tile.live);
            for (q, part) in self.parts[c].iter_mut().enumerate() {
                let w = [wi[0][q], wi[1][q], wi[2][q]];
                let (local, density) = place.chart(frames, c, q).to_local(w);
                let (h, rest) = hemisphere_to_square(local);
                let validity = place.cameras.validity[q];
                let target = [ln(h[0] / rest[0]), ln(h[1] / rest[1])];
                let root = Root::find(simd, &mut shifter, sums, q, target, validity);
                let per_square = root.areas[0] / (h[0] * rest[0]) * (root.areas[1] / (h[1] * rest[1]));
                let open = root.is_open();
                let exact = density * per_square / root.det.abs();
                let share = match (frames.charts(), c) {
                    (CHARTS_MAX, 0) => place.share(q),
                    (CHARTS_MAX, _) => one - place.share(q),
                    _ => one,
                };
                *part = share * Vector::select(open, density, exact);
                self.inversions.add(validity, open);
            }
        }
    }
}

/// The best t so far.
struct Root<V> {
    t: [V; 2],
    /// The larger of the two residuals.
    residual: V,
    /// u(1 − u) of both coordinates.
    areas: [V; 2],
    det: V,
}

impl<V: Vector> Root<V> {
    /// Solves for the position with logits `target`, for vector `q` of the sums of [`Shift::others`]. Queries that are
    /// not valid count as solved.
    #[inline(always)]
    fn find<S: Simd<Vector = V>, const N: usize>(
        simd: S,
        shifter: &mut Shifter<V>,
        sums: &[Column<V, N>],
        q: usize,
        target: [V; 2],
        validity: V,
    ) -> Self {
        let (zero, one) = (validity.splat(0.0), validity.splat(1.0));
        let infinity = validity.splat(f32::INFINITY);
        let mut best = Root {
            t: target,
            residual: V::select(is_finite(validity), infinity, zero),
            areas: [one; 2],
            det: one,
        };
        let mut t = target;
        let mut step = [zero; 2];
        for _ in 0..STEPS_MAX {
            let places = [Logistic::new(t[0]), Logistic::new(t[1])];
            let u = [places[0].u, places[1].u];
            let areas = [places[0].area, places[1].area];
            let [gx, gy] = shifter.at(simd, sums, q, u);
            let ([gx, xx, xy], [gy, yx, yy]) = (clamped(gx), clamped(gy));
            let (xx, xy) = (xx.mul_add(areas[0], one), xy * areas[1]);
            let (yx, yy) = (yx * areas[0], yy.mul_add(areas[1], one));
            let det = xx * yy - xy * yx;
            let f = [t[0] + gx - target[0], t[1] + gy - target[1]];
            let residual = f[0].abs().max(f[1].abs());
            // Lanes that are solved stay as they are, so that they do not depend on their neighbours.
            let candidate = V::select(best.is_open(), residual, infinity);
            let better = candidate.less(best.residual);
            let newton = {
                let trusted = V::select(zero.splat(DET_MIN as f32).less(det), one / det, zero);
                let direct = V::select(zero.less(trusted), zero, one);
                let x = (yy * f[0] - xy * f[1]).mul_add(trusted, f[0] * direct);
                let y = (xx * f[1] - yx * f[0]).mul_add(trusted, f[1] * direct);
                let longest = x.abs().max(y.abs()).max(one.splat(STEP_MAX as f32));
                let scale = one.splat(-STEP_MAX as f32) / longest;
                [x * scale, y * scale]
            };
            best.residual = V::select(better, residual, best.residual);
            best.det = V::select(better, det, best.det);
            for c in 0..2 {
                best.t[c] = V::select(better, t[c], best.t[c]);
                best.areas[c] = V::select(better, areas[c], best.areas[c]);
                step[c] = V::select(better, newton[c], step[c] * one.splat(0.5));
                t[c] = best.t[c] + step[c];
            }
            if lanes(best.residual).iter().all(|&lane| lane <= RESIDUAL_MAX) {
                break;
            }
        }
        best
    }

    /// Where it is not solved.
    #[inline(always)]
    fn is_open(&self) -> V::Mask {
        self.det.splat(RESIDUAL_MAX).less(self.residual)
    }
}

/// u = σ(t) and u(1 − u), both with their relative precision.
struct Logistic<V> {
    u: V,
    area: V,
}

impl<V: Vector> Logistic<V> {
    #[inline(always)]
    fn new(t: V) -> Self {
        let (zero, one) = (t.splat(0.0), t.splat(1.0));
        let e = exp((-t.abs()).max(t.splat(-EXP_MAX)));
        let high = one / (one + e);
        let low = e * high;
        Logistic {
            u: V::select(t.less(zero), low, high),
            area: low * high,
        }
    }
}

/// A shift as the warp takes it: limited, and constant where it is.
#[inline(always)]
fn clamped<V: Vector>([g, by_x, by_y]: [V; 3]) -> [V; 3] {
    let (max, inside, zero) = (WARP_SHIFT_MAX as f32, is_inside(g), g.splat(0.0));
    [
        g.clamp(-max, max),
        V::select(inside, by_x, zero),
        V::select(inside, by_y, zero),
    ]
}

/// Exact densities on a batch.
pub struct ExactPdf<'a, S: Simd> {
    pub simd: S,
    pub sampler: &'a Sampler,
    pub points: Points<'a>,
    pub wi: [&'a [f32]; 3],
    pub pdf: &'a mut [f32],
    /// Counts.
    pub inversions: &'a mut Inversions,
}

impl<S: Simd> Tiles<S::Vector> for ExactPdf<'_, S> {
    fn count(&self) -> usize {
        self.points.len()
    }

    #[inline(always)]
    fn tile<const N: usize>(&mut self, start: usize, live: usize, mut work: Work<S::Vector, N>) {
        let program = &self.sampler.program;
        let tile = Tile {
            points: self.points,
            start,
            live,
        };
        work.place.read(self.simd, program, tile, work.values);
        let mut wi = read_directions(self.simd, self.wi, start);
        work.place.cameras.fold_lights(&mut wi);
        let [first, second] = self
            .sampler
            .invert(self.simd, tile, &wi, work.again(), self.inversions);
        let validity = work.place.cameras.validity;
        for (q, (first, second)) in first.into_iter().zip(second).enumerate() {
            let value = finite_or_zero(first + second, validity[q]);
            write(value, self.pdf, start, q);
        }
    }
}
