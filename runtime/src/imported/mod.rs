//! Reference family `imported`: BSDF slices from a file, so that any renderer's or measured BSDF can be baked.
//!
//! # The file
//!
//! safetensors with three F32 tensors and a version in its `__metadata__`. One row is one slice: the BSDF over all
//! `wi` for one set of parameters and one `wo`.
//!
//! | tensor | shape | content |
//! |---|---|---|
//! | `params` | `[N, P]` | parameters of row n, any finite numbers; P may be 0 |
//! | `wo` | `[N, 2]` | θ in [0, 90) and φ of the direction to the camera, degrees |
//! | `f_cos` | `[N, H, W, 3]` | f·cos θ_i, linear RGB, sr⁻¹, in [0, [`F_COS_MAX`]] |
//!
//! | `__metadata__` | |
//! |---|---|
//! | `bake.import` | format version, `"1"` |
//! | `param_names` | JSON list of P distinct names; `["p0", "p1", …]` when absent |
//! | `description` | any text; optional |
//!
//! Pixel (row i, column j) of a slice is the cell with centre x = −1 + (2j+1)/W, y = −1 + (2i+1)/H of the
//! orthographic disk, where x and y are those of `wi`. Cells whose centre is not inside the unit circle are ignored;
//! write 0. Write the value at the centre, or the mean of f over the part of the cell inside the circle times the
//! centre's cos θ_i.
//!
//! The rows form a full grid, in any order: (distinct values of each parameter) × (distinct θ) × (distinct φ).
//! With one φ alone the BSDF is isotropic, and slices are turned to the azimuth of `wo`. With several, they must go
//! round the circle, with no gap above 120 degrees (φ is periodic; the last and the first are neighbours).
//!
//! # In between
//!
//! What is interpolated is f = f_cos / cos θ_i, which is bounded and smooth at the horizon: multilinearly in the
//! parameters, θ_o and φ_o, and bilinearly on the disk. Cells outside the circle take f from their nearest neighbour
//! inside, so that the horizon has no dark seam. θ_o outside the tabulated range takes the nearest slice; parameters
//! outside it are an error.
//!
//! # Limits
//!
//! Between two tabulated θ_o or φ_o a lobe does not move from one place to the other: one fades out and one fades
//! in. Tabulate so densely that neighbouring lobes overlap, and densest towards the horizon, where lobes change
//! most; include θ = 0. A lobe narrower than two pixels is as wide as two pixels, and at grazing angles lobes are
//! narrow on the disk.
//!
//! What that costs: a rough copper of alpha 0.2, tabulated every two degrees and every degree above 80, differs
//! from the BSDF it was tabulated from by 0.4 % for θ_o in 30–60°, 1.2 % in 60–75°, 7 % in 75–85° and 10 % in
//! 85–89° with 64² pixels, and by 0.1 %, 0.3 %, 1.3 % and 1.9 % with 256² (mean absolute over mean value, at `wi`
//! sampled from the BSDF).

mod cells;
mod disk;
mod file;
mod grid;
mod shelf;
mod table;

pub use file::{F_COS_MAX, FORMAT, FORMAT_KEY};
pub use table::ImportedTable;

use crate::bsdf::{Bsdf, BsdfSample, DirectSlice, Slice, usable};
use crate::concentric::{DISK_AREA, disk_to_square, square_to_hemisphere};
use crate::random::Rng;
use crate::real::{Real, Vec3};
use cells::{CellTable, Mixture};
use std::fmt;
use std::sync::{Arc, OnceLock};

/// Most cells per side of a sampling table: 2¹⁶ cells, a quarter of a megabyte per slice.
const SIDE_MAX: usize = 256;

/// An imported BSDF with its parameters bound; made by [`ImportedTable::bind`].
///
/// Slices are blended, and their sampling tables built, when a direction first needs them. Clones share them.
#[derive(Clone)]
pub struct Imported {
    table: Arc<ImportedTable>,
    /// Grid positions of the parameters around the bound ones, and their weights.
    corners: Vec<(usize, Real)>,
    /// One per tabulated `wo`.
    slices: Arc<[BoundSlice]>,
}

/// What is derived from the table for one tabulated `wo`.
#[derive(Default)]
struct BoundSlice {
    /// f, RGB, sr⁻¹, cell by cell.
    f: OnceLock<Vec<f32>>,
    cells: OnceLock<CellTable>,
}

/// How one `wo` sees the table.
struct View {
    /// Tabulated `wo` and their weights, which sum to 1; those unused have weight 0 and repeat the first.
    parts: [(usize, Real); 4],
    /// Cosine and sine of the turn that carries the slices to the azimuth of `wo`.
    turn: [Real; 2],
}

impl View {
    /// x and y of `wi` in the frame of the slices.
    #[inline]
    fn to_slice(&self, wi: Vec3) -> [Real; 2] {
        let [cos, sin] = self.turn;
        [cos * wi.x + sin * wi.y, cos * wi.y - sin * wi.x]
    }

    /// The direction whose x, y and z in the frame of the slices are these.
    #[inline]
    fn to_shading(&self, [x, y, z]: [Real; 3]) -> Vec3 {
        let [cos, sin] = self.turn;
        Vec3::new(cos * x - sin * y, cos * y + sin * x, z)
    }
}

impl Imported {
    /// `corners` are positions and weights on the grid of parameters.
    fn new(table: Arc<ImportedTable>, corners: Vec<(usize, Real)>) -> Imported {
        let slices = (0..table.views()).map(|_| BoundSlice::default()).collect();
        Imported {
            table,
            corners,
            slices,
        }
    }

    /// The table that it is bound to.
    pub fn table(&self) -> &Arc<ImportedTable> {
        &self.table
    }

    /// Which slices a usable `wo` takes part in.
    #[inline]
    fn view(&self, wo: Vec3) -> View {
        let (theta, phi) = (self.table.theta_axis(), self.table.phi_axis());
        let from_pole = wo.x.hypot(wo.y);
        let at_theta = theta.bracket(from_pole.atan2(wo.z).to_degrees());
        // The pole has no azimuth; any will do.
        let [cos, sin] = match from_pole > 0.0 {
            true => [wo.x / from_pole, wo.y / from_pole],
            false => [1.0, 0.0],
        };
        let (at_phi, turn) = match phi.values[..] {
            [only] => {
                let (s, c) = Real::from(only).to_radians().sin_cos();
                (phi.bracket(0.0), [cos * c + sin * s, sin * c - cos * s])
            }
            _ => (phi.bracket_on_circle(sin.atan2(cos).to_degrees()), [1.0, 0.0]),
        };
        let mut found = at_theta.parts().flat_map(|(t, weight)| {
            at_phi
                .parts()
                .map(move |(p, share)| (t * phi.len() + p, weight * share))
        });
        // Weights sum to 1, so there is a first.
        let first = found.next().unwrap_or_default();
        let mut parts = [first, (first.0, 0.0), (first.0, 0.0), (first.0, 0.0)];
        for (part, more) in parts[1..].iter_mut().zip(found) {
            *part = more;
        }
        View { parts, turn }
    }

    /// f, cell by cell, of the tabulated `wo` with this index.
    fn f(&self, view: usize) -> &[f32] {
        self.slices[view]
            .f
            .get_or_init(|| self.table.blend(&self.corners, view))
    }

    /// f of one tabulated `wo` at (`x`, `y`) of the disk, RGB, sr⁻¹.
    #[inline]
    fn slice_f(&self, view: usize, x: Real, y: Real) -> Vec3 {
        let f = self.f(view);
        let footprint = self.table.disk().footprint(x, y);
        let weighed = footprint.map(|(cell, weight)| {
            let rgb = [0, 1, 2].map(|c| Real::from(f[3 * cell + c]));
            weight * Vec3::from_array(rgb)
        });
        weighed.into_iter().sum()
    }

    /// f at `xy` of the disk, RGB, sr⁻¹.
    #[inline]
    fn blended_f(&self, view: &View, [x, y]: [Real; 2]) -> Vec3 {
        let parts = view.parts.iter().filter(|(_, weight)| *weight > 0.0);
        parts
            .map(|&(part, weight)| weight * self.slice_f(part, x, y))
            .sum()
    }

    /// Cells per side of the sampling tables: two per pixel, so that bilinear slopes are followed.
    fn side(&self) -> usize {
        let [height, width] = self.table.resolution();
        (2 * height.max(width)).min(SIDE_MAX)
    }

    /// The density, on the square, that `view` samples from.
    ///
    /// The mean of the channels stands for brightness: with luminance instead, a blue slice could have weights of
    /// fourteen times its albedo, so the mean keeps every channel within three times.
    fn mixture(&self, view: &View) -> Mixture<'_> {
        let tables = view.parts.map(|(part, weight)| {
            let brightness = |x: Real, y: Real| self.slice_f(part, x, y).element_sum() / 3.0;
            let cells = self.slices[part]
                .cells
                .get_or_init(|| CellTable::new(self.side(), brightness));
            (cells, weight)
        });
        Mixture::new(self.side(), tables)
    }

    /// `wi` for `u`, from `mixture`.
    fn draw(view: &View, mixture: &Mixture, u: [Real; 2]) -> Vec3 {
        let [s, complement] = mixture.invert(u);
        let wi = view.to_shading(square_to_hemisphere(s, complement));
        // An edge of the square is the horizon itself, which is no direction above it.
        wi.with_z(wi.z.max(Real::MIN_POSITIVE))
    }
}

impl Bsdf for Imported {
    /// Interpolated as the module says; no random numbers.
    fn eval(&self, wo: Vec3, wi: Vec3, _: &mut Rng) -> Vec3 {
        if !usable(wo) || !usable(wi) {
            return Vec3::ZERO;
        }
        let view = self.view(wo);
        self.blended_f(&view, view.to_slice(wi)) * wi.z
    }

    /// [`Bsdf::propose`] with its weight; `None`, too, where the BSDF is black.
    fn sample(&self, wo: Vec3, u: [Real; 2], _: &mut Rng) -> Option<BsdfSample> {
        if !usable(wo) {
            return None;
        }
        let view = self.view(wo);
        let mixture = self.mixture(&view);
        let wi = Self::draw(&view, &mixture, u);
        let [x, y] = view.to_slice(wi);
        // f_cos / pdf without the cosine that they share.
        let weight = self.blended_f(&view, [x, y]) * (DISK_AREA / mixture.density(disk_to_square(x, y)));
        (weight != Vec3::ZERO).then_some(BsdfSample { wi, weight })
    }

    /// Constant times cos θ_i on each cell of the concentric square, nearly proportional to the mean channel of
    /// `eval`; positive at every direction above the horizon.
    fn pdf(&self, wo: Vec3, wi: Vec3) -> Real {
        if !usable(wo) || !usable(wi) {
            return 0.0;
        }
        let view = self.view(wo);
        let [x, y] = view.to_slice(wi);
        self.mixture(&view).density(disk_to_square(x, y)) * wi.z / DISK_AREA
    }

    fn propose(&self, wo: Vec3, u: [Real; 2]) -> Option<Vec3> {
        usable(wo).then(|| {
            let view = self.view(wo);
            Self::draw(&view, &self.mixture(&view), u)
        })
    }

    fn is_stochastic(&self) -> bool {
        false
    }

    fn slice(&self, wo: Vec3, _: usize, _: u64) -> Box<dyn Slice + '_> {
        Box::new(DirectSlice { bsdf: self, wo })
    }
}

impl fmt::Debug for Imported {
    /// Without the slices, which are as long as the file.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Imported")
            .field("table", &self.table)
            .field("corners", &self.corners)
            .finish_non_exhaustive()
    }
}
