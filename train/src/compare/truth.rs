//! Where the samples of compared maps are counted, and what belongs there.

use crate::card::binned::BinnedSlice;
use crate::card::bins::Bins;
use crate::transport::measure::{self, Domain};
use crate::transport::raster::Raster;
use bake_runtime::Reference;
use bake_runtime::chart::Chart;
use glam::DVec3;

/// R2 points behind a binning L1: their own discrepancy is then about 0.002.
pub(super) const BINNING_POINTS: u64 = 1 << 22;

/// Where samples are counted, and what belongs there.
pub(super) struct Truth {
    /// Where samples are counted.
    pub bins: Bins,
    /// Shares that belong into the bins.
    pub reference: Vec<f64>,
    /// Binning L1 of a perfect map.
    pub floor: f64,
    /// Where positions may lie.
    pub domain: Domain,
}

impl Truth {
    /// Of a slice whose sharp lobe has this chart.
    pub fn of_slice(bsdf: &Reference, wo: DVec3, chart: &Chart) -> Truth {
        let binned = BinnedSlice::new(bsdf, wo, chart);
        let total: f64 = binned.mass.iter().sum();
        Truth {
            bins: binned.bins,
            floor: binned.floor(BINNING_POINTS),
            reference: binned.mass.iter().map(|m| m / total).collect(),
            domain: Domain::Disk,
        }
    }

    /// Of a picture.
    pub fn of_picture(raster: &Raster) -> Truth {
        let reference = measure::reference_bins(raster);
        Truth {
            bins: Bins::Disk,
            floor: measure::binning_floor(&reference, BINNING_POINTS),
            reference,
            domain: Domain::Square,
        }
    }

    /// Bin of a position; on a slice, what lies outside the disk counts at the rim.
    pub fn index(&self, [x, y]: [f64; 2]) -> usize {
        match self.domain {
            Domain::Square => Bins::Disk.index(DVec3::new(x.clamp(-1.0, 1.0), y.clamp(-1.0, 1.0), 1.0)),
            Domain::Disk => {
                let r = x.hypot(y).max(1.0);
                let (x, y) = (x / r, y / r);
                let z = (1.0 - x * x - y * y).max(f64::MIN_POSITIVE).sqrt();
                self.bins.index(DVec3::new(x, y, z))
            }
        }
    }
}
