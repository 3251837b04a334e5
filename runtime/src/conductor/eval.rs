//! Scattering of order 2 and up between two given directions: walks from both ends, combined.
//!
//! A walk from one direction that connects to the other meets, now and then, a vertex whose lobe points right
//! at it: rare and bright. The same sequence of directions can be walked from the other end, where it is
//! ordinary. Both walks are taken and weighed by the balance heuristic (Veach and Guibas 1995, *Optimally
//! Combining Sampling Techniques*), as Heitz et al. 2016 combine theirs. Deviation: order 2, nearly all of this
//! light, does not draw heights; they are integrated in closed form (see [`Conductor::twice`]), so that every
//! walk contributes and not only those that are still inside after one bounce.

use super::microsurface::{HalfVector, Stretched, schlick};
use super::{Conductor, above_horizon};
use crate::random::Rng;
use glam::DVec3;

/// One end of the light's way.
struct End {
    direction: DVec3,
    stretched: Stretched,
    lambda: f64,
}

impl End {
    fn new(direction: DVec3, alpha: [f64; 2]) -> End {
        let stretched = Stretched::new(direction, alpha);
        let lambda = stretched.lambda_up();
        End {
            direction,
            stretched,
            lambda,
        }
    }

    /// Density of scattering from this end to `w` at a visible normal `half`, times 4, sr⁻¹.
    fn density(&self, half: &HalfVector) -> f64 {
        half.density / self.stretched.projected_area()
    }
}

impl Conductor {
    /// An unbiased estimate of f_cos of order 2 and up, RGB, sr⁻¹, from one walk from either end.
    ///
    /// Zero unless both directions are above the horizon.
    pub fn multiple(&self, wo: DVec3, wi: DVec3, rng: &mut Rng) -> DVec3 {
        if !above_horizon(wo) || !above_horizon(wi) {
            return DVec3::ZERO;
        }
        let (from, to) = (End::new(wo, self.alpha), End::new(wi, self.alpha));
        let forward = self.from_one_end(&from, &to, rng);
        // f is reciprocal: f(wo, wi)·cos θ_i = f(wi, wo)·cos θ_o · cos θ_i / cos θ_o.
        let backward = self.from_one_end(&to, &from, rng);
        forward + backward * (wi.z / wo.z)
    }

    /// What one walk from `from` finds, each sequence of directions times its share in the balance heuristic.
    ///
    /// The two techniques differ in what they draw only at the ends: walking from `from` draws the first
    /// direction with density p(from → first), walking from `to` draws the last one, reversed, with density
    /// p(to → −last). What lies between is drawn by both, and the Smith model is reciprocal for every sequence of
    /// directions once heights are integrated out, so shares made of these two densities sum to 1.
    fn from_one_end(&self, from: &End, to: &End, rng: &mut Rng) -> DVec3 {
        let u = rng.pair();
        let (first, _) = from
            .stretched
            .mirror(from.stretched.visible_normal(self.alpha, u));
        let entry = HalfVector::new(from.direction, first, self.alpha);
        let own = from.density(&entry);
        let share = |other: f64| own / (own + other);
        let mut sum = DVec3::ZERO;
        let exit = HalfVector::new(to.direction, -first, self.alpha);
        if exit.density > 0.0 && own > 0.0 {
            sum += self.twice(from, first, to, &entry, &exit) * share(to.density(&exit));
        }
        // The same numbers give the walk the same first direction; its first vertex is order 2 again.
        let mut order = 1;
        self.walk(from.direction, u, rng, |vertex| {
            order += 1;
            let exit = HalfVector::new(to.direction, -vertex.direction, self.alpha);
            if order > 2 && exit.density > 0.0 && own > 0.0 {
                sum += self.connect(vertex, to.direction) * share(to.density(&exit));
            }
        });
        sum
    }

    /// f_cos of order 2 by way of `first`, over the density of drawing `first` from `from`; all heights.
    ///
    /// With c the C1 of a height, light from above scatters first with density (1 + Λ_o)·c₁^Λ_o. Rising, it
    /// scatters again with density Λ·c₁^Λ·c₂^(−Λ−1) above c₁; falling, with (1 + Λ)·c₂^Λ·c₁^(−1−Λ) below; and
    /// leaves with probability c₂^Λ_i (Heitz et al. 2016, Eqs. 12–17, in terms of C1). Integrated over both
    /// heights, and with the projected area σ(−first), which is Λ·z or (1 + Λ)·|z|, cancelled:
    /// F₁·F₂·D₂/(4|z|) · (1 + Λ_o) / ((1 + Λ_x + Λ)(1 + Λ_o + Λ_i)), x = o where `first` rises, i where it falls.
    fn twice(&self, from: &End, first: DVec3, to: &End, entry: &HalfVector, exit: &HalfVector) -> DVec3 {
        let side = if first.z > 0.0 { from.lambda } else { to.lambda };
        let steep = Stretched::new(first.with_z(first.z.abs()), self.alpha);
        // |z|·(1 + Λ_x + Λ), finite for a horizontal direction: |z|·(1 + Λ) is the projected area.
        let across = first.z.abs() * side + steep.projected_area();
        let heights = (1.0 + from.lambda) / (across * (1.0 + from.lambda + to.lambda));
        let fresnel = schlick(self.reflectance, entry.cos) * schlick(self.reflectance, exit.cos);
        fresnel * (0.25 * exit.density * heights)
    }
}
