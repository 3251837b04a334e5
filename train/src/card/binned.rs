//! A slice of the reference model in 64 × 64 bins: what samples are held against.
//!
//! The sharp lobe by quadrature, the smooth one by midpoints over two independent sets of walks, which also tell its
//! noise. A sharp lobe that is too narrow for midpoints of disk bins is integrated on the lattice of its own chart.

use super::bins::{Bins, NARROW_BINS, SIDE, bins_of_90_percent};
use crate::lobes::{LUMINANCE, direction_at};
use crate::spline::{edge_cell_centre, edge_cell_weight};
use crate::transport::measure;
use bake_runtime::Bsdf;
use bake_runtime::bsdf::{Rest, Slice};
use bake_runtime::chart::Chart;
use glam::DVec3;

/// Walks behind the smooth lobe in each of two independent halves: as many as its noise asks for, between these.
const WALKS: [usize; 2] = [1 << 11, 1 << 15];
/// How many more walks are tried where noise is too large.
const MORE: usize = 4;
/// Binning L1 that the noise of the reference may account for: with the discrepancy of four million R2 points, which is
/// about 0.002, a quarter of what maps are held to.
const NOISE_L1: f64 = 3e-3;
/// Midpoints per side of a bin for the sharp lobe and for the smooth one.
const SHARP_SUB: usize = 12;
const SMOOTH_SUB: usize = 2;
/// Nodes per side of the lattice for a smooth lobe in the square of a narrow one, where it is all at the edges: of a
/// stochastic model, whose every node costs microseconds, and of an exact one.
const SMOOTH_LATTICE: [usize; 2] = [192, 1024];
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
        let mut walks = WALKS[0];
        loop {
            let binned = BinnedSlice::with_walks(bsdf, wo, chart, walks);
            walks *= MORE;
            if binned.noise_l1 <= NOISE_L1 || walks > WALKS[1] {
                return binned;
            }
        }
    }

    fn with_walks(bsdf: &'a dyn Bsdf, wo: DVec3, chart: &Chart, walks: usize) -> BinnedSlice<'a> {
        let slices = SEEDS.map(|seed| bsdf.slice(wo, walks, seed));
        let stochastic = bsdf.is_stochastic();
        let sharp = |wi: DVec3| slices[0].sharp(wi).dot(LUMINANCE);
        let sum = |sharp: &[f64], halves: &[Vec<f64>; 2]| -> Vec<f64> {
            (0..SIDE * SIDE)
                .map(|k| sharp[k] + 0.5 * (halves[0][k] + halves[1][k]))
                .collect()
        };
        let disk = Bins::Disk;
        let mut on_disk = disk.integrate(SHARP_SUB, sharp);
        if bins_of_90_percent(&on_disk) < NARROW_BINS {
            on_disk = on_lattice(&disk, chart, LATTICE, sharp);
        }
        let sub = if stochastic { SMOOTH_SUB } else { SHARP_SUB };
        let mut halves = [0, 1].map(|h: usize| disk.integrate(sub, |wi| slices[h].smooth(wi).dot(LUMINANCE)));
        let (mut bins, mut mass) = (disk, sum(&on_disk, &halves));
        if bins_of_90_percent(&mass) < NARROW_BINS {
            bins = Bins::Square(*chart);
            let nodes = SMOOTH_LATTICE[usize::from(!stochastic)];
            halves = [0, 1].map(|h: usize| {
                let smooth = |wi| slices[h].smooth(wi).dot(LUMINANCE);
                match slices[h].rest() {
                    Rest::Diffuse => on_lattice(&bins, &Chart::IDENTITY, nodes, smooth),
                    Rest::Alike => bins.integrate(sub, smooth),
                }
            });
            mass = sum(&bins.integrate(SHARP_SUB, sharp), &halves);
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
        measure::binning_floor(&self.mass, points) + self.noise_l1
    }
}

/// Integral of a density over every bin, by `side`² nodes that crowd where `chart`'s lobe is.
fn on_lattice(bins: &Bins, chart: &Chart, side: usize, density: impl Fn(DVec3) -> f64) -> Vec<f64> {
    let mut mass = vec![0.0; SIDE * SIDE];
    let nodes = side * side;
    for k in 0..nodes {
        let (wi, area) = direction_at(chart, edge_cell_centre(k, side));
        mass[bins.index(wi)] += density(wi) * area * edge_cell_weight(k, side) / nodes as f64;
    }
    mass
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lobes::Lobe;
    use crate::lobes::LobeSlice;
    use bake_runtime::bsdf::direction;
    use bake_runtime::conductor::Conductor;

    /// A bin's edge cuts through lattice cells: half of them land on the wrong side at worst.
    const LATTICE_TOL: f64 = 4e-3;

    #[test]
    fn midpoints_and_lattice_agree() {
        let bsdf = Conductor::new([0.15, 0.1], [0.9; 3]).expect("valid parameters");
        let wo = direction(50.0, 20.0);
        let chart = LobeSlice::new(&bsdf, wo, 64, 0)
            .expect("bright")
            .chart(Lobe::Sharp);
        let density = |wi: DVec3| bsdf.single(wo, wi).x;
        let (a, b) = (
            Bins::Disk.integrate(SHARP_SUB, density),
            on_lattice(&Bins::Disk, &chart, LATTICE, density),
        );
        let (sum_a, sum_b) = (a.iter().sum::<f64>(), b.iter().sum::<f64>());
        let distance: f64 = a.iter().zip(&b).map(|(a, b)| (a / sum_a - b / sum_b).abs()).sum();
        assert!(distance < LATTICE_TOL, "{distance}");
        assert!((sum_a / sum_b - 1.0).abs() < LATTICE_TOL, "{sum_a} {sum_b}");
    }
}
