//! The random walk of light inside the microsurface, and its connections to the light.
//!
//! Source: Heitz et al. 2016, *Multiple-Scattering Microfacet BSDFs with the Smith Model*.
//! Deviation: the first bounce is left to [`Conductor::single`], so only vertices of order 2 and up connect.

use super::Conductor;
use crate::bsdf::{BsdfSample, usable};
use crate::microfacet::{HalfVector, Stretched};
use crate::random::{Rng, Uniforms};
use crate::real::{Real, Vec3};

/// First order of scattering that plays Russian roulette: most light has left by then.
///
/// Survival has the probability of the brightest channel, so white surfaces never play and weights stay ≤ 1.
/// Nothing else bounds a walk: at every roughness each order hands on less than 0.7 of the light it receives (tested
/// where most is handed on), so that even white walks end.
const ROULETTE_ORDER: u32 = 4;

/// A point of a walk inside the microsurface from which light may leave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// Direction of travel arriving at this vertex (unit).
    pub direction: Vec3,
    /// C1 of the height: the share of the surface that lies below, in (0, 1].
    pub height_cdf: Real,
    /// RGB throughput before this interaction.
    pub throughput: Vec3,
}

/// What happens on a walk, in order.
#[derive(Clone, Copy, Debug)]
pub(super) enum Event {
    /// Light scattered into `direction` at the height whose ln C1 is `log_c`; `throughput` includes it.
    Scattered {
        direction: Vec3,
        log_c: Real,
        throughput: Vec3,
    },
    /// It met the surface again.
    Inside(Vertex),
}

impl Conductor {
    /// Walks once from `wo` and calls `visit` with each vertex of scattering order 2 and up, before scattering
    /// there.
    ///
    /// `u` in `[0,1)²` steers the normal of the first bounce, everything else draws from `rng`. Returns where the
    /// walk left, with the product of the reflectances as weight; `None` when Russian roulette ended it, or when
    /// `wo` is not above the horizon. Σ [`Conductor::connect`] over the vertices is an unbiased estimate of the
    /// scattering of order 2 and up.
    #[inline]
    pub fn walk(
        &self,
        wo: Vec3,
        u: [Real; 2],
        rng: &mut Rng,
        mut visit: impl FnMut(&Vertex),
    ) -> Option<BsdfSample> {
        self.walk_events(wo, u, rng, |event| {
            if let Event::Inside(vertex) = event {
                visit(&vertex);
            }
        })
    }

    /// The walk of [`Conductor::walk`], telling of every scattering and of every vertex.
    #[inline]
    pub(super) fn walk_events(
        &self,
        wo: Vec3,
        u: [Real; 2],
        rng: &mut impl Uniforms,
        mut tell: impl FnMut(Event),
    ) -> Option<BsdfSample> {
        if !usable(wo) {
            return None;
        }
        let mut ray = Stretched::new(-wo, self.alpha);
        let mut log_c = ray.fly(0.0, rng);
        let mut throughput = Vec3::ONE;
        let mut u = u;
        let mut order = 1u32;
        loop {
            let back = ray.reversed();
            let (direction, cos) = back.mirror(back.visible_normal(self.alpha, u));
            throughput *= self.fresnel.at(cos);
            ray = Stretched::new(direction, self.alpha);
            tell(Event::Scattered {
                direction,
                log_c,
                throughput,
            });
            log_c = ray.fly(log_c, rng);
            // A NaN is an endless vertical flight, out of the surface like any height above ln 1.
            let inside = log_c < 0.0;
            if !inside {
                return Some(BsdfSample {
                    wi: direction,
                    weight: throughput,
                });
            }
            order = order.saturating_add(1);
            if order >= ROULETTE_ORDER {
                let survival = throughput.max_element();
                if rng.uniform() >= survival {
                    return None;
                }
                throughput /= survival;
            }
            tell(Event::Inside(Vertex {
                direction,
                height_cdf: log_c.exp().max(Real::MIN_POSITIVE),
                throughput,
            }));
            u = rng.pair();
        }
    }

    /// `f_cos` that `vertex` sends to `wi`, RGB, sr⁻¹: throughput · F·D / (4 σ) · C1^Λ(wi), with σ the projected
    /// area of the surface as the arriving light sees it.
    ///
    /// Zero where `wi` is not above the horizon or no normal mirrors there.
    #[inline]
    pub fn connect(&self, vertex: &Vertex, wi: Vec3) -> Vec3 {
        if !usable(wi) {
            return Vec3::ZERO;
        }
        let back = -vertex.direction;
        let half = HalfVector::new(back, wi, self.alpha);
        let area = Stretched::new(back, self.alpha).projected_area();
        // Masking is at most 1; the bound also resolves 0·∞ on the very horizon.
        let log_masking = (vertex.height_cdf.ln() * Stretched::new(wi, self.alpha).lambda_up()).min(0.0);
        let phase = half.density / (4.0 * area);
        vertex.throughput * self.fresnel.at(half.cos) * (phase * log_masking.exp())
    }
}
