//! A network's file.

#![no_main]

use bake_runtime::Network;
use bake_runtime_fuzz::mutation;
use bake_runtime_fuzz::queries::{Query, answer, complete};
use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};

fuzz_target!(|bytes: &[u8]| {
    let Ok(network) = Network::from_bytes(bytes) else {
        return;
    };
    assert_eq!(Network::from_bytes(&network.to_bytes()), Ok(network.clone()));
    answer(&complete(network), &Query::ALL).expect("what loads can be packed");
});

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    let mutate = |data: &mut [u8], size: usize| {
        let room = data.len();
        fuzzer_mutate(data, size, room)
    };
    let other = mutation::network(&data[..size], max_size, seed, &mutate);
    let length = other.len().min(max_size);
    data[..length].copy_from_slice(&other[..length]);
    length
});
