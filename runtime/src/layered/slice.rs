//! Many directions to the light for one to the camera, sharing the walks through the slab.
//!
//! One set of walks tells the light that rises to the interface; every direction gathers it through facets of its
//! own. Where the phase function has a direction, a few walks from that other end find what the shared ones seldom meet,
//! weighed as in [`Layered::body`] by the numbers of both. That is unbiased at every direction; all numbers are common to
//! all of them, so the slice is as smooth as the phase function and the interface that spread it.

use super::Layered;
use super::field::Field;
use super::link::Exit;
use crate::bsdf::{Rest, Slice, shifted_r2, usable};
use crate::random::Rng;
use crate::real::{Real, Vec3};

/// Keys of the facets through which light leaves, of those where the camera looks in, and of the walks between them;
/// the same for all directions.
const EXIT_KEY: u64 = 0xe817;
const ENTRY_KEY: u64 = 0xe927;
const BACK_KEY: u64 = 0x1a7e_0bac;

/// Facets per direction to the light, stratified by an R2 sequence: their own error stays well below that of the
/// walks.
const EXITS: usize = 64;

/// Walks from each direction to the light, where light scatters unevenly.
const BACK_WALKS: usize = 16;

/// The light under the interface from one `wo`, and how it is gathered.
#[derive(Clone, Debug)]
pub struct LayeredSlice<'a> {
    layered: &'a Layered,
    wo: Vec3,
    field: Field,
    /// Random numbers of the facets to the light.
    exits: Vec<[Real; 2]>,
    walks: usize,
    /// Random numbers of the walks from each direction to the light: facets on both ends, and what is between.
    back: Vec<BackNumbers>,
}

/// Random numbers of one walk from a direction to the light.
#[derive(Clone, Debug)]
struct BackNumbers {
    entry: [Real; 2],
    exit: [Real; 2],
    rest: Rng,
}

impl<'a> LayeredSlice<'a> {
    /// Walks `walks` times from `wo`, keyed by `seed`.
    pub fn new(layered: &'a Layered, wo: Vec3, walks: usize, seed: u64) -> LayeredSlice<'a> {
        let shift = |key| Rng::new(&[key, seed]).pair();
        let (exits, entries) = (shift(EXIT_KEY), shift(ENTRY_KEY));
        let back_walks = if layered.g == 0.0 {
            0
        } else {
            BACK_WALKS.min(walks)
        };
        LayeredSlice {
            layered,
            wo,
            field: Field::new(layered, wo, walks, seed),
            exits: (0..EXITS as u64).map(|i| shifted_r2(i, exits)).collect(),
            walks,
            back: (0..back_walks as u64)
                .map(|i| BackNumbers {
                    entry: shifted_r2(i, entries),
                    exit: shifted_r2(i, exits),
                    rest: Rng::new(&[BACK_KEY, seed, i]),
                })
                .collect(),
        }
    }

    /// Light that entered the slab alone: `f_cos` at `wi`, RGB, sr⁻¹.
    pub fn body(&self, wi: Vec3) -> Vec3 {
        if !usable(self.wo) || !usable(wi) || self.walks == 0 {
            return Vec3::ZERO;
        }
        let (shared, back) = (self.walks as Real, self.back.len() as Real);
        let mut sum = Vec3::ZERO;
        for (k, u) in self.exits.iter().enumerate() {
            if let Some(i) = self.layered.enter(wi, *u) {
                let exit = Exit::new(self.layered, &i);
                let part = self.field.part(self.layered, &exit, k, EXITS, back / shared);
                sum += part * (i.share * i.masking);
            }
        }
        let dye = self.layered.dye();
        for numbers in &self.back {
            let (entry, exit) = (
                self.layered.enter(self.wo, numbers.entry),
                self.layered.enter(wi, numbers.exit),
            );
            if let (Some(o), Some(i)) = (entry, exit) {
                let rng = &mut numbers.rest.clone();
                let found = self.layered.connections(&i, &o, &dye, Some(shared / back), rng);
                sum += found * (o.share * o.masking * i.share * i.masking / back);
            }
        }
        sum * self.layered.exit_scale(wi)
    }
}

impl Slice for LayeredSlice<'_> {
    /// Light off the interface.
    fn sharp(&self, wi: Vec3) -> Vec3 {
        Vec3::splat(self.layered.reflection(self.wo, wi))
    }

    /// Light that entered the slab.
    fn smooth(&self, wi: Vec3) -> Vec3 {
        self.body(wi)
    }

    fn alpha(&self) -> [Real; 2] {
        [self.layered.alpha; 2]
    }

    fn rest(&self) -> Rest {
        Rest::Diffuse
    }
}
