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
use crate::bsdf::{Rest, Slice, usable};
use crate::random::{Prefixed, stratified};
use crate::real::{Real, Vec3};

/// Key of the walks. It does not depend on `wo`, so that the noise of slices varies smoothly with it, too.
const WALK_KEY: u64 = 0x51_1ce;
/// Key of the walks from the directions to the light, the same for all.
const BACK_KEY: u64 = 0x51_bac;

/// Walks from each direction to the light, unless fewer are shared: they cost as much as some hundred connections.
const BACK_WALKS: usize = 16;

/// Stratified numbers of a walk after the first normal: the flights before and after it, and the second normal.
const CHOSEN: usize = 4;

/// The scatterings of many walks from one `wo`.
#[derive(Clone, Debug)]
pub struct ConductorSlice<'a> {
    conductor: &'a Conductor,
    wo: Vec3,
    scatterings: Vec<Scattering>,
    walks: usize,
    /// Numbers of the walks from each direction to the light.
    back: Vec<([Real; 2], Prefixed<CHOSEN>)>,
}

impl<'a> ConductorSlice<'a> {
    /// Walks `walks` times from `wo`, keyed by `seed`; the first two bounces are stratified by Sobol points.
    pub fn new(conductor: &'a Conductor, wo: Vec3, walks: usize, seed: u64) -> ConductorSlice<'a> {
        let mut scatterings = Vec::new();
        if usable(wo) {
            let from = End::new(wo, conductor.alpha);
            for (u, mut rest) in stratified::<CHOSEN>(WALK_KEY, seed, walks) {
                conductor.scatterings(&from, u, &mut rest, |scattering| scatterings.push(scattering));
            }
        }
        ConductorSlice {
            conductor,
            wo,
            scatterings,
            walks,
            back: stratified(BACK_KEY, seed, BACK_WALKS.min(walks)).collect(),
        }
    }

    /// Multiple scattering alone: `f_cos` of order 2 and up at `wi`, RGB, sr⁻¹.
    pub fn multiple(&self, wi: Vec3) -> Vec3 {
        if !usable(self.wo) || !usable(wi) || self.walks == 0 {
            return Vec3::ZERO;
        }
        let alpha = self.conductor.alpha;
        let (from, to) = (End::new(self.wo, alpha), End::new(wi, alpha));
        let (shared, back) = (self.walks as Real, self.back.len() as Real);
        let mut forward = Vec3::ZERO;
        for scattering in &self.scatterings {
            forward += self.conductor.connect_to(scattering, &to, back / shared);
        }
        let mut backward = Vec3::ZERO;
        for (u, rest) in &self.back {
            backward += self
                .conductor
                .one_ended(&to, &from, shared / back, *u, &mut rest.clone());
        }
        forward / shared + backward * (reversal(self.wo, wi) / back)
    }
}

impl Slice for ConductorSlice<'_> {
    /// Single scattering.
    fn sharp(&self, wi: Vec3) -> Vec3 {
        self.conductor.single(self.wo, wi)
    }

    /// All higher orders.
    fn smooth(&self, wi: Vec3) -> Vec3 {
        self.multiple(wi)
    }

    fn alpha(&self) -> [Real; 2] {
        self.conductor.alpha
    }

    fn rest(&self) -> Rest {
        Rest::Alike
    }
}
