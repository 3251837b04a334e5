//! The map database: safetensors shards of a few hundred slices, written whole or not at all.
//!
//! Tensors of a shard of K slices with room for C charts, on n × n cells; what a chart that is not there would hold is NaN
//! (0 in u8):
//! `parameters` `[K,P]`, `wo` `[K,3]`, `share` `[K,C]` (probability of a chart), `frame` `[K,C,5]` (x, y, shear, b),
//! `boost` `[K,C,2]` (velocity), `residuals` `[K,C,5]` (constant, residual, softened, folds, uncovered) and
//! `smoothing_error` `[K]` in f64; `charts` `[K]` and `fallback` `[K,C]` in u8; `log_density` `[K,C,3,n,n]`,
//! `map` `[K,C,n,n,2]` and `potential` `[K,C,n,n]` (NaN where there is none) in f32. The metadata says, as JSON, what they
//! were computed from.

use crate::error::{Error, Result};
use crate::maps::MappedSlice;
use crate::slice::SliceTable;
use crate::tensors;
use crate::transport::frame_map::{ChartMap, Residuals};
use bake_runtime::boost::Boost;
use bake_runtime::chart::Chart;
use bake_runtime::frame::Frame;
use bake_runtime::network::write_atomically;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Version of the layout, and of whatever the numbers depend on without the fingerprint saying so.
pub const FORMAT: u32 = 4;

/// Slices per shard.
pub const SHARD_SLICES: usize = 128;

/// Metadata key of the fingerprint.
const FINGERPRINT_KEY: &str = "bake.maps";

/// Numbers per chart in `residuals`.
const RESIDUALS: usize = 5;

fn path_of(folder: &Path, shard: usize) -> PathBuf {
    folder.join(format!("maps-{shard:04}.safetensors"))
}

/// `values` of every chart of every slice, and `count` times `empty` for each of `room` charts that is not there.
fn padded<T: Copy>(
    slices: &[MappedSlice],
    room: usize,
    count: usize,
    empty: T,
    values: impl Fn(&ChartMap) -> Vec<T>,
) -> Vec<T> {
    let mut all = Vec::with_capacity(slices.len() * room * count);
    for slice in slices {
        for i in 0..room {
            match slice.charts.get(i).map(&values) {
                Some(own) if own.len() == count => all.extend(own),
                _ => all.extend(std::iter::repeat_n(empty, count)),
            }
        }
    }
    all
}

fn bytes64(values: Vec<f64>) -> Vec<u8> {
    values.into_iter().flat_map(f64::to_le_bytes).collect()
}

fn bytes32(values: Vec<f32>) -> Vec<u8> {
    values.into_iter().flat_map(f32::to_le_bytes).collect()
}

/// Writes a shard of `slices` with room for `room` charts each; at least one slice.
///
/// # Errors
/// An I/O error naming the file.
pub fn save_shard(
    folder: &Path,
    shard: usize,
    slices: &[MappedSlice],
    room: usize,
    fingerprint: &str,
) -> Result<()> {
    let (k, n) = (slices.len(), slices[0].charts[0].table.cells);
    let parameters = slices[0].parameters.len();
    let cells = n * n;
    let doubles = |count: usize, values: &dyn Fn(&ChartMap) -> Vec<f64>| {
        bytes64(padded(slices, room, count, f64::NAN, values))
    };
    let floats = |count: usize, values: &dyn Fn(&ChartMap) -> Vec<f32>| {
        bytes32(padded(slices, room, count, f32::NAN, values))
    };
    let residuals = |c: &ChartMap| {
        let r = c.residuals;
        vec![r.constant, r.residual, r.softened, r.folds, r.uncovered]
    };
    let frame = |c: &ChartMap| {
        let f = c.chart.frame;
        vec![f.x, f.y, f.shear, f.b[0], f.b[1]]
    };
    let flat = |slices: &[MappedSlice], f: fn(&MappedSlice) -> Vec<f64>| {
        bytes64(slices.iter().flat_map(f).collect())
    };
    let tensors = [
        (
            "parameters",
            Dtype::F64,
            vec![k, parameters],
            flat(slices, |s| s.parameters.clone()),
        ),
        ("wo", Dtype::F64, vec![k, 3], flat(slices, |s| s.wo.to_vec())),
        (
            "smoothing_error",
            Dtype::F64,
            vec![k],
            flat(slices, |s| vec![s.smoothing_error]),
        ),
        (
            "charts",
            Dtype::U8,
            vec![k],
            slices.iter().map(|s| s.charts.len() as u8).collect(),
        ),
        (
            "fallback",
            Dtype::U8,
            vec![k, room],
            padded(slices, room, 1, 0, |c| vec![u8::from(c.fallback)]),
        ),
        ("share", Dtype::F64, vec![k, room], doubles(1, &|c| vec![c.share])),
        ("frame", Dtype::F64, vec![k, room, 5], doubles(5, &frame)),
        (
            "boost",
            Dtype::F64,
            vec![k, room, 2],
            doubles(2, &|c| c.chart.boost.velocity().to_vec()),
        ),
        (
            "residuals",
            Dtype::F64,
            vec![k, room, RESIDUALS],
            doubles(RESIDUALS, &residuals),
        ),
        (
            "log_density",
            Dtype::F32,
            vec![k, room, 3, n, n],
            floats(3 * cells, &|c| c.table.log_density.concat()),
        ),
        (
            "map",
            Dtype::F32,
            vec![k, room, n, n, 2],
            floats(2 * cells, &|c| c.map.as_flattened().to_vec()),
        ),
        (
            "potential",
            Dtype::F32,
            vec![k, room, n, n],
            floats(cells, &|c| c.potential.clone()),
        ),
    ];
    let views = tensors.iter().map(|(name, dtype, shape, data)| {
        (
            *name,
            TensorView::new(*dtype, shape.clone(), data).expect("shape matches data by construction"),
        )
    });
    let metadata = HashMap::from([(FINGERPRINT_KEY.to_string(), fingerprint.to_string())]);
    let bytes =
        safetensors::serialize(views, Some(metadata)).expect("tensor names are unique by construction");
    Ok(write_atomically(&path_of(folder, shard), &bytes)?)
}

/// A shard's file, opened.
struct Shard {
    path: PathBuf,
    bytes: Vec<u8>,
}

impl Shard {
    /// `None` when there is none.
    fn open(folder: &Path, shard: usize) -> Result<Option<Shard>> {
        let path = path_of(folder, shard);
        if !path.exists() {
            return Ok(None);
        }
        match std::fs::read(&path) {
            Ok(bytes) => Ok(Some(Shard { path, bytes })),
            Err(e) => Err(Error::Checkpoint {
                path,
                reason: e.to_string(),
            }),
        }
    }

    fn broken(&self, reason: String) -> Error {
        Error::Checkpoint {
            path: self.path.clone(),
            reason,
        }
    }

    /// The tensors and the fingerprint.
    fn parse(&self) -> Result<(SafeTensors<'_>, Option<String>)> {
        let file = SafeTensors::deserialize(&self.bytes)
            .map_err(|e| self.broken(format!("not a whole map shard ({e})")))?;
        let (_, header) = SafeTensors::read_metadata(&self.bytes).map_err(|e| self.broken(e.to_string()))?;
        let fingerprint = header.metadata().as_ref().and_then(|m| m.get(FINGERPRINT_KEY));
        Ok((file, fingerprint.cloned()))
    }

    /// All slices in it.
    fn slices(&self, file: &SafeTensors) -> Result<Vec<MappedSlice>> {
        let shape = |name: &str, rank: usize| match file.tensor(name) {
            Ok(view) if view.shape().len() == rank => Ok(view.shape().to_vec()),
            _ => Err(self.broken(format!("tensor `{name}` is missing or has another rank"))),
        };
        let [k, parameters] = [0, 1].map(|i: usize| shape("parameters", 2).map(|s| s[i]));
        let (k, parameters) = (k?, parameters?);
        let potential_shape = shape("potential", 4)?;
        let (room, n) = (potential_shape[1], potential_shape[2]);
        let cells = n * n;
        let doubles = |name: &str, each: usize| {
            tensors::read(file, name, Dtype::F64, k * each, f64::from_le_bytes).map_err(|e| self.broken(e))
        };
        let floats = |name: &str, each: usize| {
            tensors::read(file, name, Dtype::F32, k * each, f32::from_le_bytes).map_err(|e| self.broken(e))
        };
        let small = |name: &str, each: usize| {
            tensors::read(file, name, Dtype::U8, k * each, |[b]: [u8; 1]| b).map_err(|e| self.broken(e))
        };
        let (values, wo, smoothing_error) = (
            doubles("parameters", parameters)?,
            doubles("wo", 3)?,
            doubles("smoothing_error", 1)?,
        );
        let (charts, fallback) = (small("charts", 1)?, small("fallback", room)?);
        if let Some(i) = charts.iter().position(|c| !(1..=room).contains(&usize::from(*c))) {
            return Err(self.broken(format!(
                "entry {i} of it has {} charts, not 1 to {room}",
                charts[i]
            )));
        }
        let (share, frame) = (doubles("share", room)?, doubles("frame", 5 * room)?);
        let (boost, residuals) = (
            doubles("boost", 2 * room)?,
            doubles("residuals", RESIDUALS * room)?,
        );
        let (log_density, map, potential) = (
            floats("log_density", 3 * cells * room)?,
            floats("map", 2 * cells * room)?,
            floats("potential", cells * room)?,
        );
        let chart = |c: usize| {
            let plane = |p: usize| log_density[(3 * c + p) * cells..(3 * c + p + 1) * cells].to_vec();
            let f = &frame[5 * c..5 * c + 5];
            let r = &residuals[RESIDUALS * c..RESIDUALS * (c + 1)];
            ChartMap {
                chart: Chart {
                    frame: Frame {
                        x: f[0],
                        y: f[1],
                        shear: f[2],
                        b: [f[3], f[4]],
                    },
                    boost: Boost::new([boost[2 * c], boost[2 * c + 1]]),
                },
                share: share[c],
                table: SliceTable {
                    cells: n,
                    log_density: [plane(0), plane(1), plane(2)],
                },
                map: map[2 * c * cells..2 * (c + 1) * cells].as_chunks().0.to_vec(),
                potential: match potential[c * cells].is_nan() {
                    true => Vec::new(),
                    false => potential[c * cells..(c + 1) * cells].to_vec(),
                },
                residuals: Residuals {
                    constant: r[0],
                    residual: r[1],
                    softened: r[2],
                    folds: r[3],
                    uncovered: r[4],
                },
                fallback: fallback[c] != 0,
            }
        };
        Ok((0..k)
            .map(|i| MappedSlice {
                parameters: values[parameters * i..parameters * (i + 1)].to_vec(),
                wo: [wo[3 * i], wo[3 * i + 1], wo[3 * i + 2]],
                charts: (0..charts[i].into()).map(|c| chart(i * room + c)).collect(),
                smoothing_error: smoothing_error[i],
            })
            .collect())
    }
}

/// Reads the first `count` slices of a shard; `None` when there is none, or one with fewer slices, or computed from
/// something else.
///
/// # Errors
/// [`Error::Checkpoint`] for a file that is there but cannot be read.
pub fn load_shard(
    folder: &Path,
    shard: usize,
    count: usize,
    fingerprint: &str,
) -> Result<Option<Vec<MappedSlice>>> {
    let Some(opened) = Shard::open(folder, shard)? else {
        return Ok(None);
    };
    let (file, found) = opened.parse()?;
    if found.as_deref() != Some(fingerprint) {
        return Ok(None);
    }
    let mut slices = opened.slices(&file)?;
    slices.truncate(count);
    Ok(Some(slices).filter(|s| s.len() == count))
}

/// The fingerprint of the first shard in `folder`; `None` when there is none.
///
/// # Errors
/// [`Error::Checkpoint`] for a file that is there but cannot be read, and for a folder that begins with another shard.
pub fn fingerprint(folder: &Path) -> Result<Option<String>> {
    if let Some(shard) = Shard::open(folder, 0)? {
        return Ok(Some(shard.parse()?.1.unwrap_or_default()));
    }
    let is_shard = |name: &str| name.starts_with("maps-") && name.ends_with(".safetensors");
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let stray = files.map(|f| f.path()).find(|p| {
        let name = p.file_name().and_then(|n| n.to_str());
        name.is_some_and(is_shard)
    });
    match stray {
        None => Ok(None),
        Some(path) => Err(Error::Checkpoint {
            path,
            reason: "the shards before it are missing".into(),
        }),
    }
}

/// Slice `index` of the maps in `folder`; `None` when there are fewer.
///
/// # Errors
/// [`Error::Checkpoint`] for a shard that cannot be read.
pub fn load_slice(folder: &Path, index: usize) -> Result<Option<MappedSlice>> {
    let Some(opened) = Shard::open(folder, index / SHARD_SLICES)? else {
        return Ok(None);
    };
    let (file, _) = opened.parse()?;
    Ok(opened.slices(&file)?.into_iter().nth(index % SHARD_SLICES))
}

/// All slices of `folder`, in order, `total` of them, computed as `fingerprint` says.
///
/// # Errors
/// [`Error::Checkpoint`] for a shard that is missing or cannot be used.
pub fn load(folder: &Path, total: usize, fingerprint: &str) -> Result<Vec<MappedSlice>> {
    let mut slices = Vec::with_capacity(total);
    while slices.len() < total {
        let shard = slices.len() / SHARD_SLICES;
        let count = SHARD_SLICES.min(total - slices.len());
        match load_shard(folder, shard, count, fingerprint)? {
            Some(loaded) => slices.extend(loaded),
            None => {
                return Err(Error::Checkpoint {
                    path: path_of(folder, shard),
                    reason: "not there, or made of something else".into(),
                });
            }
        }
    }
    Ok(slices)
}
