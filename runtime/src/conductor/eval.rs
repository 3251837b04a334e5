//! Scattering of order 2 and up between two given directions: walks from both ends, combined.
//!
//! A walk from one direction that connects to the other meets, now and then, a vertex whose lobe points right
//! at it: rare and bright. The same sequence of directions can be walked from the other end, where it is
//! ordinary. Both walks are taken and weighed by the balance heuristic (Veach and Guibas 1995, *Optimally
//! Combining Sampling Techniques*), which keeps every contribution below about twice the larger density of the two
//! ends' own lobes. Heitz et al. 2016 weigh their two directions of walking by the same heuristic.

use super::microsurface::{HalfVector, Stretched};
use super::{Conductor, above_horizon};
use crate::random::Rng;
use glam::DVec3;

impl Conductor {
    /// An unbiased estimate of f_cos of order 2 and up, RGB, sr⁻¹, from one walk from either end.
    ///
    /// Zero unless both directions are above the horizon.
    pub fn multiple(&self, wo: DVec3, wi: DVec3, rng: &mut Rng) -> DVec3 {
        if !above_horizon(wo) || !above_horizon(wi) {
            return DVec3::ZERO;
        }
        let forward = self.weighted_connections(wo, wi, rng);
        // f is reciprocal: f(wo, wi)·cos θ_i = f(wi, wo)·cos θ_o · cos θ_i / cos θ_o.
        let backward = self.weighted_connections(wi, wo, rng);
        forward + backward * (wi.z / wo.z)
    }

    /// Connections to `to` of one walk from `from`, each times its share in the balance heuristic.
    ///
    /// The two techniques differ in what they draw only at the ends: walking from `from` draws the first
    /// direction with density p(from → first), walking from `to` draws the last one, reversed, with density
    /// p(to → −last). What lies between is drawn by both, and the Smith model is reciprocal for every sequence of
    /// directions once heights are integrated out, so shares made of these two densities sum to 1.
    #[inline]
    fn weighted_connections(&self, from: DVec3, to: DVec3, rng: &mut Rng) -> DVec3 {
        let mut first: Option<f64> = None;
        let area_to = Stretched::new(to, self.alpha).projected_area();
        let mut sum = DVec3::ZERO;
        let u = rng.pair();
        self.walk(from, u, rng, |vertex| {
            let own = *first.get_or_insert_with(|| {
                let area = Stretched::new(from, self.alpha).projected_area();
                HalfVector::new(from, vertex.direction, self.alpha).density / area
            });
            let other = HalfVector::new(to, -vertex.direction, self.alpha).density / area_to;
            // Without a normal that mirrors, `other` is zero and so is the connection.
            if other > 0.0 {
                sum += self.connect(vertex, to) * (own / (own + other));
            }
        });
        sum
    }
}
