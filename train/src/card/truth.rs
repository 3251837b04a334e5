//! The truth that a baked material is measured against: always the reference model itself, by quadrature of
//! its analytic part and by walks for the rest, never a solved map or a rastered slice.

use super::binned::BinnedSlice;
use crate::error::Result;
use crate::lobes::{Lobe, LobeSlice};
use crate::spline::{edge_cell_centre, edge_cell_weight};
use bake_runtime::Rng;
use bake_runtime::bsdf::shifted_r2;
use bake_runtime::chart::Chart;
use bake_runtime::conductor::Conductor;
use glam::DVec3;

/// Walks behind the albedo.
const ALBEDO_WALKS: u64 = 1 << 17;
/// Walks of a slice that only its chart, which single scattering decides, is wanted of.
const FRAME_WALKS: usize = 1;
/// Quadrature nodes per side for the albedo of single scattering.
const ALBEDO_NODES: usize = 256;
const ALBEDO_KEY: u64 = 103;

/// What is known about one slice.
pub struct Truth<'a> {
    /// Camera direction.
    pub wo: DVec3,
    /// Frame fitted to the reference's single scattering.
    pub chart: Chart,
    /// Directional albedo, RGB.
    pub albedo: DVec3,
    /// Its standard error.
    pub albedo_se: DVec3,
    /// The slice in bins.
    pub binned: BinnedSlice<'a>,
}

impl<'a> Truth<'a> {
    /// Measures the slice of `bsdf` at `wo`.
    ///
    /// # Errors
    /// As [`LobeSlice::new`].
    pub fn new(bsdf: &'a Conductor, wo: DVec3) -> Result<Truth<'a>> {
        let chart = LobeSlice::new(bsdf, wo, FRAME_WALKS, 0)?.chart(Lobe::Sharp);
        let (albedo, albedo_se) = albedo(bsdf, wo, &chart);
        Ok(Truth {
            wo,
            chart,
            albedo,
            albedo_se,
            binned: BinnedSlice::new(bsdf, wo, &chart),
        })
    }
}

/// Directional albedo with its standard error.
///
/// Single scattering by quadrature in the chart's square. A white surface loses nothing, so the light that
/// scatters more than once is exactly 1 − (single scattering of the white surface); walks only tell which
/// share of it the reflectance keeps.
fn albedo(bsdf: &Conductor, wo: DVec3, chart: &Chart) -> (DVec3, DVec3) {
    let white = bsdf.white();
    let (mut single, mut single_white) = (DVec3::ZERO, 0.0);
    for k in 0..ALBEDO_NODES * ALBEDO_NODES {
        // Crowded towards the horizon, where a rough surface is bright in a layer too thin for even nodes.
        let s = edge_cell_centre(k, ALBEDO_NODES);
        let (w, area) = chart.square_to_direction(s);
        let wi = DVec3::from_array(w);
        let measure = area * edge_cell_weight(k, ALBEDO_NODES);
        single += bsdf.single(wo, wi) * measure;
        single_white += white.single(wo, wi).x * measure;
    }
    let nodes = (ALBEDO_NODES * ALBEDO_NODES) as f64;
    let scattered_white = (1.0 - single_white / nodes).max(0.0);
    let (mut count, mut sum, mut square) = (0.0, DVec3::ZERO, DVec3::ZERO);
    for i in 0..ALBEDO_WALKS {
        let mut rng = Rng::new(&[ALBEDO_KEY, i]);
        let mut orders = 1;
        let u = shifted_r2(i, [0.0; 2]);
        let sample = bsdf.walk(wo, u, &mut rng, |_| orders += 1);
        if orders > 1 {
            let weight = sample.map_or(DVec3::ZERO, |s| s.weight);
            count += 1.0;
            sum += weight;
            square += weight * weight;
        }
    }
    if count < 2.0 {
        return (single / nodes, DVec3::splat(scattered_white));
    }
    let kept = sum / count;
    let variance = (square / count - kept * kept).max(DVec3::ZERO) / (count - 1.0);
    let se = DVec3::new(variance.x.sqrt(), variance.y.sqrt(), variance.z.sqrt()) * scattered_white;
    (single / nodes + kept * scattered_white, se)
}
