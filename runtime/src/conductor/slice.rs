//! Many directions to the light for one to the camera, sharing the walks that multiple scattering costs.
//!
//! The vertices of many walks are kept, and every direction is connected to *all* of them. That is the model's own
//! next-event estimator, hence unbiased at every direction, and its error is common to all of them, so the slice is
//! as smooth as the phase function that spreads it. Single scattering is analytic.

use super::{Conductor, Vertex};
use crate::bsdf::{Slice, shifted_r2};
use crate::random::Rng;
use crate::real::{Real, Vec3};

/// Key of the walks. It does not depend on `wo`, so that the noise of slices varies smoothly with it, too.
const WALK_KEY: u64 = 0x51_1ce;

/// The vertices of order 2 and up of many walks from one `wo`.
#[derive(Clone, Debug)]
pub struct ConductorSlice<'a> {
    conductor: &'a Conductor,
    wo: Vec3,
    vertices: Vec<Vertex>,
    walks: usize,
}

impl<'a> ConductorSlice<'a> {
    /// Walks `walks` times from `wo`, keyed by `seed`; the first bounces are stratified by an R2 sequence.
    pub fn new(conductor: &'a Conductor, wo: Vec3, walks: usize, seed: u64) -> ConductorSlice<'a> {
        let mut vertices = Vec::new();
        let shift = Rng::new(&[WALK_KEY, seed]).pair();
        for i in 0..walks as u64 {
            let mut rng = Rng::new(&[WALK_KEY, seed, i]);
            conductor.walk(wo, shifted_r2(i, shift), &mut rng, |v| vertices.push(*v));
        }
        ConductorSlice {
            conductor,
            wo,
            vertices,
            walks: walks.max(1),
        }
    }

    /// Multiple scattering alone: `f_cos` of order 2 and up at `wi`, RGB, sr⁻¹.
    pub fn multiple(&self, wi: Vec3) -> Vec3 {
        let sum: Vec3 = self.vertices.iter().map(|v| self.conductor.connect(v, wi)).sum();
        sum / self.walks as Real
    }
}

impl Slice for ConductorSlice<'_> {
    fn eval(&self, wi: Vec3) -> Vec3 {
        self.conductor.single(self.wo, wi) + self.multiple(wi)
    }
}
