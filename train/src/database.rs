//! The map database: safetensors shards of a few hundred slices, written whole or not at all.
//!
//! Tensors per shard of K slices on n × n cells: `wo` `[K,3]` and `frame` `[K,5]` (x, y, shear, b) in f64,
//! `log_density` `[K,3,n,n]`, `map` `[K,n,n,2]`, `potential` `[K,n,n]` (NaN where the marginal map stands in)
//! in f32, `constant` `[K]` in f64. The metadata holds the fingerprint of what they were computed from.

use crate::error::{Error, Result};
use crate::maps::{CELLS, MappedSlice};
use crate::nn::frame::FrameNetwork;
use crate::slice::{SliceTable, WALKS};
use crate::tensors;
use bake_runtime::conductor::Conductor;
use bake_runtime::frame::Frame;
use bake_runtime::network::write_atomically;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Slices per shard.
pub const SHARD_SLICES: usize = 128;

/// Metadata key of the fingerprint.
const FINGERPRINT_KEY: &str = "bake.maps";

/// Everything that the numbers in a shard depend on, as text; shards with another fingerprint are not taken up.
pub fn fingerprint(bsdf: &Conductor, frames: &FrameNetwork, directions: &[[f64; 3]]) -> String {
    let weights = frames
        .layers
        .iter()
        .flat_map(|l| l.weight.iter().chain(&l.bias))
        .fold(0u64, |h, w| {
            h.rotate_left(5).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ u64::from(w.to_bits())
        });
    format!(
        "v3 alpha {:?} {:?} directions {} cells {CELLS} walks {WALKS} frames {weights:016x}",
        bsdf.alpha,
        bsdf.fresnel,
        directions.len()
    )
}

fn path_of(folder: &Path, shard: usize) -> PathBuf {
    folder.join(format!("maps-{shard:04}.safetensors"))
}

fn bytes64(values: impl Iterator<Item = f64>) -> Vec<u8> {
    values.flat_map(f64::to_le_bytes).collect()
}

fn bytes32(values: impl Iterator<Item = f32>) -> Vec<u8> {
    values.flat_map(f32::to_le_bytes).collect()
}

/// Writes a shard.
///
/// # Errors
/// An I/O error naming the file.
pub fn save_shard(folder: &Path, shard: usize, slices: &[MappedSlice], fingerprint: &str) -> Result<()> {
    let (k, n) = (slices.len(), CELLS);
    let potential = |s: &MappedSlice| match s.potential.is_empty() {
        true => vec![f32::NAN; n * n],
        false => s.potential.clone(),
    };
    let frame = |s: &MappedSlice| [s.frame.x, s.frame.y, s.frame.shear, s.frame.b[0], s.frame.b[1]];
    let tensors = [
        (
            "wo",
            Dtype::F64,
            vec![k, 3],
            bytes64(slices.iter().flat_map(|s| s.wo)),
        ),
        (
            "frame",
            Dtype::F64,
            vec![k, 5],
            bytes64(slices.iter().flat_map(frame)),
        ),
        (
            "constant",
            Dtype::F64,
            vec![k],
            bytes64(slices.iter().map(|s| s.constant)),
        ),
        (
            "log_density",
            Dtype::F32,
            vec![k, 3, n, n],
            bytes32(
                slices
                    .iter()
                    .flat_map(|s| s.table.log_density.iter().flatten().copied()),
            ),
        ),
        (
            "map",
            Dtype::F32,
            vec![k, n, n, 2],
            bytes32(slices.iter().flat_map(|s| s.map.iter().flatten().copied())),
        ),
        (
            "potential",
            Dtype::F32,
            vec![k, n, n],
            bytes32(slices.iter().flat_map(potential)),
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

/// Reads a shard of `count` slices; `None` when there is none, or one computed from something else.
///
/// # Errors
/// [`Error::Checkpoint`] for a file that is there but cannot be read.
pub fn load_shard(
    folder: &Path,
    shard: usize,
    count: usize,
    fingerprint: &str,
) -> Result<Option<Vec<MappedSlice>>> {
    let path = path_of(folder, shard);
    if !path.exists() {
        return Ok(None);
    }
    let broken = |reason: String| Error::Checkpoint {
        path: path.clone(),
        reason,
    };
    let bytes = std::fs::read(&path).map_err(|e| broken(e.to_string()))?;
    let file =
        SafeTensors::deserialize(&bytes).map_err(|e| broken(format!("not a whole map shard ({e})")))?;
    let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|e| broken(e.to_string()))?;
    let found = header.metadata().as_ref().and_then(|m| m.get(FINGERPRINT_KEY));
    if found.map(String::as_str) != Some(fingerprint) {
        return Ok(None);
    }
    let n = CELLS * CELLS;
    let floats = |name: &str, per_slice: usize| {
        tensors::read(&file, name, Dtype::F32, count * per_slice, f32::from_le_bytes).map_err(broken)
    };
    let doubles = |name: &str, per_slice: usize| {
        tensors::read(&file, name, Dtype::F64, count * per_slice, f64::from_le_bytes).map_err(broken)
    };
    let (wo, frame, constant) = (doubles("wo", 3)?, doubles("frame", 5)?, doubles("constant", 1)?);
    let (log_density, map, potential) = (
        floats("log_density", 3 * n)?,
        floats("map", 2 * n)?,
        floats("potential", n)?,
    );
    let slices = (0..count).map(|k| {
        let plane = |c: usize| log_density[(3 * k + c) * n..(3 * k + c + 1) * n].to_vec();
        let f = &frame[5 * k..5 * k + 5];
        MappedSlice {
            wo: [wo[3 * k], wo[3 * k + 1], wo[3 * k + 2]],
            frame: Frame {
                x: f[0],
                y: f[1],
                shear: f[2],
                b: [f[3], f[4]],
            },
            table: SliceTable {
                cells: CELLS,
                log_density: [plane(0), plane(1), plane(2)],
            },
            map: map[2 * k * n..2 * (k + 1) * n]
                .chunks_exact(2)
                .map(|p| [p[0], p[1]])
                .collect(),
            potential: match potential[k * n].is_nan() {
                true => Vec::new(),
                false => potential[k * n..(k + 1) * n].to_vec(),
            },
            constant: constant[k],
        }
    });
    Ok(Some(slices.collect()))
}
