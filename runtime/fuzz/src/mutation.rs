//! Mutations that know how a network's file is built, so that most of them come through the first checks.

use bake_runtime::network::parse_spec;
use bake_runtime::spec::SPEC_KEY;
use bake_runtime::{Dense, Network, NetworkSpec};
use serde_json::Value;

/// Bytes of the length that a safetensors file begins with.
const LENGTH_BYTES: usize = 8;

/// Changes of a specification that are tried until one is sound.
const TRIES: usize = 16;

/// Changes the first `.1` bytes of `.0` at random, up to `.0`'s whole length; their new number.
pub type Mutate<'a> = &'a dyn Fn(&mut [u8], usize) -> usize;

/// The header of a file and what follows it, as far as there is one.
pub fn split(file: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = file.split_first_chunk::<LENGTH_BYTES>()?;
    rest.split_at_checked(u64::from_le_bytes(*length).try_into().ok()?)
}

/// A file of this header.
pub fn join(header: &[u8], data: &[u8]) -> Vec<u8> {
    [&(header.len() as u64).to_le_bytes(), header, data].concat()
}

/// Another version of `file`, at most `room` bytes long where it can be; `seed` decides what stays in agreement.
pub fn network(file: &[u8], room: usize, seed: u32, mutate: Mutate) -> Vec<u8> {
    let changed = |part: &[u8], room: usize| {
        let mut buffer = part.to_vec();
        buffer.resize(room.max(part.len()).max(1), 0);
        let length = mutate(&mut buffer, part.len());
        buffer.truncate(length);
        buffer
    };
    let left = room.saturating_sub(file.len());
    match (seed % 8, split(file)) {
        (1, Some((header, data))) => join(&changed(header, header.len() + left), data),
        (2 | 3, Some((header, data))) => {
            let mut other = changed(data, data.len());
            other.resize(data.len(), 0);
            join(header, &other)
        }
        (4.., Some((header, data))) => {
            let json = spec_of(header).unwrap_or_default();
            let other = || {
                let json = changed(json.as_bytes(), json.len() + left / 2);
                let spec = parse_spec(str::from_utf8(&json).ok()?).ok()?;
                // Weights that are too many for the room would be cut off.
                (4 * spec.parameters() < room / 2).then_some(spec)
            };
            let spec = (0..TRIES).find_map(|_| other());
            spec.map_or_else(|| changed(file, room), |spec| with_weights(spec, data).to_bytes())
        }
        _ => changed(file, room),
    }
}

/// The text of the specification in `header`.
fn spec_of(header: &[u8]) -> Option<String> {
    let header: Value = serde_json::from_slice(header).ok()?;
    Some(header.get("__metadata__")?.get(SPEC_KEY)?.as_str()?.to_string())
}

/// A network of `spec` with the numbers in `data` again and again, as far as they are finite.
fn with_weights(spec: NetworkSpec, data: &[u8]) -> Network {
    let numbers: Vec<f32> = data
        .as_chunks()
        .0
        .iter()
        .map(|b| f32::from_le_bytes(*b))
        .collect();
    let mut endless = numbers
        .into_iter()
        .filter(|v| v.is_finite())
        .chain([0.5])
        .collect::<Vec<_>>()
        .into_iter()
        .cycle();
    let mut layers = |shapes: Vec<(usize, usize)>| {
        let layer = |(inputs, outputs): (usize, usize)| Dense {
            weight: endless.by_ref().take(inputs * outputs).collect(),
            bias: endless.by_ref().take(outputs).collect(),
            inputs,
            outputs,
        };
        shapes.into_iter().map(layer).collect::<Vec<_>>()
    };
    let frame = layers(spec.frame_layers());
    let net = layers(spec.layers());
    Network { spec, frame, net }
}
