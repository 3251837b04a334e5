//! One scattering of a walk, and what the heights on the way to any next direction integrate to.
//!
//! Source: Heitz et al. 2016, *Multiple-Scattering Microfacet BSDFs with the Smith Model*, Eqs. 12–17, in terms of C1,
//! the share of the surface that lies below a height.

use super::Conductor;
use crate::microfacet::Stretched;
use crate::real::{Real, Vec3};

/// Exponent below which the heights of a rising flight take their limit for equal Λ: its error is half of this.
const EQUAL_LAMBDAS: Real = 1e-9;

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
    /// For the first scattering of a walk, Λ of where it began.
    lambda_from: Option<Real>,
    /// Four times the density with which the walk drew its first direction, sr⁻¹.
    pub first: Real,
}

impl Scattering {
    /// Light scattered into `direction` at the height whose ln C1 is `log_c`; `lambda_from` is the Λ of where the
    /// walk began if this is its first scattering, and `first` four times the density of that one, sr⁻¹.
    #[inline]
    pub fn new(
        conductor: &Conductor,
        direction: Vec3,
        log_c: Real,
        throughput: Vec3,
        lambda_from: Option<Real>,
        first: Real,
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
            first,
        }
    }

    /// The next scattering's place in height, and the way out from there along a direction with Λ = `lambda`, over
    /// the projected area σ(−direction): integrated over every height that was not drawn, as a quotient of the two.
    #[inline]
    pub fn heights(&self, lambda: Real) -> (Real, Real) {
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
    fn both_heights(&self, from: Real, to: Real) -> (Real, Real) {
        let side = if self.rises { from } else { to };
        // |z|·(1 + Λ_x + Λ), finite for a horizontal direction: |z|·(1 + Λ) is the projected area.
        (1.0 + from, (self.z * side + self.area) * (1.0 + from + to))
    }

    /// The height of the next scattering alone, on the way to a direction with Λ_i = `to`.
    ///
    /// Falling: c^Λ_i / (|z|·(1 + Λ + Λ_i)). Rising: (c^Λ − c^Λ_i) / (z·(Λ_i − Λ)).
    #[inline]
    fn next_height(&self, to: Real) -> (Real, Real) {
        if !self.rises {
            return ((to * self.log_c).exp(), self.z * to + self.area);
        }
        let lambda = (self.area - self.z) / self.z;
        // c^min·(1 − c^|Λ_i − Λ|) / (z·|Λ_i − Λ|), whose limit for equal Λ is −c^Λ·ln c / z.
        let gap = (self.z * to - (self.area - self.z)).abs();
        let exponent = gap / self.z * self.log_c;
        let slower = (lambda.min(to) * self.log_c).exp();
        match exponent.abs() < EQUAL_LAMBDAS {
            true => (-slower * self.log_c, self.z),
            false => (-slower * exponent.exp_m1(), gap),
        }
    }
}
