//! Many directions to the light for one to the camera, sharing the walks that multiple scattering costs.
//!
//! The scatterings of many walks are kept, and every direction connects to *all* of them, the height of the next one
//! integrated in closed form as [`Conductor::multiple`] does. That is an unbiased estimator at every direction, and
//! its error is common to all of them, so the slice is as smooth as the phase function that spreads it. Single
//! scattering is analytic.

use super::Conductor;
use super::eval::Scattering;
use super::walk::Event;
use crate::bsdf::{Slice, shifted_r2, usable};
use crate::microfacet::{HalfVector, Stretched};
use crate::random::Rng;
use crate::real::{Real, Vec3};

/// Key of the walks. It does not depend on `wo`, so that the noise of slices varies smoothly with it, too.
const WALK_KEY: u64 = 0x51_1ce;

/// The scatterings of many walks from one `wo`.
#[derive(Clone, Debug)]
pub struct ConductorSlice<'a> {
    conductor: &'a Conductor,
    wo: Vec3,
    scatterings: Vec<Scattering>,
    walks: usize,
}

impl<'a> ConductorSlice<'a> {
    /// Walks `walks` times from `wo`, keyed by `seed`; the first bounces are stratified by an R2 sequence.
    pub fn new(conductor: &'a Conductor, wo: Vec3, walks: usize, seed: u64) -> ConductorSlice<'a> {
        let mut scatterings = Vec::new();
        let shift = Rng::new(&[WALK_KEY, seed]).pair();
        for i in 0..if usable(wo) { walks as u64 } else { 0 } {
            let mut lambda_from = Some(Stretched::new(wo, conductor.alpha).lambda_up());
            let mut rng = Rng::new(&[WALK_KEY, seed, i]);
            conductor.walk_events(wo, shifted_r2(i, shift), &mut rng, |event| {
                if let Event::Scattered {
                    direction,
                    log_c,
                    throughput,
                } = event
                {
                    let from = lambda_from.take();
                    scatterings.push(Scattering::new(conductor, direction, log_c, throughput, from));
                }
            });
        }
        ConductorSlice {
            conductor,
            wo,
            scatterings,
            walks: walks.max(1),
        }
    }

    /// Multiple scattering alone: `f_cos` of order 2 and up at `wi`, RGB, sr⁻¹.
    pub fn multiple(&self, wi: Vec3) -> Vec3 {
        if !usable(wi) {
            return Vec3::ZERO;
        }
        let alpha = self.conductor.alpha;
        let lambda = Stretched::new(wi, alpha).lambda_up();
        let mut sum = Vec3::ZERO;
        for scattering in &self.scatterings {
            let exit = HalfVector::new(wi, scattering.back, alpha);
            if exit.density > 0.0 {
                sum += self.conductor.connect_half(scattering, &exit, lambda);
            }
        }
        sum / self.walks as Real
    }
}

impl Slice for ConductorSlice<'_> {
    fn eval(&self, wi: Vec3) -> Vec3 {
        self.conductor.single(self.wo, wi) + self.multiple(wi)
    }
}
