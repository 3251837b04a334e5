//! A table of slices.

#![no_main]

use bake_runtime::Rng;
use bake_runtime::bsdf::{Bsdf, direction};
use bake_runtime::imported::ImportedTable;
use bake_runtime_fuzz::mutation;
use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};
use std::path::Path;
use std::sync::Arc;

fuzz_target!(|bytes: &[u8]| {
    let Ok(table) = ImportedTable::from_bytes(bytes, Path::new("table.safetensors")) else {
        return;
    };
    let middle: Vec<f64> = table
        .ranges()
        .iter()
        .map(|[low, high]| 0.5 * low + 0.5 * high)
        .collect();
    let bsdf = Arc::new(table).bind(&middle).expect("in range");
    let rng = &mut Rng::new(&[0]);
    for wo in [
        direction(0.0, 0.0),
        direction(75.0, 200.0),
        direction(89.99, -10.0),
    ] {
        let wi = direction(40.0, 20.0);
        assert!(bsdf.eval(wo, wi, rng).is_finite());
        assert!(bsdf.pdf(wo, wi).is_finite());
        if let Some(drawn) = bsdf.sample(wo, [0.3, 0.6], rng) {
            assert!(drawn.wi.is_finite() && drawn.weight.is_finite());
        }
    }
});

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    let mutate = |data: &mut [u8], size: usize| {
        let room = data.len();
        fuzzer_mutate(data, size, room)
    };
    // Its files have no specification: this changes header, data or both.
    let other = mutation::network(&data[..size], max_size, seed % 4, &mutate);
    let length = other.len().min(max_size);
    data[..length].copy_from_slice(&other[..length]);
    length
});
