//! A query and the three networks of one material: the query's numbers, the lengths of the first two files, the files.

#![no_main]

use bake_runtime::{BakedMaterial, Network};
use bake_runtime_fuzz::mutation;
use bake_runtime_fuzz::queries::{QUERY_BYTES, Query, answer};
use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};

/// The query and the three files in `bytes`.
fn split(bytes: &[u8]) -> Option<(&[u8; QUERY_BYTES], [&[u8]; 3])> {
    let (query, rest) = bytes.split_first_chunk()?;
    let (lengths, rest) = rest.split_first_chunk::<4>()?;
    let [first, second] = [[lengths[0], lengths[1]], [lengths[2], lengths[3]]].map(u16::from_le_bytes);
    let (sample, rest) = rest.split_at_checked(first.into())?;
    let (eval, pdf) = rest.split_at_checked(second.into())?;
    Some((query, [sample, eval, pdf]))
}

fuzz_target!(|bytes: &[u8]| {
    let Some((query, files)) = split(bytes) else {
        return;
    };
    let [Ok(sample), Ok(eval), Ok(pdf)] = files.map(Network::from_bytes) else {
        return;
    };
    let [ordinary, horizon, nan] = Query::ALL;
    let queries = [ordinary, Query::read(query), nan, horizon];
    // Those that do not belong together are refused.
    answer(&BakedMaterial { sample, eval, pdf }, &queries).unwrap_or_default();
});

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    let mutate = |data: &mut [u8], size: usize| {
        let room = data.len();
        fuzzer_mutate(data, size, room)
    };
    let Some((query, files)) = split(&data[..size]).filter(|_| !seed.is_multiple_of(5)) else {
        return fuzzer_mutate(data, size, max_size);
    };
    let (mut query, mut files) = (*query, files.map(<[u8]>::to_vec));
    match (seed / 5 % 4) as usize {
        3 => drop(mutate(&mut query, QUERY_BYTES)),
        i => {
            let room = files[i].len() + (max_size - size);
            files[i] = mutation::network(&files[i], room.min(u16::MAX.into()), seed / 20, &mutate);
        }
    }
    let lengths = [0, 1].map(|i: usize| (files[i].len() as u16).to_le_bytes());
    let other = [&query, lengths.as_flattened(), &files.concat()].concat();
    let length = other.len().min(max_size);
    data[..length].copy_from_slice(&other[..length]);
    length
});
