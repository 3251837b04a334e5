//! Reading the file of an [`ImportedTable`], with every check.
//!
//! Reasons are texts, for the caller to name the file. Sizes are those that [`Archive`] has compared with the length of
//! the file, so that no header can ask for more memory than that.

use super::disk::DiskGrid;
use super::grid::{Axis, TURN, order};
use super::table::ImportedTable;
use crate::archive::Archive;
use crate::real::Real;
use safetensors::tensor::Dtype;
use std::collections::HashSet;

/// The format version this program reads.
pub const FORMAT: &str = "1";

/// Key of the format version in the `__metadata__` of the file.
pub const FORMAT_KEY: &str = "bake.import";

/// Largest f_cos that is accepted, sr⁻¹: only a lobe narrower than 10⁻¹⁰ radians is brighter, and sums over a slice
/// stay far within single precision.
pub const F_COS_MAX: f32 = 1e20;

/// Upper end of θ_o, degrees, excluded: the horizon.
const THETA_END: f32 = 90.0;

/// A tensor whose type and rank were checked.
struct Tensor<'a, const RANK: usize> {
    shape: [usize; RANK],
    numbers: &'a [[u8; 4]],
}

impl<const RANK: usize> Tensor<'_, RANK> {
    fn at(&self, index: usize) -> f32 {
        f32::from_le_bytes(self.numbers[index])
    }
}

/// Parses the content of a file.
///
/// # Errors
/// What is wrong with it.
pub(super) fn parse(bytes: &[u8]) -> Result<ImportedTable, String> {
    let file = Archive::open(bytes)?;
    check_version(file.text(FORMAT_KEY))?;
    let params: Tensor<2> = tensor(&file, "params", "[N, P]")?;
    let wo: Tensor<2> = tensor(&file, "wo", "[N, 2]")?;
    let f_cos: Tensor<4> = tensor(&file, "f_cos", "[N, H, W, 3]")?;
    let [n, height, width, channels] = f_cos.shape;
    if n == 0 || height == 0 || width == 0 || channels != 3 {
        return Err(format!(
            "tensor `f_cos` is {:?}, but must be [N, H, W, 3] with N, H and W at least 1",
            f_cos.shape
        ));
    }
    if wo.shape != [n, 2] {
        return Err(format!(
            "tensor `wo` is {:?}, but must be [{n}, 2] as `f_cos` has {n} rows",
            wo.shape
        ));
    }
    let [rows, p] = params.shape;
    if rows != n {
        return Err(format!("tensor `params` has {rows} rows, but `f_cos` has {n}"));
    }
    let param_names = param_names(file.text("param_names"), p)?;
    let (axes, rows) = coordinates(&params, &wo)?;
    let names: Vec<&str> = param_names
        .iter()
        .map(String::as_str)
        .chain(["theta", "phi"])
        .collect();
    let order = order(&axes, &rows, &names)?;
    axes[p + 1].check_circle()?;
    let disk = DiskGrid { height, width };
    Ok(ImportedTable {
        param_names,
        description: file.text("description").map(str::to_string),
        axes,
        disk,
        f: read_f(&f_cos, disk, &order)?,
    })
}

fn check_version(version: Option<&str>) -> Result<(), String> {
    match version {
        Some(FORMAT) => Ok(()),
        Some(other) => Err(format!(
            "its format version is {other:?}, but this program reads {FORMAT:?}"
        )),
        None => Err(format!(
            "its metadata has no `{FORMAT_KEY}`, so it is of another kind"
        )),
    }
}

/// The tensor `name`; `layout` is its shape, for messages.
fn tensor<'a, const RANK: usize>(
    file: &'a Archive,
    name: &str,
    layout: &str,
) -> Result<Tensor<'a, RANK>, String> {
    let tensor = file
        .tensor(name)
        .ok_or_else(|| format!("tensor `{name}`, F32 {layout}, is missing"))?;
    match <[usize; RANK]>::try_from(tensor.shape) {
        Ok(shape) if tensor.dtype == Dtype::F32 => Ok(Tensor {
            shape,
            numbers: tensor.data.as_chunks().0,
        }),
        _ => Err(format!(
            "tensor `{name}` is {:?} {:?}, but must be F32 {layout}",
            tensor.dtype, tensor.shape
        )),
    }
}

/// The names in `json`, or p0, p1, …; `count` of them.
fn param_names(json: Option<&str>, count: usize) -> Result<Vec<String>, String> {
    let Some(json) = json else {
        return Ok((0..count).map(|i| format!("p{i}")).collect());
    };
    let names: Vec<String> = serde_json::from_str(json)
        .map_err(|e| format!("its metadata `param_names` is not a JSON list of strings ({e})"))?;
    if names.len() != count {
        return Err(format!(
            "its metadata `param_names` has {} names, but tensor `params` has {count} columns",
            names.len()
        ));
    }
    let mut seen = HashSet::new();
    for (i, name) in names.iter().enumerate() {
        if name.is_empty() || name.contains(char::is_control) || !seen.insert(name) {
            return Err(format!(
                "its metadata `param_names` has {name:?} at {i}, but names must be distinct, not empty, and of \
                 one line"
            ));
        }
    }
    Ok(names)
}

/// The axes of the grid (parameters, θ, φ) and the coordinates of each row on them.
fn coordinates(params: &Tensor<2>, wo: &Tensor<2>) -> Result<(Vec<Axis>, Vec<Vec<f32>>), String> {
    let [n, p] = params.shape;
    let mut rows = Vec::with_capacity(n);
    for row in 0..n {
        let mut at: Vec<f32> = (0..p).map(|i| params.at(row * p + i)).collect();
        if let Some(i) = at.iter().position(|v| !v.is_finite()) {
            return Err(format!(
                "params[{row}, {i}] is {}, but must be a finite number",
                at[i]
            ));
        }
        let (theta, phi) = (wo.at(2 * row), wo.at(2 * row + 1));
        if !(0.0..THETA_END).contains(&theta) {
            return Err(format!(
                "wo[{row}, 0] is {theta}, but theta must lie in 0..{THETA_END} degrees, {THETA_END} excluded"
            ));
        }
        if !phi.is_finite() {
            return Err(format!(
                "wo[{row}, 1] is {phi}, but phi must be a finite number of degrees"
            ));
        }
        let turned = phi.rem_euclid(TURN);
        // The remainder of a tiny negative angle rounds to a whole turn.
        at.extend([theta, if turned < TURN { turned } else { 0.0 }]);
        rows.push(at);
    }
    let axes = (0..p + 2)
        .map(|i| Axis::of(rows.iter().map(|row| row[i])))
        .collect();
    Ok((axes, rows))
}

/// f = f_cos / cos θ_i, continued outside the disk, with the rows in `order`.
fn read_f(f_cos: &Tensor<4>, disk: DiskGrid, order: &[usize]) -> Result<Vec<f32>, String> {
    let DiskGrid { height, width } = disk;
    let length = 3 * disk.cells();
    let outside = disk.outside();
    let mut f = vec![0.0; order.len() * length];
    for (slice, &row) in f.chunks_exact_mut(length).zip(order) {
        for (i, j) in (0..height).flat_map(|i| (0..width).map(move |j| (i, j))) {
            let Some(cos) = disk.cos(i, j) else { continue };
            for channel in 0..3 {
                let at = 3 * (i * width + j) + channel;
                let value = f_cos.at(row * length + at);
                if !(0.0..=F_COS_MAX).contains(&value) {
                    return Err(format!(
                        "f_cos[{row}, {i}, {j}, {channel}] is {value}, but must lie in 0..{F_COS_MAX:e} per \
                         steradian"
                    ));
                }
                slice[at] = (Real::from(value) / cos) as f32;
            }
        }
        for outside in &outside {
            for channel in 0..3 {
                let sum: f32 = outside.nearest.iter().map(|cell| slice[3 * cell + channel]).sum();
                slice[3 * outside.cell + channel] = sum / outside.nearest.len() as f32;
            }
        }
    }
    Ok(f)
}
