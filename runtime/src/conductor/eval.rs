//! Scattering of order 2 and up between two given directions: walks from both ends, combined.
//!
//! A walk from one direction that connects to the other meets, now and then, a vertex whose lobe points right
//! at it: rare and bright. The same sequence of directions can be walked from the other end, where it is
//! ordinary. Both walks are taken and weighed by the balance heuristic (Veach and Guibas 1995, *Optimally
//! Combining Sampling Techniques*), as Heitz et al. 2016 combine theirs. Deviation: the height of the last
//! scattering (and of both, at order 2, nearly all of this light) is not drawn but integrated in closed form, so
//! that every scattering connects and not only those after which the light is still inside.

use super::Conductor;
use super::scattering::Scattering;
use super::walk::Event;
use crate::bsdf::{r2_from, usable};
use crate::microfacet::{HalfVector, Stretched};
use crate::random::{Rng, Uniforms};
use crate::real::{Real, Vec3};

/// One end of the light's way.
#[derive(Clone, Copy, Debug)]
pub(super) struct End {
    direction: Vec3,
    /// Projected area of the surface seen from here.
    area: Real,
    lambda: Real,
}

impl End {
    /// The end at the unit vector `direction`, above the horizon.
    pub fn new(direction: Vec3, alpha: [Real; 2]) -> End {
        let stretched = Stretched::new(direction, alpha);
        End {
            direction,
            area: stretched.projected_area(),
            lambda: stretched.lambda_up(),
        }
    }
}

impl Conductor {
    /// An unbiased estimate of f_cos of order 2 and up, RGB, sr⁻¹, from one walk from either end.
    ///
    /// Zero unless both directions are above the horizon.
    pub fn multiple(&self, wo: Vec3, wi: Vec3, rng: &mut Rng) -> Vec3 {
        self.multiple_mean(wo, wi, 1, rng)
    }

    /// The same from `count` walks from either end, whose first normals lie evenly: less noise than as many estimates that
    /// know nothing of each other.
    pub fn multiple_mean(&self, wo: Vec3, wi: Vec3, count: u32, rng: &mut Rng) -> Vec3 {
        if !usable(wo) || !usable(wi) {
            return Vec3::ZERO;
        }
        let (from, to) = (End::new(wo, self.alpha), End::new(wi, self.alpha));
        let forward = self.walks(&from, &to, count, rng);
        let backward = self.walks(&to, &from, count, rng);
        (forward + backward * reversal(wo, wi)) / count as Real
    }

    /// Sum of what `count` walks from `from` find, against as many from `to`.
    fn walks(&self, from: &End, to: &End, count: u32, rng: &mut Rng) -> Vec3 {
        let first = rng.pair();
        (0..count)
            .map(|k| self.one_ended(from, to, 1.0, r2_from(first, k), rng))
            .sum()
    }

    /// What one walk from `from` finds, its first normal steered by `u` in `[0,1)²`, each sequence of directions times
    /// its share against `others` walks from `to` for every walk from `from`.
    pub(super) fn one_ended(
        &self,
        from: &End,
        to: &End,
        others: Real,
        u: [Real; 2],
        rng: &mut impl Uniforms,
    ) -> Vec3 {
        let mut sum = Vec3::ZERO;
        self.scatterings(from, u, rng, |scattering| {
            sum += self.connect_to(&scattering, to, others)
        });
        sum
    }

    /// Walks once from `from` and calls `tell` with every scattering.
    pub(super) fn scatterings(
        &self,
        from: &End,
        u: [Real; 2],
        rng: &mut impl Uniforms,
        mut tell: impl FnMut(Scattering),
    ) {
        let mut first = None;
        self.walk_events(from.direction, u, rng, |event| {
            if let Event::Scattered {
                direction,
                log_c,
                throughput,
            } = event
            {
                let lambda_from = first.is_none().then_some(from.lambda);
                let first = *first.get_or_insert_with(|| {
                    HalfVector::new(from.direction, direction, self.alpha).density / from.area
                });
                tell(Scattering::new(
                    self,
                    direction,
                    log_c,
                    throughput,
                    lambda_from,
                    first,
                ));
            }
        });
    }

    /// `f_cos` that `scattering` sends on by one more to `to`, RGB, sr⁻¹, times its share in the balance heuristic
    /// against `others` walks from `to` for every walk that it is of.
    ///
    /// The two techniques differ in what they draw only at the ends: walking from `from` draws the first
    /// direction with density p(from → first), walking from `to` draws the last one, reversed, with density
    /// p(to → −last). What lies between is drawn by both, and the Smith model is reciprocal for every sequence of
    /// directions once heights are integrated out, so shares made of these two densities sum to 1.
    #[inline]
    pub(super) fn connect_to(&self, scattering: &Scattering, to: &End, others: Real) -> Vec3 {
        let exit = HalfVector::new(to.direction, scattering.back, self.alpha);
        // Without a normal that mirrors into `to` there is nothing to connect, and perhaps 0/0.
        if exit.density <= 0.0 {
            return Vec3::ZERO;
        }
        let (heights, over) = scattering.heights(to.lambda);
        // first/(first + others·D/area), with the quotient of heights in one division.
        let first = scattering.first * to.area;
        let scale = 0.25 * exit.density * first * heights / (over * (first + others * exit.density));
        match scale.is_finite() {
            true => scattering.throughput * self.fresnel.at(exit.cos) * scale,
            false => Vec3::ZERO,
        }
    }
}

/// f is reciprocal: f(wo, wi)·cos θ_i is f(wi, wo)·cos θ_o times this, cos θ_i / cos θ_o.
#[inline]
pub(super) fn reversal(wo: Vec3, wi: Vec3) -> Real {
    wi.z / wo.z
}
