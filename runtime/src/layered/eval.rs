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
use crate::bsdf::usable;
use crate::random::Rng;
use crate::real::consts::FRAC_1_PI;
use crate::real::{Real, Vec3};

/// Which walks tell of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Ends {
    /// Walks from both ends: each takes its share of the balance heuristic.
    Both,
    /// Walks from the first end alone.
    One,
}

impl Ends {
    /// Share of the walk from the first end in a path whose first vertex drew its direction with density `first`,
    /// and whose last would draw its own, backwards, with density `last`, sr⁻¹.
    ///
    /// Veach and Guibas 1995, *Optimally Combining Sampling Techniques*: what lies between is drawn by both. A path
    /// with one vertex is drawn by neither and counts half from each end.
    #[inline]
    fn share(self, first: Option<Real>, last: Real) -> Real {
        match (self, first) {
            (Ends::One, _) => 1.0,
            (Ends::Both, None) => 0.5,
            (Ends::Both, Some(first)) if first + last > 0.0 => first / (first + last),
            (Ends::Both, Some(_)) => 0.0,
        }
    }
}

impl Layered {
    /// An unbiased estimate of `f_cos` of all light that enters the slab, RGB, sr⁻¹.
    ///
    /// Zero unless both directions are above the horizon.
    pub fn body(&self, wo: Vec3, wi: Vec3, rng: &mut Rng) -> Vec3 {
        if !usable(wo) || !usable(wi) {
            return Vec3::ZERO;
        }
        let (Some(o), Some(i)) = (self.enter(wo, rng.pair()), self.enter(wi, rng.pair())) else {
            return Vec3::ZERO;
        };
        let dye = self.dye();
        let start = |end: &Scattered| Segment::start(end.direction, Vec3::ONE);
        let forth = self.connections(start(&o), &Exit::new(self, &i), &dye, Ends::Both, rng);
        let back = self.connections(start(&i), &Exit::new(self, &o), &dye, Ends::Both, rng);
        (forth + back) * (o.share * o.masking * i.share * i.masking * self.exit_scale(wi))
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
        let start = Segment::start(o.direction, Vec3::ONE);
        let forth = self.connections(start, &Exit::new(self, &i), &Dye::WHITE, Ends::One, rng);
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

    /// Radiance along `exit` just below the interface, per flux along `start`: the sum over the segments of one walk
    /// of what scatters from each to `exit`, RGB, sr⁻¹.
    fn connections(&self, start: Segment, exit: &Exit, dye: &Dye, ends: Ends, rng: &mut Rng) -> Vec3 {
        let masked = ends == Ends::Both;
        let mut sum = Vec3::ZERO;
        self.walk_inside(start, dye, masked, rng, |segment| {
            let link = Link::new(self, segment);
            let (scattered, based) = (link.scattered(self, exit), link.based() * exit.base_way());
            let share = |last| ends.share(segment.first, last);
            let mut part = Vec3::ZERO;
            if scattered > 0.0 {
                let phase = henyey_greenstein(segment.direction, exit.direction, self.g);
                part += dye.albedo * (scattered * phase * share(phase));
            }
            if based > 0.0 {
                part += dye.base * (based * share(segment.direction.z.abs() * FRAC_1_PI));
            }
            sum += segment.throughput * part;
        });
        sum
    }
}
