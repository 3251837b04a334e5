//! Samplers of BSDF slices side by side on the same slices: baked materials, a normalising flow as Xie et al. 2019 use it,
//! and the analytic lobe of Sztrajman et al. 2021.
//!
//! All of them give a factor that makes f_cos of the reference model a weight. Flow and lobe know their density exactly, so
//! these weights are unbiased; what samplers are compared by is where their samples fall, the variance of the weights, and
//! what they cost.

pub mod baked;
pub mod blinn_phong;
pub mod figure;
pub mod measure;
pub mod realnvp;
pub mod standings;

use crate::error::Result;
use glam::DVec3;

/// One direction drawn by a [`SliceSampler`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawn {
    /// Unit vector to the light, z > 0.
    pub wi: DVec3,
    /// What f_cos at `wi` is multiplied by for the weight, sr: 1 / density where the sampler knows that, else the signed
    /// `jacobian` of [`bake_runtime::Backend::sample_jacobian`].
    pub jacobian: f64,
}

/// A sampler of one slice: parameters and `wo` are bound.
pub trait SliceSampler {
    /// Draws a direction for each of `u`, in `[0,1)²`, into the same place of `drawn`, which is as long; `None` where the
    /// sampler sends `u` below the horizon, which counts as a weight of zero.
    ///
    /// # Errors
    /// What runs the sampler may fail.
    fn draw(&mut self, u: &[[f64; 2]], drawn: &mut [Option<Drawn>]) -> Result<()>;
}

/// A sampler of one slice that knows how densely it draws.
pub trait KnownDensity {
    /// Direction for `u` in `[0,1)²`, unit, above the horizon, with its [`KnownDensity::pdf`]; `None` as in
    /// [`SliceSampler::draw`].
    fn sample(&self, u: [f64; 2]) -> Option<(DVec3, f64)>;

    /// Density of what [`KnownDensity::sample`] returns at the unit vector `wi`, sr⁻¹: zero below the horizon; its integral
    /// over the hemisphere is the share of `u` that gives a direction.
    fn pdf(&self, wi: DVec3) -> f64;
}

impl<T: KnownDensity> SliceSampler for T {
    fn draw(&mut self, u: &[[f64; 2]], drawn: &mut [Option<Drawn>]) -> Result<()> {
        for (u, drawn) in u.iter().zip(drawn) {
            *drawn = self.sample(*u).map(|(wi, pdf)| Drawn {
                wi,
                jacobian: 1.0 / pdf,
            });
        }
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::realnvp::plane;
    use super::*;
    use crate::card::bins::{SIDE, l1};
    use crate::spline::cell_centre;
    use crate::transport::measure::{BINNING_POINTS, count};
    use bake_runtime::bsdf::shifted_r2;
    use glam::DVec2;

    /// Networks run in f32: a coordinate that comes back off by a bit of f64 may round to the next one.
    const PDF_TOL: f64 = 1e-5;
    /// Samples whose densities are compared and that tell what is lost.
    const SAMPLES: u64 = 1 << 18;
    /// Half the side of the part of the plane that is integrated over: its edge is 1e-11 above the horizon.
    const REACH: f64 = 10.0;
    /// Nodes per side of the quadrature, a multiple of the bins.
    const NODES: usize = 16 * SIDE;
    /// Error of the quadrature, and of the share of 2¹⁸ points that is lost.
    const INTEGRAL_TOL: f64 = 1e-3;
    /// Binning L1 of an exact sampler: the discrepancy of 2²⁰ points over some hundred bins.
    const BINNING_TOL: f64 = 1e-2;

    /// Holds a sampler to the contract of [`KnownDensity`]; the quadrature is over the plane of [`plane`], where densities
    /// are smooth at the horizon.
    pub fn assert_samples_follow_pdf(sampler: &(impl KnownDensity + Sync)) {
        let mut lost = 0;
        for i in 0..SAMPLES {
            match sampler.sample(shifted_r2(i, [0.0; 2])) {
                None => lost += 1,
                Some((wi, pdf)) => {
                    assert!(wi.is_normalized() && wi.z > 0.0, "{wi}");
                    assert!((pdf / sampler.pdf(wi) - 1.0).abs() < PDF_TOL, "{pdf} at {wi}");
                }
            }
        }
        let kept = 1.0 - f64::from(lost) / SAMPLES as f64;
        let mut mass = vec![0.0; SIDE * SIDE];
        let area = (2.0 * REACH / NODES as f64).powi(2);
        for k in 0..NODES * NODES {
            let x = DVec2::from_array(cell_centre(k, NODES).map(|s| REACH * (2.0 * s - 1.0)));
            let wi = plane::to_direction(x).expect("not at the horizon");
            let bin = k / NODES / (NODES / SIDE) * SIDE + k % NODES / (NODES / SIDE);
            mass[bin] += sampler.pdf(wi) * (-plane::log_area(x)).exp() * area;
        }
        let integral: f64 = mass.iter().sum();
        assert!((integral - kept).abs() < INTEGRAL_TOL, "{integral} of {kept}");
        // What is lost is counted in the first bin, a corner at the horizon, which the comparison leaves out.
        let counts = count(BINNING_POINTS, |u| {
            sampler.sample(u).map_or(0, |(wi, _)| {
                let s = plane::from_direction(wi)
                    .to_array()
                    .map(|x| 0.5 * (x / REACH + 1.0));
                let [a, b] = s.map(|s| ((s * SIDE as f64) as usize).min(SIDE - 1));
                b * SIDE + a
            })
        });
        let found = l1(&counts[1..], &mass[1..]);
        assert!(found < BINNING_TOL, "{found}");
        assert_eq!(sampler.pdf(-DVec3::Z), 0.0);
    }
}
