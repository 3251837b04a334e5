//! The random walk of light between the interface and the base.
//!
//! Position-free (Guo, Hašan and Zhao 2018, *Position-Free Monte Carlo Simulation for Arbitrary Layered BSDFs*): the
//! slab extends without end, so a place in it is its optical depth, 0 under the interface and `sigma_t` on the base.

use super::Layered;
use super::phase::{henyey_greenstein, sample_henyey_greenstein};
use crate::bsdf::BsdfSample;
use crate::concentric::square_to_hemisphere;
use crate::random::Uniforms;
use crate::real::consts::FRAC_1_PI;
use crate::real::{Real, Vec3};

/// Vertex from which on Russian roulette is played; light that matters has been counted by then.
///
/// Survival has the probability of the brightest channel's throughput, so it stops no walk that loses nothing, and
/// weights stay ≤ 1. Nothing else bounds a walk: without losses it ends where it leaves the slab.
const ROULETTE_VERTEX: u32 = 3;

/// Cosines below this count as this: light along the slab then stays at its depth within 1e-6 of its way, and
/// reciprocals stay within f32.
pub(super) const COS_MIN: Real = 1e-6;

/// A straight piece of a walk: from optical depth `depth` along `direction`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    /// Optical depth where it starts.
    pub depth: Real,
    /// Unit direction of travel; z > 0 is up.
    pub direction: Vec3,
    /// RGB throughput so far, without what happens at its end.
    pub throughput: Vec3,
    /// Density, sr⁻¹, with which the walk's first vertex (in the medium or on the base) drew its direction; `None`
    /// before there is one.
    pub first: Option<Real>,
}

impl Segment {
    /// The first segment of a walk: under the interface, along `direction` (unit, z < 0).
    pub fn start(direction: Vec3, throughput: Vec3) -> Segment {
        Segment {
            depth: 0.0,
            direction,
            throughput,
            first: None,
        }
    }

    /// The segment after the interface has mirrored this one to `direction`, as it is seen from below (z > 0),
    /// keeping `share` of it.
    #[inline]
    pub fn below_interface(&self, direction: Vec3, share: Real) -> Segment {
        Segment {
            depth: 0.0,
            direction: flip(direction),
            throughput: self.throughput * share,
            first: self.first,
        }
    }
}

/// Russian roulette along one walk: see [`ROULETTE_VERTEX`].
#[derive(Debug, Default)]
pub(super) struct Roulette {
    vertices: u32,
}

impl Roulette {
    /// Counts a vertex.
    #[inline]
    pub fn vertex(&mut self) {
        self.vertices = self.vertices.saturating_add(1);
    }

    /// The throughput to go on with; `None` where the walk ends.
    #[inline]
    pub fn play(&self, throughput: Vec3, rng: &mut impl Uniforms) -> Option<Vec3> {
        let survival = throughput.max_element();
        if survival <= 0.0 {
            return None;
        }
        if self.vertices < ROULETTE_VERTEX || survival >= 1.0 {
            return Some(throughput);
        }
        (rng.uniform() < survival).then(|| throughput / survival)
    }
}

/// What a segment meets.
pub(super) enum Met {
    /// The interface, from below.
    Interface,
    /// A vertex: light goes on along this segment.
    Vertex(Segment),
}

/// |z| of a direction, bounded from below by [`COS_MIN`].
#[inline]
pub(super) fn slope(direction: Vec3) -> Real {
    direction.z.abs().max(COS_MIN)
}

/// The two colours a walk is dyed with: white ones give the density of the walk instead of its light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Dye {
    /// Single-scattering albedo of the medium, RGB.
    pub albedo: Vec3,
    /// Reflectance of the base, RGB.
    pub base: Vec3,
}

impl Dye {
    /// No losses.
    pub const WHITE: Dye = Dye {
        albedo: Vec3::ONE,
        base: Vec3::ONE,
    };
}

impl Layered {
    /// Follows `segment` to what it meets.
    #[inline]
    pub(super) fn follow(&self, segment: &Segment, dye: &Dye, rng: &mut impl Uniforms) -> Met {
        let step = -(1.0 - rng.uniform()).ln() * slope(segment.direction);
        let up = segment.direction.z > 0.0;
        let depth = if up {
            segment.depth - step
        } else {
            segment.depth + step
        };
        if up && depth <= 0.0 {
            return Met::Interface;
        }
        let (depth, direction, colour, density) = if depth >= self.sigma_t {
            let u = rng.pair();
            let [x, y, z] = square_to_hemisphere(u, u.map(|v| 1.0 - v));
            (self.sigma_t, Vec3::new(x, y, z), dye.base, z * FRAC_1_PI)
        } else {
            let direction = sample_henyey_greenstein(segment.direction, self.g, rng.pair());
            let density = henyey_greenstein(segment.direction, direction, self.g);
            (depth, direction, dye.albedo, density)
        };
        Met::Vertex(Segment {
            depth,
            direction,
            throughput: segment.throughput * colour,
            first: segment.first.or(Some(density)),
        })
    }

    /// Walks on from `segment`, which starts under the interface, and calls `tell` with it and every later one.
    ///
    /// `masked`: whether throughput includes the masking of what the interface mirrors back into the slab.
    pub(super) fn walk_inside(
        &self,
        segment: Segment,
        dye: &Dye,
        masked: bool,
        rng: &mut impl Uniforms,
        mut tell: impl FnMut(&Segment),
    ) {
        let inside = self.interface().reversed();
        let mut segment = segment;
        let mut roulette = Roulette::default();
        loop {
            tell(&segment);
            segment = match self.follow(&segment, dye, rng) {
                Met::Vertex(next) => {
                    roulette.vertex();
                    next
                }
                Met::Interface => {
                    // Seen from below: z flips on the way in and out.
                    let facet = inside.facet(flip(-segment.direction), rng.pair());
                    let Some(mirrored) = inside.mirror(&facet) else {
                        return;
                    };
                    let masking = if masked { mirrored.masking } else { 1.0 };
                    segment.below_interface(mirrored.direction, mirrored.share * masking)
                }
            };
            match roulette.play(segment.throughput, rng) {
                Some(throughput) => segment.throughput = throughput,
                None => return,
            }
        }
    }

    /// Walks on from `segment` until the light leaves through the interface, which it does in its Fresnel share.
    ///
    /// Roulette is played for the colours alone: `masking`, of the facets that the walk has met, scales the weight.
    pub(super) fn walk_out(
        &self,
        segment: Segment,
        masking: Real,
        rng: &mut impl Uniforms,
    ) -> Option<BsdfSample> {
        let inside = self.interface().reversed();
        let dye = self.dye();
        let mut roulette = Roulette::default();
        let (mut segment, mut masking) = (segment, masking);
        loop {
            segment = match self.follow(&segment, &dye, rng) {
                Met::Vertex(next) => {
                    roulette.vertex();
                    next
                }
                Met::Interface => {
                    let facet = inside.facet(flip(-segment.direction), rng.pair());
                    if rng.uniform() >= facet.reflectance() {
                        let out = inside.refract(&facet)?;
                        return Some(BsdfSample {
                            wi: flip(out.direction),
                            weight: segment.throughput * (masking * out.masking),
                        });
                    }
                    let mirrored = inside.mirror(&facet)?;
                    masking *= mirrored.masking;
                    segment.below_interface(mirrored.direction, 1.0)
                }
            };
            segment.throughput = roulette.play(segment.throughput, rng)?;
        }
    }
}

/// The direction with z turned round: how the interface is seen from below.
#[inline]
pub(super) fn flip(w: Vec3) -> Vec3 {
    w.with_z(-w.z)
}
