//! The truth that a baked material is measured against: always the reference model itself, by quadrature of
//! its analytic part and by walks for the rest, never a solved map or a rastered slice.

use super::bins::{Bins, NARROW_BINS, SIDE, bins_of_90_percent};
use crate::slice::{LUMINANCE, single_luminance};
use crate::spline::{edge_cell_centre, edge_cell_weight};
use crate::transport::frame_fit;
use crate::transport::marginal::MarginalMap;
use bake_runtime::Rng;
use bake_runtime::bsdf::{Slice, shifted_r2};
use bake_runtime::conductor::{Conductor, ConductorSlice};
use bake_runtime::frame::{Frame, mirror_anchor};
use glam::DVec3;

/// Walks behind the multiple-scattering density; two independent halves of this give its own error.
const WALKS: usize = 1 << 12;
/// Walks behind the albedo.
const ALBEDO_WALKS: u64 = 1 << 17;
/// Quadrature nodes per side for the albedo of single scattering.
const ALBEDO_NODES: usize = 256;
/// Midpoints per side of a bin for the analytic part and for the smoother rest.
const SINGLE_SUB: usize = 12;
const SCATTER_SUB: usize = 2;
/// Seeds of the walks, apart from that of the training slices.
const SLICE_SEEDS: [u64; 2] = [101, 102];
const ALBEDO_KEY: u64 = 103;

/// What is known about one slice.
pub struct Truth<'a> {
    /// Camera direction.
    pub wo: DVec3,
    /// Frame fitted to the reference's single scattering.
    pub frame: Frame,
    /// Directional albedo, RGB.
    pub albedo: DVec3,
    /// Its standard error.
    pub albedo_se: DVec3,
    /// Where its bins lie.
    pub bins: Bins,
    /// Luminance energy in every bin.
    pub mass: Vec<f64>,
    /// Binning L1 that the noise of `mass` alone accounts for.
    pub mass_noise_l1: f64,
    slices: [ConductorSlice<'a>; 2],
}

impl<'a> Truth<'a> {
    /// Measures the slice of `bsdf` at `wo`.
    pub fn new(bsdf: &'a Conductor, wo: DVec3) -> Truth<'a> {
        let anchor = mirror_anchor(wo.to_array(), bsdf.alpha);
        let start = Frame::from_outputs([bsdf.alpha[0].ln(), bsdf.alpha[1].ln(), 0.0, 0.0, 0.0], anchor);
        let frame = frame_fit::fit(|wi| single_luminance(bsdf, wo, wi), start);
        let (albedo, albedo_se) = albedo(bsdf, wo, &frame);
        let slices = SLICE_SEEDS.map(|seed| ConductorSlice::new(bsdf, wo, WALKS / 2, seed));
        let single = |bins: &Bins| bins.integrate(SINGLE_SUB, |wi| bsdf.single(wo, wi).dot(LUMINANCE));
        let mut bins = Bins::Disk;
        let mut mass = single(&bins);
        if bins_of_90_percent(&mass) < NARROW_BINS {
            bins = Bins::Square(frame);
            mass = single(&bins);
        }
        let halves =
            [0, 1].map(|h: usize| bins.integrate(SCATTER_SUB, |wi| slices[h].multiple(wi).dot(LUMINANCE)));
        for (m, (a, b)) in mass.iter_mut().zip(halves[0].iter().zip(&halves[1])) {
            *m += 0.5 * (a + b);
        }
        // Independent halves with errors ±e: their mean has an error of half their difference.
        let difference: f64 = halves[0]
            .iter()
            .zip(&halves[1])
            .map(|(a, b)| 0.5 * (a - b).abs())
            .sum();
        let mass_noise_l1 = difference / mass.iter().sum::<f64>();
        Truth {
            wo,
            frame,
            albedo,
            albedo_se,
            bins,
            mass,
            mass_noise_l1,
            slices,
        }
    }

    /// f_cos at `wi`, RGB, with multiple scattering averaged over all walks.
    pub fn f_cos(&self, wi: DVec3) -> DVec3 {
        let [a, b] = self.slices.each_ref().map(|slice| slice.eval(wi));
        0.5 * (a + b)
    }

    /// What a perfect map would score in binning L1 with `points` R2 points: the discrepancy of the points,
    /// plus the noise of the truth.
    pub fn binning_floor(&self, points: u64) -> f64 {
        let mut counts = vec![0u64; SIDE * SIDE];
        let invert = MarginalMap::new(&self.mass, SIDE);
        for i in 0..points {
            let p = invert.at(shifted_r2(i, [0.0; 2]));
            let cell = |v: f64| ((v * SIDE as f64) as usize).min(SIDE - 1);
            counts[cell(p[1]) * SIDE + cell(p[0])] += 1;
        }
        super::bins::l1(&counts, &self.mass) + self.mass_noise_l1
    }
}

/// Directional albedo with its standard error.
///
/// Single scattering by quadrature in the frame's square. A white surface loses nothing, so the light that
/// scatters more than once is exactly 1 − (single scattering of the white surface); walks only tell which
/// share of it the reflectance keeps.
fn albedo(bsdf: &Conductor, wo: DVec3, frame: &Frame) -> (DVec3, DVec3) {
    let white = bsdf.white();
    let (mut single, mut single_white) = (DVec3::ZERO, 0.0);
    for k in 0..ALBEDO_NODES * ALBEDO_NODES {
        // Crowded towards the horizon, where a rough surface is bright in a layer too thin for even nodes.
        let s = edge_cell_centre(k, ALBEDO_NODES);
        let (w, jacobian_cos) = frame.square_to_direction(s, [1.0 - s[0], 1.0 - s[1]]);
        let wi = DVec3::from_array(w);
        let measure = jacobian_cos / w[2] * edge_cell_weight(k, ALBEDO_NODES);
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
