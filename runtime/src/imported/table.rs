//! A table of slices as it was read: what it covers, and binding its parameters.

use super::Imported;
use super::disk::DiskGrid;
use super::file;
use super::grid::Axis;
use crate::error::{Error, Result};
use crate::real::Real;
use std::fmt;
use std::path::Path;
use std::sync::Arc;

/// A table of slices of a BSDF; the format of its file is in [`crate::imported`].
#[derive(Clone, PartialEq)]
pub struct ImportedTable {
    pub(super) param_names: Vec<String>,
    pub(super) description: Option<String>,
    /// One axis per parameter, then θ_o and φ_o in degrees.
    pub(super) axes: Vec<Axis>,
    pub(super) disk: DiskGrid,
    /// f = f_cos / cos θ_i, sr⁻¹: `[slices, H, W, 3]`, slices in the order of the grid (φ fastest).
    pub(super) f: Vec<f32>,
}

impl ImportedTable {
    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be read, [`Error::Import`] when it is not a table of this format.
    pub fn load(path: &Path) -> Result<ImportedTable> {
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
        ImportedTable::from_bytes(&bytes, path)
    }

    /// Parses the content of a file; `path` only names it in errors.
    ///
    /// Memory stays within a small multiple of the length of `bytes`, whatever they say.
    ///
    /// # Errors
    /// [`Error::Import`] naming the tensor, the element and the value that is wrong.
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<ImportedTable> {
        file::parse(bytes).map_err(|reason| Error::import(path, reason))
    }

    /// Binds `params`, one number per parameter in the order of [`ImportedTable::param_names`].
    ///
    /// They are rounded to the table's single precision. Nothing is blended yet: that happens slice by slice, when
    /// a direction first needs it.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the first parameter outside its range, or when their number is wrong.
    pub fn bind(self: &Arc<ImportedTable>, params: &[Real]) -> Result<Imported> {
        if params.len() != self.param_names.len() {
            return Err(Error::parameter(
                "params",
                format!(
                    "has {} numbers, but the table has the {} parameters [{}]",
                    params.len(),
                    self.param_names.len(),
                    self.param_names.join(", ")
                ),
            ));
        }
        let mut corners: Vec<(usize, Real)> = vec![(0, 1.0)];
        for ((name, axis), &value) in self.param_names.iter().zip(&self.axes).zip(params) {
            let [lowest, highest] = axis.range();
            let rounded = value as f32;
            if !(lowest..=highest).contains(&rounded) {
                return Err(Error::parameter(
                    name,
                    format!("is {value}, but the table covers {lowest}..{highest}"),
                ));
            }
            let bracket = axis.bracket(Real::from(rounded));
            corners = corners
                .into_iter()
                .flat_map(|(corner, weight)| {
                    let parts = bracket.parts();
                    parts.map(move |(i, share)| (corner * axis.len() + i, weight * share))
                })
                .collect();
        }
        Ok(Imported::new(self.clone(), corners))
    }

    /// Names of the parameters, in their order.
    pub fn param_names(&self) -> &[String] {
        &self.param_names
    }

    /// What the file says that it is.
    pub fn description(&self) -> Option<&str> {
        self.description.as_deref()
    }

    /// Lowest and highest tabulated value of each parameter.
    ///
    /// The shortest decimal of each number in the file: 0.1 where its nearest f32 stands there, so that 0.1 is in
    /// range in double precision, too.
    pub fn ranges(&self) -> Vec<[Real; 2]> {
        let decimal = |v: f32| v.to_string().parse().unwrap_or(Real::from(v));
        let axes = self.axes.iter().take(self.param_names.len());
        axes.map(|axis| axis.range().map(decimal)).collect()
    }

    /// Distinct θ_o of the table, degrees, ascending.
    pub fn theta(&self) -> &[f32] {
        &self.theta_axis().values
    }

    /// Distinct φ_o of the table, degrees in [0, 360), ascending; one alone for an isotropic BSDF.
    pub fn phi(&self) -> &[f32] {
        &self.phi_axis().values
    }

    /// Height and width of a slice, pixels.
    pub fn resolution(&self) -> [usize; 2] {
        [self.disk.height, self.disk.width]
    }

    /// Number of slices; at least 1.
    pub fn len(&self) -> usize {
        self.axes.iter().map(Axis::len).product()
    }

    /// Never: a table without slices is not read.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of tabulated `wo`.
    pub(super) fn views(&self) -> usize {
        self.theta_axis().len() * self.phi_axis().len()
    }

    pub(super) fn theta_axis(&self) -> &Axis {
        &self.axes[self.param_names.len()]
    }

    pub(super) fn phi_axis(&self) -> &Axis {
        &self.axes[self.param_names.len() + 1]
    }

    pub(super) fn disk(&self) -> DiskGrid {
        self.disk
    }

    /// f of the tabulated `wo` with index `view`, a weighed sum over `corners` of the grid of parameters.
    pub(super) fn blend(&self, corners: &[(usize, Real)], view: usize) -> Vec<f32> {
        let length = 3 * self.disk.cells();
        let mut sum: Vec<Real> = vec![0.0; length];
        for &(corner, weight) in corners {
            let start = (corner * self.views() + view) * length;
            for (sum, &f) in sum.iter_mut().zip(&self.f[start..start + length]) {
                *sum += weight * Real::from(f);
            }
        }
        sum.into_iter().map(|f| f as f32).collect()
    }
}

impl fmt::Debug for ImportedTable {
    /// Without the numbers, which are as long as the file.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ImportedTable")
            .field("param_names", &self.param_names)
            .field("description", &self.description)
            .field("axes", &self.axes)
            .field("disk", &self.disk)
            .finish_non_exhaustive()
    }
}
