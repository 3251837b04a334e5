//! Many directions to the light for one to the camera, sharing the walks through the slab.
//!
//! One set of walks tells the light that rises to the interface; every direction gathers it through facets of its
//! own. That is the one-ended form of [`Layered::body`], unbiased at every direction; its error is common to all of
//! them, so the slice is as smooth as the phase function and the interface that spread it.

use super::Layered;
use super::field::Field;
use super::link::Exit;
use crate::bsdf::{Slice, shifted_r2, usable};
use crate::random::Rng;
use crate::real::{Real, Vec3};

/// Key of the facets through which light leaves, the same for all directions.
const EXIT_KEY: u64 = 0xe817;

/// Facets per direction to the light, stratified by an R2 sequence: their own error stays well below that of the
/// walks.
const EXITS: usize = 64;

/// The light under the interface from one `wo`, and how it is gathered.
#[derive(Clone, Debug)]
pub struct LayeredSlice<'a> {
    layered: &'a Layered,
    wo: Vec3,
    field: Field,
    /// Random numbers of the facets to the light.
    exits: Vec<[Real; 2]>,
}

impl<'a> LayeredSlice<'a> {
    /// Walks `walks` times from `wo`, keyed by `seed`.
    pub fn new(layered: &'a Layered, wo: Vec3, walks: usize, seed: u64) -> LayeredSlice<'a> {
        let shift = Rng::new(&[EXIT_KEY, seed]).pair();
        LayeredSlice {
            layered,
            wo,
            field: Field::new(layered, wo, walks, seed),
            exits: (0..EXITS as u64).map(|i| shifted_r2(i, shift)).collect(),
        }
    }

    /// Light that entered the slab alone: `f_cos` at `wi`, RGB, sr⁻¹.
    pub fn body(&self, wi: Vec3) -> Vec3 {
        if !usable(wi) {
            return Vec3::ZERO;
        }
        // Without an interface all facets are one, but parts of the field differ.
        let mut sum = Vec3::ZERO;
        for (k, u) in self.exits.iter().enumerate() {
            if let Some(entered) = self.layered.enter(wi, *u) {
                let exit = Exit::new(self.layered, &entered);
                sum += self.field.part(self.layered, &exit, k, EXITS) * (entered.share * entered.masking);
            }
        }
        sum * self.layered.exit_scale(wi)
    }
}

impl Slice for LayeredSlice<'_> {
    fn eval(&self, wi: Vec3) -> Vec3 {
        Vec3::splat(self.layered.reflection(self.wo, wi)) + self.body(wi)
    }
}
