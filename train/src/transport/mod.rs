//! From a density to the map that carries uniform numbers onto it: the paper's route, the maps it is compared with, and
//! ours.

pub mod assignment;
pub mod cloud;
pub mod continuation;
#[cfg(test)]
mod densities;
pub mod disk_map;
pub mod dissection;
pub mod frame_fit;
pub mod frame_map;
pub mod hierarchical;
pub mod kantorovich;
pub mod map;
pub mod marginal;
pub mod measure;
pub mod monge_ampere;
mod paths;
pub mod permutation;
pub mod plane;
pub mod points;
pub mod potential;
pub mod raster;
pub mod sinkhorn;
pub mod sinkhorn_sliced;
pub mod sliced;
pub mod smoothing;
pub mod softmin;
pub mod square_map;

use std::fmt;

/// How an importance map is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Solver {
    /// Inversion of the marginal of one coordinate, then of the conditional of the other, on the disk.
    Marginal,
    /// Hierarchical sample warping (Clarberg et al. 2005), on the disk.
    Hierarchical,
    /// The paper's route: row-column points, annealed Sinkhorn, sliced transport, permutation.
    SinkhornSliced,
    /// Exact assignment of the same points: the oracle, for few of them.
    Exact,
    /// Ours: lobe frames, one or two charts, the Monge–Ampère equation in their squares.
    Frame,
}

impl Solver {
    /// All of them, in the order of reports.
    pub const ALL: [Solver; 5] = [
        Solver::Marginal,
        Solver::Hierarchical,
        Solver::SinkhornSliced,
        Solver::Exact,
        Solver::Frame,
    ];

    /// Its name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Solver::Marginal => "marginal",
            Solver::Hierarchical => "hierarchical",
            Solver::SinkhornSliced => "sinkhorn_sliced",
            Solver::Exact => "exact",
            Solver::Frame => "frame",
        }
    }

    /// The solver of that name.
    pub fn find(name: &str) -> Option<Solver> {
        Solver::ALL.into_iter().find(|s| s.name() == name)
    }
}

impl fmt::Display for Solver {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.name())
    }
}
