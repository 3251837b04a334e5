//! A baked material of any preset as one of the samplers that are compared.

use super::{Drawn, SliceSampler};
use crate::card::batch::{BATCH, Buffers};
use crate::card::heldout::HeldOut;
use crate::error::Result;
use bake_runtime::Backend;

/// A baked material at one place.
pub struct BakedSlice {
    backend: Box<dyn Backend>,
    buffers: Buffers,
}

impl BakedSlice {
    /// The slice at `place` of the material that `backend` runs.
    pub fn new(backend: Box<dyn Backend>, place: &HeldOut) -> BakedSlice {
        BakedSlice {
            backend,
            buffers: Buffers::new(place),
        }
    }
}

impl SliceSampler for BakedSlice {
    /// Weights are those of the estimator `exact`; `u` is rounded to f32.
    fn draw(&mut self, u: &[[f64; 2]], drawn: &mut [Option<Drawn>]) -> Result<()> {
        for (u, drawn) in u.chunks(BATCH).zip(drawn.chunks_mut(BATCH)) {
            for (i, u) in u.iter().enumerate() {
                self.buffers.set_u(i, *u);
            }
            self.buffers.sample_jacobian(self.backend.as_mut())?;
            for (i, drawn) in drawn.iter_mut().enumerate() {
                *drawn = Some(Drawn {
                    wi: self.buffers.wi(i).normalize(),
                    jacobian: self.buffers.scalar[i].into(),
                });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::card::fake::vase;
    use crate::card::heldout;
    use crate::card::truth::Truth;
    use crate::comparators::measure::measure;
    use crate::presets::Preset;
    use crate::training::mlp::Mlp;
    use bake_runtime::bsdf::shifted_r2;
    use bake_runtime::native::{NativeBackend, Tier};
    use bake_runtime::{BakedMaterial, Material, Network, Rng, Role, oracle};

    /// f32 layers against f64 ones: of a direction, and relative of an area on the disk, in which heights next to the
    /// horizon, which f32 knows badly, cancel.
    const WI_TOL: f64 = 1e-4;
    const AREA_TOL: f64 = 1e-3;
    /// Standard errors allowed: three comparisons exceed it by chance once in 50 000 runs.
    const SIGMAS: f64 = 4.5;

    /// Networks that nobody trained.
    fn untrained(preset: Preset, material: &Material) -> BakedMaterial {
        let network = |role: Role| {
            let spec = preset.spec(role, material).expect("a conductor");
            let mut rng = Rng::new(&[0xba, role as u64]);
            Network {
                frame: Mlp::random(&spec.frame_layers(), &mut rng).to_dense(),
                net: Mlp::random(&spec.layers(), &mut rng).to_dense(),
                spec,
            }
        };
        BakedMaterial {
            sample: network(Role::Sample),
            eval: network(Role::Eval),
            pdf: network(Role::Pdf),
        }
    }

    fn slice(baked: &BakedMaterial, place: &HeldOut) -> BakedSlice {
        let backend = NativeBackend::new(baked, Tier::best()).expect("sound networks");
        BakedSlice::new(Box::new(backend), place)
    }

    fn place(material: &Material) -> HeldOut {
        heldout::places(material).expect("nothing is free")["theta_0_75"][20].clone()
    }

    /// The oracle: the same networks in f64, one query at a time. More queries than one batch, and not a multiple.
    #[test]
    fn draws_what_the_oracle_draws_whatever_the_preset() {
        let material = vase();
        let place = place(&material);
        for preset in Preset::ALL {
            let baked = untrained(preset, &material);
            let u: Vec<[f64; 2]> = (0..BATCH as u64 + 77)
                .map(|i| shifted_r2(i, [0.0; 2]).map(|v| f64::from(v as f32)))
                .collect();
            let mut drawn = vec![None; u.len()];
            slice(&baked, &place)
                .draw(&u, &mut drawn)
                .expect("matching lengths");
            let wo = place.wo.to_array();
            for k in (0..u.len()).step_by(41) {
                let expected = oracle::sample(&baked.sample, &[], wo, u[k]);
                let jacobian = oracle::jacobian(&expected, &baked.pdf, &[], wo);
                let Drawn { wi, jacobian: found } = drawn[k].expect("nothing is lost");
                let apart = (wi - glam::DVec3::from_array(expected.wi)).length();
                assert!(apart < WI_TOL, "{preset} {k}: {wi} {:?}", expected.wi);
                // The derivatives of the paper's highest frequencies, 2¹¹π, are beyond f32 in networks that nobody trained.
                let (found, area) = (found * wi.z, jacobian * expected.wi[2]);
                assert!(
                    preset == Preset::Paper || (found - area).abs() < AREA_TOL * area.abs().max(1.0),
                    "{preset} {k}: {found} {area}"
                );
            }
        }
    }

    /// The warp preset covers the hemisphere once, so its weights are unbiased with any weights of its networks.
    #[test]
    fn an_untrained_warp_is_a_poor_but_unbiased_sampler() {
        let material = vase();
        let place = place(&material);
        let baked = untrained(Preset::Warp, &material);
        let mut slice = slice(&baked, &place);
        let reference = material.bind(&[]).expect("valid parameters");
        let truth = Truth::new(&reference, place.wo).expect("a bright slice");
        let found = measure(&mut slice, &reference, &truth, 0).expect("it runs");
        let sigma = found.albedo_bias.mean / found.albedo_bias.se;
        assert!(sigma.abs().max_element() < SIGMAS, "{found:?}");
        assert!(found.binning_l1 > 10.0 * found.binning_floor, "{found:?}");
    }
}
