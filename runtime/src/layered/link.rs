//! Transport from a segment of a walk to a direction out of the slab, by one scattering that is integrated over all
//! the places where it can happen.
//!
//! Source: Chandrasekhar 1960, *Radiative Transfer*, §17, for its first scattering in a homogeneous slab.

use super::Layered;
use super::interface::Scattered;
use super::walk::{Segment, slope};
use crate::real::consts::FRAC_1_PI;
use crate::real::{Real, Vec3};

/// Optical way above which a difference of exponentials keeps its precision; below it, it is written as a quotient.
const LONG: Real = 0.5;

/// (1 − e^(−x))/x for x ≥ 0, 1 at 0.
#[inline]
fn decay(x: Real) -> Real {
    if x > 0.0 { -(-x).exp_m1() / x } else { 1.0 }
}

/// A direction out of the slab.
#[derive(Clone, Copy, Debug)]
pub(super) struct Exit {
    /// Unit direction of travel, z > 0.
    pub direction: Vec3,
    slope: Real,
    base_way: Real,
}

impl Exit {
    /// The way out to a direction of light that `entered` the slab.
    #[inline]
    pub fn new(layered: &Layered, entered: &Scattered) -> Exit {
        Exit {
            direction: -entered.direction,
            ..Exit::at_slope(layered, slope(entered.direction))
        }
    }

    /// A way out at `slope` = |z|, in `(0, 1]`, towards any azimuth.
    #[inline]
    pub fn at_slope(layered: &Layered, slope: Real) -> Exit {
        Exit {
            direction: Vec3::new((1.0 - slope * slope).max(0.0).sqrt(), 0.0, slope),
            slope,
            base_way: (-layered.sigma_t / slope).exp(),
        }
    }

    /// |z| of the direction, bounded from below as in walks.
    #[inline]
    pub fn slope(&self) -> Real {
        self.slope
    }

    /// e^(−τ/μ'): what is left on the way from the base to the interface.
    #[inline]
    pub fn base_way(&self) -> Real {
        self.base_way
    }
}

/// A segment, with what does not depend on where light goes next.
#[derive(Clone, Copy, Debug)]
pub(super) struct Link {
    depth: Real,
    slope: Real,
    rises: bool,
    /// Share of its flux that reaches the boundary ahead, interface or base, without a scattering.
    reached: Real,
}

impl Link {
    /// Prepares `segment`.
    #[inline]
    pub fn new(layered: &Layered, segment: &Segment) -> Link {
        let slope = slope(segment.direction);
        let rises = segment.direction.z > 0.0;
        let ahead = match rises {
            true => segment.depth,
            false => (layered.sigma_t - segment.depth).max(0.0),
        };
        Link {
            depth: segment.depth,
            slope,
            rises,
            reached: (-ahead / slope).exp(),
        }
    }

    /// Radiance that leaves along `exit`, just below the interface, per flux along this segment, by a scattering in
    /// the medium, without the albedo and the phase function, dimensionless.
    ///
    /// With μ, μ' the slopes of segment and exit and t the depth where it starts, falling light gives
    /// (e^(−t/μ') − e^(−(τ−t)/μ)·e^(−τ/μ'))/(μ + μ'), rising light (e^(−t/μ') − e^(−t/μ))/(μ' − μ).
    #[inline]
    pub fn scattered(&self, layered: &Layered, exit: &Exit) -> Real {
        let (t, mu, mu_exit) = (self.depth, self.slope, exit.slope);
        let through = t / mu_exit;
        if self.rises {
            let way = t / mu;
            if (way - through).abs() > LONG {
                ((-through).exp() - self.reached) / (mu_exit - mu)
            } else {
                // e^(−min)·(1 − e^(−x))/x · t/(μ·μ'), whose limit for equal slopes needs no case.
                (-way.min(through)).exp() * decay((way - through).abs()) * (way / mu_exit)
            }
        } else {
            let thickness = (layered.sigma_t - t).max(0.0);
            let x = thickness / mu + thickness / mu_exit;
            if x > LONG {
                ((-through).exp() - self.reached * exit.base_way) / (mu + mu_exit)
            } else {
                (-through).exp() * decay(x) * (thickness / mu / mu_exit)
            }
        }
    }

    /// The same off the base, as it leaves the base in any direction, without its reflectance, sr⁻¹.
    #[inline]
    pub fn based(&self) -> Real {
        if self.rises { 0.0 } else { self.reached * FRAC_1_PI }
    }
}
