//! Scattering of order 2 and up between two given directions: walks from both ends, combined.
//!
//! A walk from one direction that connects to the other meets, now and then, a vertex whose lobe points right
//! at it: rare and bright. The same sequence of directions can be walked from the other end, where it is
//! ordinary. Both walks are taken and weighed by the balance heuristic (Veach and Guibas 1995, *Optimally
//! Combining Sampling Techniques*), as Heitz et al. 2016 combine theirs. Deviation: the height of the last
//! scattering (and of both, at order 2, nearly all of this light) is not drawn but integrated in closed form, so
//! that every scattering connects and not only those after which the light is still inside.

use super::Conductor;
use super::walk::Event;
use crate::bsdf::usable;
use crate::microfacet::{HalfVector, Stretched};
use crate::random::Rng;
use crate::real::{Real, Vec3};

/// Exponent below which the heights of a rising flight take their limit for equal Λ: its error is half of this.
const EQUAL_LAMBDAS: Real = 1e-9;

/// One end of the light's way.
struct End {
    direction: Vec3,
    stretched: Stretched,
    lambda: Real,
}

impl End {
    fn new(direction: Vec3, alpha: [Real; 2]) -> End {
        let stretched = Stretched::new(direction, alpha);
        let lambda = stretched.lambda_up();
        End {
            direction,
            stretched,
            lambda,
        }
    }

    /// Four times the density of scattering from this end at the visible normal `half`, sr⁻¹.
    fn density(&self, half: &HalfVector) -> Real {
        half.density / self.stretched.projected_area()
    }
}

impl Conductor {
    /// An unbiased estimate of f_cos of order 2 and up, RGB, sr⁻¹, from one walk from either end.
    ///
    /// Zero unless both directions are above the horizon.
    pub fn multiple(&self, wo: Vec3, wi: Vec3, rng: &mut Rng) -> Vec3 {
        if !usable(wo) || !usable(wi) {
            return Vec3::ZERO;
        }
        let (from, to) = (End::new(wo, self.alpha), End::new(wi, self.alpha));
        let forward = self.one_ended(&from, &to, rng);
        // f is reciprocal: f(wo, wi)·cos θ_i = f(wi, wo)·cos θ_o · cos θ_i / cos θ_o.
        let backward = self.one_ended(&to, &from, rng);
        forward + backward * (wi.z / wo.z)
    }

    /// What one walk from `from` finds, each sequence of directions times its share in the balance heuristic.
    ///
    /// The two techniques differ in what they draw only at the ends: walking from `from` draws the first
    /// direction with density p(from → first), walking from `to` draws the last one, reversed, with density
    /// p(to → −last). What lies between is drawn by both, and the Smith model is reciprocal for every sequence of
    /// directions once heights are integrated out, so shares made of these two densities sum to 1.
    fn one_ended(&self, from: &End, to: &End, rng: &mut Rng) -> Vec3 {
        let mut own = None;
        let mut sum = Vec3::ZERO;
        let u = rng.pair();
        self.walk_events(from.direction, u, rng, |event| {
            let Event::Scattered {
                direction,
                log_c,
                throughput,
            } = event
            else {
                return;
            };
            let exit = HalfVector::new(to.direction, -direction, self.alpha);
            let lambda_from = own.is_none().then_some(from.lambda);
            let own = *own
                .get_or_insert_with(|| from.density(&HalfVector::new(from.direction, direction, self.alpha)));
            let share = own / (own + to.density(&exit));
            // Without a normal that mirrors into `to` there is nothing to connect, and perhaps 0/0.
            if exit.density > 0.0 && share.is_finite() {
                let scattering = Scattering::new(self, direction, log_c, throughput, lambda_from);
                sum += self.connect_half(&scattering, &exit, to.lambda) * share;
            }
        });
        sum
    }

    /// `f_cos` that `scattering` sends on by one more, at the half vector `exit`, to a direction whose Λ is `lambda`.
    #[inline]
    pub(super) fn connect_half(&self, scattering: &Scattering, exit: &HalfVector, lambda: Real) -> Vec3 {
        let scale = 0.25 * exit.density * scattering.heights(lambda);
        scattering.throughput * self.fresnel.at(exit.cos) * scale
    }
}

/// A scattering of a walk, ready to be connected to any direction: what does not depend on that is computed once.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scattering {
    /// Where the light came from: its direction of travel after the scattering, reversed.
    pub back: Vec3,
    /// ln C1 of the height of the scattering.
    log_c: Real,
    /// RGB throughput, the scattering included.
    pub throughput: Vec3,
    /// Whether the light travels upward.
    rises: bool,
    /// |z| of the direction, and the projected area |z|·(1 + Λ) seen from it with its z upward.
    z: Real,
    area: Real,
    /// For the first scattering from a direction with Λ = `lambda`, that Λ.
    lambda_from: Option<Real>,
}

impl Scattering {
    /// Light scattered into `direction` at the height whose ln C1 is `log_c`; `lambda_from` is the Λ of where the
    /// walk began if this is its first scattering.
    #[inline]
    pub fn new(
        conductor: &Conductor,
        direction: Vec3,
        log_c: Real,
        throughput: Vec3,
        lambda_from: Option<Real>,
    ) -> Scattering {
        let z = direction.z.abs();
        Scattering {
            back: -direction,
            log_c,
            throughput,
            rises: direction.z > 0.0,
            z,
            area: Stretched::new(direction.with_z(z), conductor.alpha).projected_area(),
            lambda_from,
        }
    }

    /// The next scattering's place in height, and the way out from there along a direction with Λ = `lambda`, over
    /// the projected area σ(−direction): integrated over every height that was not drawn.
    #[inline]
    pub fn heights(&self, lambda: Real) -> Real {
        match self.lambda_from {
            Some(from) => self.both_heights(from, lambda),
            None => self.next_height(lambda),
        }
    }

    /// The heights of two scatterings, from a direction with Λ_o = `from` to one with Λ_i = `to`.
    ///
    /// With c the C1 of a height, light from above scatters first with density (1 + Λ_o)·c₁^Λ_o. Rising, it
    /// scatters again with density Λ·c₁^Λ·c₂^(−Λ−1) above c₁; falling, with (1 + Λ)·c₂^Λ·c₁^(−1−Λ) below; and
    /// leaves with probability c₂^Λ_i (Heitz et al. 2016, Eqs. 12–17, in terms of C1). The integral over both,
    /// where the projected area σ(−first), Λ·z or (1 + Λ)·|z|, cancels:
    /// (1 + Λ_o) / (|z|·(1 + Λ_x + Λ)·(1 + Λ_o + Λ_i)), with x = o where `first` rises and i where it falls.
    #[inline]
    fn both_heights(&self, from: Real, to: Real) -> Real {
        let side = if self.rises { from } else { to };
        // |z|·(1 + Λ_x + Λ), finite for a horizontal direction: |z|·(1 + Λ) is the projected area.
        (1.0 + from) / ((self.z * side + self.area) * (1.0 + from + to))
    }

    /// The height of the next scattering alone, on the way to a direction with Λ_i = `to`.
    ///
    /// Falling: c^Λ_i / (|z|·(1 + Λ + Λ_i)). Rising: (c^Λ − c^Λ_i) / (z·(Λ_i − Λ)).
    #[inline]
    fn next_height(&self, to: Real) -> Real {
        if !self.rises {
            return (to * self.log_c).exp() / (self.z * to + self.area);
        }
        let lambda = (self.area - self.z) / self.z;
        // c^min·(1 − c^|Λ_i − Λ|) / (z·|Λ_i − Λ|), whose limit for equal Λ is −c^Λ·ln c / z.
        let gap = (self.z * to - (self.area - self.z)).abs();
        let exponent = gap / self.z * self.log_c;
        let slower = (lambda.min(to) * self.log_c).exp();
        match exponent.abs() < EQUAL_LAMBDAS {
            true => -slower * self.log_c / self.z,
            false => -slower * exponent.exp_m1() / gap,
        }
    }
}
