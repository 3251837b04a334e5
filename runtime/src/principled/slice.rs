//! The two lobes of a slice: what is mirrored sharply, and the base with whatever is as broad.

use super::Principled;
use crate::bsdf::{Rest, Slice, usable};
use crate::real::{Real, Vec3};

/// A main specular lobe at least this rough along both axes is no sharper than the base when a clearcoat is.
const BROAD: Real = 0.25;

/// One slice: see [`Slice`].
pub(super) struct PrincipledSlice<'a> {
    bsdf: &'a Principled,
    wo: Vec3,
    /// Whether the main specular lobe belongs to the sharp lobe.
    specular_is_sharp: bool,
}

impl<'a> PrincipledSlice<'a> {
    /// The slice of `bsdf` at `wo`.
    pub fn new(bsdf: &'a Principled, wo: Vec3) -> PrincipledSlice<'a> {
        let broad = bsdf.alpha.iter().all(|a| *a >= BROAD);
        PrincipledSlice {
            bsdf,
            wo,
            specular_is_sharp: bsdf.parameters.clearcoat == 0.0 || !broad,
        }
    }

    fn lobes(&self, wi: Vec3) -> [Vec3; 3] {
        match usable(self.wo) && usable(wi) {
            true => self.bsdf.lobes(self.wo, wi),
            false => [Vec3::ZERO; 3],
        }
    }
}

impl Slice for PrincipledSlice<'_> {
    /// The clearcoat, and the main specular lobe unless the clearcoat alone is sharp.
    fn sharp(&self, wi: Vec3) -> Vec3 {
        let [specular, coat, _] = self.lobes(wi);
        match self.specular_is_sharp {
            true => specular + coat,
            false => coat,
        }
    }

    /// The base, and the main specular lobe where it is as broad and a clearcoat is not.
    fn smooth(&self, wi: Vec3) -> Vec3 {
        let [specular, _, base] = self.lobes(wi);
        match self.specular_is_sharp {
            true => base,
            false => specular + base,
        }
    }

    fn alpha(&self) -> [Real; 2] {
        match self.specular_is_sharp {
            true => self.bsdf.alpha,
            false => [self.bsdf.gtr1.alpha(); 2],
        }
    }

    fn rest(&self) -> Rest {
        Rest::Diffuse
    }
}
