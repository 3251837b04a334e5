//! The truth that a baked material is measured against: always the reference model itself, by quadrature of
//! its analytic part and by walks for the rest, never a solved map or a rastered slice.

use super::albedo;
use super::binned::BinnedSlice;
use super::quadrature::{both, integral};
use crate::error::Result;
use crate::lobes::{Lobe, LobeSlice, WALKS};
use bake_runtime::bsdf::Rest;
use bake_runtime::chart::Chart;
use bake_runtime::{Bsdf, Estimate, Reference};
use glam::DVec3;

/// Seed of the walks behind the slice without noise, apart from that of the training slices.
const LOBES_SEED: u64 = 105;

/// What is known about one slice.
pub struct Truth<'a> {
    /// Camera direction.
    pub wo: DVec3,
    /// The chart fitted to the reference's sharp lobe; the even one where that is black.
    pub chart: Chart,
    /// Directional albedo, RGB.
    pub albedo: Estimate,
    /// The slice without noise, by which a map is judged alone: of a stochastic model one that is close to it, and differs
    /// by what interpolation and a few thousand walks leave.
    pub lobes: LobeSlice<'a>,
    /// Albedo of `lobes`, exact but for its quadrature.
    pub lobes_albedo: Estimate,
    /// The slice in bins.
    pub binned: BinnedSlice<'a>,
}

impl<'a> Truth<'a> {
    /// Measures the slice of `reference` at `wo`.
    ///
    /// # Errors
    /// As [`LobeSlice::new`].
    pub fn new(reference: &'a Reference, wo: DVec3) -> Result<Truth<'a>> {
        let lobes = LobeSlice::new(reference, wo, WALKS, LOBES_SEED)?;
        let chart = lobes.sharp_chart().unwrap_or(Chart::IDENTITY);
        let home = match reference.slice(wo, 0, 0).rest() {
            Rest::Alike => chart,
            Rest::Diffuse => Chart::IDENTITY,
        };
        let sharp = integral(&chart, |wi| lobes.f_cos(Lobe::Sharp, wi));
        let smooth = integral(&home, |wi| lobes.f_cos(Lobe::Smooth, wi));
        let lobes_albedo = both(sharp, smooth);
        let albedo = match reference {
            Reference::Conductor(conductor) => both(sharp, albedo::scattered(conductor, wo, &chart)),
            other if other.is_stochastic() => both(sharp, albedo::rest(other, wo, &home, sharp.mean)),
            _ => lobes_albedo,
        };
        Ok(Truth {
            wo,
            chart,
            albedo,
            lobes,
            lobes_albedo,
            binned: BinnedSlice::new(reference, wo, &chart),
        })
    }

    /// f_cos without noise, RGB, sr⁻¹.
    pub fn f_cos(&self, wi: DVec3) -> DVec3 {
        self.lobes.f_cos(Lobe::Whole, wi)
    }
}
