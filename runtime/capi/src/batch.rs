//! The arrays of a batch as C passes them, and as the runtime takes them.

use crate::array::{array, inputs, object};
use crate::status::{BakeStatus, Failure};
use bake_runtime::Points;
use bake_runtime::native::Inversions;

/// Values of one free parameter.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct BakeColumn {
    /// One value per query, or a single one for all of them. Values outside of the parameter's range are taken as they are.
    pub data: *const f32,
    /// Their number: that of the queries, or 1.
    pub length: usize,
}

/// Directions to read: a column per component, count floats each.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct BakeDirections {
    /// Along the tangent.
    pub x: *const f32,
    /// Along the bitangent.
    pub y: *const f32,
    /// Along the normal.
    pub z: *const f32,
}

/// Directions to write: a column per component, count floats each.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct BakeDirectionsOut {
    /// Along the tangent.
    pub x: *mut f32,
    /// Along the bitangent.
    pub y: *mut f32,
    /// Along the normal.
    pub z: *mut f32,
}

/// Linear RGB to write: a column per channel, count floats each.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct BakeColorsOut {
    /// Red.
    pub r: *mut f32,
    /// Green.
    pub g: *mut f32,
    /// Blue.
    pub b: *mut f32,
}

/// Uniform random numbers to read, in [0, 1): two columns, count floats each.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct BakeUniforms {
    /// The first of each query.
    pub u0: *const f32,
    /// The second of each query.
    pub u1: *const f32,
}

/// The shading points of a batch.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct BakePoints {
    /// A column for each parameter that the material leaves free, in their order. May be null where there is none.
    pub params: *const BakeColumn,
    /// Number of columns: bake_material_parameter_count.
    pub param_count: usize,
    /// Directions to the camera.
    pub wo: BakeDirections,
    /// Number of queries; results do not depend on how queries are batched.
    pub count: usize,
}

/// How many inversions of the map a batch took, and how many failed.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BakeInversions {
    /// Charts times queries whose directions are finite and above the horizon.
    pub queries: u64,
    /// Those that did not converge; there the density of the chart's frame stands in.
    pub unconverged: u64,
}

impl From<Inversions> for BakeInversions {
    fn from(inversions: Inversions) -> BakeInversions {
        BakeInversions {
            queries: inversions.queries,
            unconverged: inversions.unconverged,
        }
    }
}

impl BakeDirections {
    /// The three columns.
    pub fn columns(self) -> [*const f32; 3] {
        [self.x, self.y, self.z]
    }
}

/// More parameters than any family leaves free; a call with more of them allocates.
const FEW: usize = 24;

/// [`BakePoints`] that passed the checks.
pub struct Batch<'a> {
    few: [&'a [f32]; FEW],
    many: Vec<&'a [f32]>,
    free: usize,
    wo: [&'a [f32]; 3],
    /// Number of queries.
    pub count: usize,
}

impl<'a> Batch<'a> {
    /// The batch at `points`, of a material with `free` parameters.
    ///
    /// # Errors
    /// When the number of columns or their lengths do not fit, and as of [`array`].
    ///
    /// # Safety
    /// There are as many numbers as `points` says, which nobody changes as long as `'a`.
    pub unsafe fn read(points: *const BakePoints, free: usize) -> Result<Batch<'a>, Failure> {
        // SAFETY: as the caller says; the copy outlives what C does with the original.
        let points = *unsafe { object("points", points)? };
        if points.param_count != free {
            let found = points.param_count;
            let message = format!("`points.param_count` is {found}, but the material leaves {free} free");
            return Err(Failure::new(BakeStatus::WrongLength, message));
        }
        // SAFETY: as the caller says.
        let columns = unsafe { array("points.params", points.params, free)? };
        let mut batch = Batch {
            few: [&[]; FEW],
            many: Vec::new(),
            free,
            // SAFETY: as the caller says.
            wo: unsafe { inputs(["wo.x", "wo.y", "wo.z"], points.wo.columns(), points.count)? },
            count: points.count,
        };
        if free > FEW {
            batch.many.resize(free, &[]);
        }
        for (i, column) in columns.iter().enumerate() {
            if column.length != 1 && column.length != batch.count {
                let (found, count) = (column.length, batch.count);
                let message = format!("`params[{i}]` has {found} values, expected 1 or {count}");
                return Err(Failure::new(BakeStatus::WrongLength, message));
            }
            // SAFETY: as the caller says.
            let values = unsafe { array(format_args!("params[{i}]"), column.data, column.length)? };
            match free > FEW {
                true => batch.many[i] = values,
                false => batch.few[i] = values,
            }
        }
        Ok(batch)
    }

    /// What the runtime takes.
    pub fn points(&self) -> Points<'_> {
        let (params, wo) = (self.params(), self.wo);
        Points { params, wo }
    }

    fn params(&self) -> &[&'a [f32]] {
        match self.free > FEW {
            true => &self.many,
            false => &self.few[..self.free],
        }
    }

    /// All that a call reads, by names: this batch and `others`.
    pub fn taken<const N: usize>(
        &self,
        names: [&'static str; N],
        others: [&'a [f32]; N],
    ) -> impl Iterator<Item = (&'static str, &'a [f32])> + Clone {
        let params = self.params().iter().map(|values| ("params", *values));
        let wo = self.wo.map(|values| ("wo", values));
        params.chain(wo).chain(names.into_iter().zip(others))
    }
}

#[cfg(test)]
mod tests {
    use super::FEW;
    use bake_runtime::Family;
    use bake_runtime::family::Kind;

    #[test]
    fn no_family_has_more_than_a_few_parameters() {
        for family in Family::ALL {
            let scalars = family.parameters().iter().map(|parameter| match parameter.kind {
                Kind::Numbers { components, .. } => components,
                _ => 0,
            });
            assert!(scalars.sum::<usize>() <= FEW, "{family:?}");
        }
    }
}
