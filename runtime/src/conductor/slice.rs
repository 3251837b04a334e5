//! Many directions to the light for one to the camera, sharing the walks that multiple scattering costs.
//!
//! The scatterings of many walks from `wo` are kept, and every direction connects to *all* of them, the height of the
//! next one integrated in closed form as [`Conductor::multiple`] does. A few walks from the direction itself find what
//! these seldom meet; the balance heuristic over the numbers of both leaves the rest to the shared ones. That is
//! unbiased at every direction, and all numbers are common to all directions, so the slice is as smooth as the phase
//! function that spreads it. Single scattering is analytic.

use super::Conductor;
use super::eval::{End, reversal};
use super::scattering::Scattering;
use crate::bsdf::{Slice, shifted_r2, usable};
use crate::random::Rng;
use crate::real::{Real, Vec3};

/// Key of the walks. It does not depend on `wo`, so that the noise of slices varies smoothly with it, too.
const WALK_KEY: u64 = 0x51_1ce;
/// Key of the walks from the directions to the light, the same for all.
const BACK_KEY: u64 = 0x51_bac;

/// Walks from each direction to the light, unless fewer are shared: they cost as much as some hundred connections.
const BACK_WALKS: usize = 16;

/// The scatterings of many walks from one `wo`.
#[derive(Clone, Debug)]
pub struct ConductorSlice<'a> {
    conductor: &'a Conductor,
    wo: Vec3,
    scatterings: Vec<Scattering>,
    walks: usize,
    seed: u64,
}

impl<'a> ConductorSlice<'a> {
    /// Walks `walks` times from `wo`, keyed by `seed`; the first bounces are stratified by an R2 sequence.
    pub fn new(conductor: &'a Conductor, wo: Vec3, walks: usize, seed: u64) -> ConductorSlice<'a> {
        let mut scatterings = Vec::new();
        if usable(wo) {
            let from = End::new(wo, conductor.alpha);
            for (u, mut rng) in numbers(WALK_KEY, seed, walks) {
                conductor.scatterings(&from, u, &mut rng, |scattering| scatterings.push(scattering));
            }
        }
        ConductorSlice {
            conductor,
            wo,
            scatterings,
            walks,
            seed,
        }
    }

    /// Multiple scattering alone: `f_cos` of order 2 and up at `wi`, RGB, sr⁻¹.
    pub fn multiple(&self, wi: Vec3) -> Vec3 {
        if !usable(self.wo) || !usable(wi) || self.walks == 0 {
            return Vec3::ZERO;
        }
        let alpha = self.conductor.alpha;
        let (from, to) = (End::new(self.wo, alpha), End::new(wi, alpha));
        let back_walks = BACK_WALKS.min(self.walks);
        let (shared, back) = (self.walks as Real, back_walks as Real);
        let mut forward = Vec3::ZERO;
        for scattering in &self.scatterings {
            forward += self.conductor.connect_to(scattering, &to, back / shared);
        }
        let mut backward = Vec3::ZERO;
        for (u, mut rng) in numbers(BACK_KEY, self.seed, back_walks) {
            backward += self.conductor.one_ended(&to, &from, shared / back, u, &mut rng);
        }
        forward / shared + backward * (reversal(self.wo, wi) / back)
    }
}

/// Pairs of an R2 sequence with a stream each, keyed by `key` and `seed`.
fn numbers(key: u64, seed: u64, count: usize) -> impl Iterator<Item = ([Real; 2], Rng)> {
    let shift = Rng::new(&[key, seed]).pair();
    (0..count as u64).map(move |i| (shifted_r2(i, shift), Rng::new(&[key, seed, i])))
}

impl Slice for ConductorSlice<'_> {
    fn eval(&self, wi: Vec3) -> Vec3 {
        self.conductor.single(self.wo, wi) + self.multiple(wi)
    }
}
