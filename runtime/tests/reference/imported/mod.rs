//! The family `imported`: what is interpolated, what is refused, what is sampled, and the inputs where such code
//! usually breaks.

mod bad_files;
mod edges;
mod interpolation;
mod sampling;

use crate::support::direction;
use bake_runtime::imported::{FORMAT, FORMAT_KEY, Imported, ImportedTable};
use bake_runtime::{Bsdf, Error, Rng};
use glam::DVec3;
use safetensors::tensor::{Dtype, TensorView};
use std::collections::{BTreeMap, HashMap};
use std::f64::consts::FRAC_1_PI;
use std::path::Path;
use std::sync::Arc;

/// What errors call the file.
const PATH: &str = "folder/table.safetensors";

/// The values of a table's axes and the size of its slices.
#[derive(Clone, Default)]
struct Grid {
    params: Vec<Vec<f32>>,
    theta: Vec<f32>,
    phi: Vec<f32>,
    height: usize,
    width: usize,
}

/// Coordinates of one tabulated number.
struct At<'a> {
    params: &'a [f64],
    /// Degrees.
    theta: f64,
    /// Degrees.
    phi: f64,
    wi: DVec3,
}

/// The content of a table's file, to be spoiled before it is written.
#[derive(Clone)]
struct File {
    metadata: HashMap<String, String>,
    tensors: BTreeMap<&'static str, (Dtype, Vec<usize>, Vec<u8>)>,
}

impl File {
    /// Tabulates `f`, RGB, sr⁻¹, without the cosine.
    fn of(grid: &Grid, f: impl Fn(&At) -> [f64; 3]) -> File {
        let mut rows: Vec<Vec<f32>> = vec![vec![]];
        for axis in grid.params.iter().chain([&grid.theta, &grid.phi]) {
            let longer = |row: &Vec<f32>| -> Vec<Vec<f32>> {
                axis.iter().map(|&v| [&row[..], &[v]].concat()).collect()
            };
            rows = rows.iter().flat_map(longer).collect();
        }
        let (n, p, h, w) = (rows.len(), grid.params.len(), grid.height, grid.width);
        let mut file = File {
            metadata: HashMap::from([(FORMAT_KEY.into(), FORMAT.into())]),
            tensors: BTreeMap::new(),
        };
        let (mut params, mut wo, mut f_cos) = (vec![], vec![], vec![]);
        for row in &rows {
            params.extend_from_slice(&row[..p]);
            wo.extend_from_slice(&row[p..]);
            let row: Vec<f64> = row.iter().map(|&v| v.into()).collect();
            for (i, j) in (0..h).flat_map(|i| (0..w).map(move |j| (i, j))) {
                let (x, y) = (centre(j, w), centre(i, h));
                let squared = 1.0 - x * x - y * y;
                let wi = DVec3::new(x, y, squared.max(0.0).sqrt());
                let at = At {
                    params: &row[..p],
                    theta: row[p],
                    phi: row[p + 1],
                    wi,
                };
                let rgb = if squared > 0.0 { f(&at) } else { [0.0; 3] };
                f_cos.extend(rgb.map(|v| (v * wi.z) as f32));
            }
        }
        file.set("params", &[n, p], &params);
        file.set("wo", &[n, 2], &wo);
        file.set("f_cos", &[n, h, w, 3], &f_cos);
        file
    }

    /// Replaces a tensor.
    fn set(&mut self, name: &'static str, shape: &[usize], values: &[f32]) {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.tensors.insert(name, (Dtype::F32, shape.to_vec(), bytes));
    }

    /// Replaces one number of a tensor.
    fn put(&mut self, name: &str, index: &[usize], value: f32) {
        let (_, shape, bytes) = self.tensors.get_mut(name).expect("the tensor exists");
        let at = index.iter().zip(shape).fold(0, |at, (i, n)| at * *n + i);
        bytes[4 * at..4 * at + 4].copy_from_slice(&value.to_le_bytes());
    }

    fn bytes(&self) -> Vec<u8> {
        let views = self.tensors.iter().map(|(name, (dtype, shape, bytes))| {
            (
                *name,
                TensorView::new(*dtype, shape.clone(), bytes).expect("shape and bytes agree"),
            )
        });
        safetensors::serialize(views, Some(self.metadata.clone())).expect("tensor names are distinct")
    }

    fn read(&self) -> Result<ImportedTable, Error> {
        ImportedTable::from_bytes(&self.bytes(), Path::new(PATH))
    }

    fn table(&self) -> Arc<ImportedTable> {
        Arc::new(self.read().unwrap_or_else(|e| panic!("{e}")))
    }
}

/// Coordinate of the centre of cell `k` of `n` along an axis of the disk.
fn centre(k: usize, n: usize) -> f64 {
    -1.0 + (2 * k + 1) as f64 / n as f64
}

/// A table of `f` with `params` bound.
fn bound(grid: &Grid, params: &[f64], f: impl Fn(&At) -> [f64; 3]) -> Imported {
    let table = File::of(grid, f).table();
    table.bind(params).unwrap_or_else(|e| panic!("{e}"))
}

/// `eval` without random numbers.
fn eval(bsdf: &Imported, wo: DVec3, wi: DVec3) -> DVec3 {
    bsdf.eval(wo, wi, &mut Rng::new(&[]))
}

/// A diffuse floor under a coloured Gaussian lobe (`width`: standard deviation on the disk) about the mirror
/// direction; isotropic and smooth.
fn lobe(width: f64, at: &At) -> [f64; 3] {
    let mirror = -direction(at.theta, at.phi);
    let away = (at.wi - mirror).truncate().length_squared();
    let peak = (-0.5 * away / (width * width)).exp();
    [0.2, 0.1, 0.02].map(|diffuse| diffuse * FRAC_1_PI + (1.0 - diffuse) * peak)
}

/// `count` angles from 0 to `last`, evenly spaced.
fn spaced(last: f32, count: usize) -> Vec<f32> {
    (0..count).map(|k| last * k as f32 / (count - 1) as f32).collect()
}

/// `count` angles round the circle, degrees.
fn circle(count: usize) -> Vec<f32> {
    (0..count).map(|k| 360.0 * k as f32 / count as f32).collect()
}
