//! Light that enters the slab, scatters there and leaves it, between two given directions.
//!
//! Both directions are refracted into the slab at facets that they see; a walk from one of them then connects, from
//! every segment, to the other. Deviations from Guo et al. 2018: where light scatters last is not drawn but
//! integrated in closed form, in the medium and on the base at once; both ends are walked from, weighed by the
//! balance heuristic over the directions alone, which bounds what a peaked phase function makes of a connection;
//! and no path is ever connected through the interface, so that a smooth one is no harder than a rough one.

use super::Layered;
use super::interface::Scattered;
use super::link::{Exit, Link};
use super::phase::henyey_greenstein;
use super::walk::{Dye, Segment};
use crate::bsdf::{r2_from, usable};
use crate::random::Rng;
use crate::real::consts::FRAC_1_PI;
use crate::real::{Real, Vec3};

/// Share of a walk in a path whose first vertex drew its direction with density `first`, and whose last would draw its
/// own, backwards, with density `last`, sr⁻¹, where `others` walks from the other end are taken for each from this.
///
/// Veach and Guibas 1995, *Optimally Combining Sampling Techniques*: what lies between is drawn by both. A path with one
/// vertex is drawn by neither, and is shared out by the numbers of walks alone.
#[inline]
pub(super) fn share(first: Option<Real>, last: Real, others: Real) -> Real {
    match first {
        None => 1.0 / (1.0 + others),
        Some(first) if first + others * last > 0.0 => first / (first + others * last),
        Some(_) => 0.0,
    }
}

impl Layered {
    /// An unbiased estimate of `f_cos` of all light that enters the slab, RGB, sr⁻¹.
    ///
    /// Zero unless both directions are above the horizon.
    pub fn body(&self, wo: Vec3, wi: Vec3, rng: &mut Rng) -> Vec3 {
        self.body_mean(wo, wi, 1, rng)
    }

    /// The same as a mean of `count` estimates, whose facets of entry and exit lie evenly: less noise than as many that know
    /// nothing of each other.
    pub fn body_mean(&self, wo: Vec3, wi: Vec3, count: u32, rng: &mut Rng) -> Vec3 {
        if !usable(wo) || !usable(wi) {
            return Vec3::ZERO;
        }
        let (entry, exit) = (rng.pair(), rng.pair());
        let (dye, scale) = (self.dye(), self.exit_scale(wi));
        let mut sum = Vec3::ZERO;
        for k in 0..count {
            let facets = (
                self.enter(wo, r2_from(entry, k)),
                self.enter(wi, r2_from(exit, k)),
            );
            let (Some(o), Some(i)) = facets else {
                continue;
            };
            let forth = self.connections(&o, &i, &dye, Some(1.0), rng);
            let back = self.connections(&i, &o, &dye, Some(1.0), rng);
            sum += (forth + back) * (o.share * o.masking * i.share * i.masking * scale);
        }
        sum / count as Real
    }

    /// An unbiased estimate of the density of [`crate::Bsdf::sample`] at `wi`, sr⁻¹, as it were without roulette.
    ///
    /// It integrates to less than 1 where walks are lost: facets that mirror or refract to the wrong side. The same
    /// estimator without colours: masking of what the walk draws is left out, as visible normals leave it out of the
    /// density, and the last facet, drawn from `wi`, is weighed as the walk would have drawn it.
    pub fn pdf_stochastic(&self, wo: Vec3, wi: Vec3, rng: &mut Rng) -> Real {
        if !usable(wo) || !usable(wi) {
            return 0.0;
        }
        let interface = self.interface();
        let mirrored = interface.mirrored(wo, wi);
        let (Some(o), Some(i)) = (self.enter(wo, rng.pair()), self.enter(wi, rng.pair())) else {
            return mirrored;
        };
        let seen = if interface.is_absent() {
            1.0
        } else {
            interface.masking(wi)
        };
        let forth = self.connections(&o, &i, &Dye::WHITE, None, rng);
        mirrored + forth.x * (o.share * i.share * i.masking / seen * self.exit_scale(wi))
    }

    /// Refraction of `w` (unit, above the horizon) into the slab at a facet it sees.
    #[inline]
    pub(super) fn enter(&self, w: Vec3, u: [Real; 2]) -> Option<Scattered> {
        let interface = self.interface();
        interface.refract(&interface.facet(w, u))
    }

    /// cos θ_i / η²: from radiance under the interface, per flux that entered, to `f_cos` above it.
    ///
    /// Once, not twice: light is concentrated by η² on the way in and thinned out by it on the way out, but the flux
    /// per area that it is measured by here does not change on the way in.
    #[inline]
    pub(super) fn exit_scale(&self, wi: Vec3) -> Real {
        wi.z / (self.eta * self.eta)
    }

    /// Radiance on the way out to `to`, just below the interface, per flux that entered at `from`, RGB, sr⁻¹: the sum
    /// over the segments of one walk of what scatters from each, times its [`share`] against `others` walks the other
    /// way.
    ///
    /// Without `others` the walk stands alone, and its throughput leaves out masking, as its own density does: masking
    /// is not the same in both directions, so such walks cannot be shared.
    pub(super) fn connections(
        &self,
        from: &Scattered,
        to: &Scattered,
        dye: &Dye,
        others: Option<Real>,
        rng: &mut Rng,
    ) -> Vec3 {
        let exit = Exit::new(self, to);
        let start = Segment::start(from.direction, Vec3::ONE);
        let mut sum = Vec3::ZERO;
        self.walk_inside(start, dye, others.is_some(), rng, |segment| {
            let link = Link::new(self, segment);
            let phase = henyey_greenstein(segment.direction, exit.direction, self.g);
            let share = |last| share(segment.first, last, others.unwrap_or(0.0));
            let scattered = link.scattered(self, &exit) * phase * share(phase);
            let based = link.based() * exit.base_way() * share(segment.direction.z.abs() * FRAC_1_PI);
            sum += segment.throughput * (dye.albedo * scattered + dye.base * based);
        });
        sum
    }
}
