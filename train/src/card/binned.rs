//! A slice of the reference model in 64 × 64 bins: what samples are held against.
//!
//! The sharp lobe by quadrature, the smooth one by midpoints over two independent sets of walks, which also tell its
//! noise. A sharp lobe that is too narrow for midpoints of disk bins is integrated on the lattice of its own chart.

use super::bins::{Bins, NARROW_BINS, SIDE, bins_of_90_percent, l1};
use crate::lobes::{LUMINANCE, direction_at};
use crate::spline::{edge_cell_centre, edge_cell_weight};
use crate::transport::marginal::MarginalMap;
use bake_runtime::Bsdf;
use bake_runtime::bsdf::{Slice, shifted_r2};
use bake_runtime::chart::Chart;
use glam::DVec3;

/// Walks behind the smooth lobe, in two independent halves.
const WALKS: usize = 1 << 12;
/// Midpoints per side of a bin for the sharp lobe and for the smooth one.
const SHARP_SUB: usize = 12;
const SMOOTH_SUB: usize = 2;
/// Nodes per side of the lattice in the chart of a lobe too narrow for midpoints of disk bins.
const LATTICE: usize = 1024;
/// Seeds of the walks, apart from that of the training slices.
const SEEDS: [u64; 2] = [101, 102];

/// One slice in bins.
pub struct BinnedSlice<'a> {
    /// Where its bins lie.
    pub bins: Bins,
    /// Luminance energy in every bin.
    pub mass: Vec<f64>,
    /// Binning L1 that the noise of `mass` alone accounts for.
    pub noise_l1: f64,
    slices: [Box<dyn Slice + 'a>; 2],
}

impl<'a> BinnedSlice<'a> {
    /// Bins the slice of `bsdf` at `wo`; `chart` is fitted to its sharp lobe.
    pub fn new(bsdf: &'a dyn Bsdf, wo: DVec3, chart: &Chart) -> BinnedSlice<'a> {
        let slices = SEEDS.map(|seed| bsdf.slice(wo, WALKS / 2, seed));
        let luminance = |wi: DVec3| slices[0].sharp(wi).dot(LUMINANCE);
        let smooth = |bins: &Bins, sub: usize| {
            [0, 1].map(|h: usize| bins.integrate(sub, |wi| slices[h].smooth(wi).dot(LUMINANCE)))
        };
        let sum = |sharp: &[f64], halves: &[Vec<f64>; 2]| -> Vec<f64> {
            (0..SIDE * SIDE)
                .map(|k| sharp[k] + 0.5 * (halves[0][k] + halves[1][k]))
                .collect()
        };
        let mut bins = Bins::Disk;
        let mut sharp = bins.integrate(SHARP_SUB, luminance);
        if bins_of_90_percent(&sharp) < NARROW_BINS {
            sharp = on_lattice(&bins, chart, luminance);
        }
        let sub = match bsdf.is_stochastic() {
            true => SMOOTH_SUB,
            false => SHARP_SUB,
        };
        let mut halves = smooth(&bins, sub);
        let mut mass = sum(&sharp, &halves);
        if bins_of_90_percent(&mass) < NARROW_BINS {
            bins = Bins::Square(*chart);
            sharp = bins.integrate(SHARP_SUB, luminance);
            halves = smooth(&bins, sub);
            mass = sum(&sharp, &halves);
        }
        // Independent halves with errors ±e: their mean has an error of half their difference.
        let pairs = halves[0].iter().zip(&halves[1]);
        let difference: f64 = pairs.map(|(a, b)| 0.5 * (a - b).abs()).sum();
        BinnedSlice {
            bins,
            noise_l1: difference / mass.iter().sum::<f64>(),
            mass,
            slices,
        }
    }

    /// f_cos at `wi`, RGB, averaged over all walks.
    pub fn f_cos(&self, wi: DVec3) -> DVec3 {
        let [a, b] = self.slices.each_ref().map(|slice| slice.eval(wi));
        0.5 * (a + b)
    }

    /// What a perfect map would score in binning L1 with `points` R2 points: the discrepancy of the points,
    /// plus the noise of the truth.
    pub fn floor(&self, points: u64) -> f64 {
        let mut counts = vec![0u64; SIDE * SIDE];
        let invert = MarginalMap::new(&self.mass, SIDE);
        for i in 0..points {
            let p = invert.at(shifted_r2(i, [0.0; 2]));
            let cell = |v: f64| ((v * SIDE as f64) as usize).min(SIDE - 1);
            counts[cell(p[1]) * SIDE + cell(p[0])] += 1;
        }
        l1(&counts, &self.mass) + self.noise_l1
    }
}

/// Integral of a density over every bin, by nodes that crowd where `chart`'s lobe is.
fn on_lattice(bins: &Bins, chart: &Chart, density: impl Fn(DVec3) -> f64) -> Vec<f64> {
    let mut mass = vec![0.0; SIDE * SIDE];
    let nodes = LATTICE * LATTICE;
    for k in 0..nodes {
        let (wi, area) = direction_at(chart, edge_cell_centre(k, LATTICE));
        mass[bins.index(wi)] += density(wi) * area * edge_cell_weight(k, LATTICE) / nodes as f64;
    }
    mass
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lobes::LobeSlice;
    use crate::lobes::Lobe;
    use bake_runtime::bsdf::direction;
    use bake_runtime::conductor::Conductor;

    /// A bin's edge cuts through lattice cells: half of them land on the wrong side at worst.
    const LATTICE_TOL: f64 = 3e-3;

    #[test]
    fn midpoints_and_lattice_agree() {
        let bsdf = Conductor::new([0.15, 0.1], [0.9; 3]).expect("valid parameters");
        let wo = direction(50.0, 20.0);
        let chart = LobeSlice::new(&bsdf, wo, 64, 0).expect("bright").chart(Lobe::Sharp);
        let density = |wi: DVec3| bsdf.single(wo, wi).x;
        let (a, b) = (Bins::Disk.integrate(SHARP_SUB, density), on_lattice(&Bins::Disk, &chart, density));
        let (sum_a, sum_b) = (a.iter().sum::<f64>(), b.iter().sum::<f64>());
        let distance: f64 = a.iter().zip(&b).map(|(a, b)| (a / sum_a - b / sum_b).abs()).sum();
        assert!(distance < LATTICE_TOL, "{distance}");
        assert!((sum_a / sum_b - 1.0).abs() < LATTICE_TOL);
    }
}
