//! What stands before the tensors: the header's length, its JSON, and what it says of the rest.

use crate::file::{File, file_of, refused};
use bake_runtime::{Network, Role};
use std::collections::HashMap;

const BROKEN: &str = "not a whole safetensors file";

#[test]
fn the_unspoiled_files_are_read_and_come_back_byte_by_byte() {
    for role in Role::ALL {
        let network = Network::from_bytes(&File::sound(role).bytes()).expect("a sound file");
        let bytes = network.to_bytes();
        assert_eq!(Network::from_bytes(&bytes), Ok(network.clone()));
        assert_eq!(network.to_bytes(), bytes);
    }
}

#[test]
fn every_truncation_and_a_byte_too_many() {
    let bytes = File::sound(Role::Sample).bytes();
    for end in 0..bytes.len() {
        refused(&bytes[..end], &[BROKEN]);
    }
    refused(&[&bytes[..], &[0]].concat(), &[BROKEN]);
}

#[test]
fn lengths_that_are_not_the_headers() {
    let bytes = File::sound(Role::Eval).bytes();
    let length = u64::from_le_bytes(*bytes.first_chunk().expect("a length"));
    let left = bytes.len() as u64 - 8;
    let others = [
        0,
        1,
        length - 1,
        length + 1,
        left,
        left + 1,
        1 << 40,
        u64::MAX - 7,
        u64::MAX,
    ];
    for other in others {
        let mut changed = bytes.clone();
        changed[..8].copy_from_slice(&other.to_le_bytes());
        refused(&changed, &[BROKEN]);
    }
    // Blanks are valid JSON before a header, however many.
    let long = [&b" ".repeat(1 << 20)[..], b"{}"].concat();
    refused(
        &file_of(&long, &[]),
        &["its header has 1048578 bytes, more than 131072"],
    );
}

#[test]
fn headers_that_are_no_json() {
    let deep = [b'['; 10_000];
    for header in [
        &b""[..],
        b"{",
        b"[]",
        b"null",
        b"{}{}",
        b"\xff\xfe",
        b"{\"a\":1e999}",
        b"{\"__metadata__\":{\"bake.spec\":1}}",
        &deep,
        &[b"{\"a\":", &deep[..]].concat(),
    ] {
        refused(&file_of(header, &[]), &[BROKEN]);
    }
}

#[test]
fn tensors_that_the_file_does_not_hold() {
    let header = |tensors: &[(String, u64, u64)]| {
        let entries = tensors.iter().enumerate().map(|(i, (shape, start, end))| {
            format!(r#""t{i}":{{"dtype":"U8","shape":{shape},"data_offsets":[{start},{end}]}}"#)
        });
        format!("{{{}}}", entries.collect::<Vec<_>>().join(","))
    };
    let one = |shape: &str, start: u64, end: u64| header(&[(shape.into(), start, end)]);
    for header in [
        one("[1000000000000]", 0, 1_000_000_000_000),
        one("[1000000000000]", 0, 4),
        one("[4294967296,4294967296]", 0, 4),
        one("[4]", 0, 8),
        one("[4]", 4, 8),
        one("[4]", 4, 0),
        one("[-4]", 0, 4),
        one("[2]", 0, 2),
        header(&[("[3]".into(), 0, 3), ("[3]".into(), 1, 4)]),
    ] {
        refused(&file_of(header.as_bytes(), &[0; 4]), &[BROKEN]);
    }
}

#[test]
fn lengths_whose_sum_is_no_number() {
    // Eight of the largest tensors that there are, and the rest up to 2⁶⁴ − 1: with the header that is too much for 64 bits.
    let largest = (1u64 << 61) - 1;
    let mut entries: Vec<_> = (0..8).map(|i| (largest, i * largest)).collect();
    entries.push((7, 8 * largest));
    let entries: Vec<String> = entries
        .into_iter()
        .enumerate()
        .map(|(i, (size, start))| {
            let end = start + size;
            format!(r#""t{i}":{{"dtype":"U8","shape":[{size}],"data_offsets":[{start},{end}]}}"#)
        })
        .collect();
    let header = format!("{{{}}}", entries.join(","));
    refused(
        &file_of(header.as_bytes(), &[]),
        &[
            BROKEN,
            "its tensors have 18446744073709551615 bytes, but 0 follow",
        ],
    );
}

#[test]
fn files_of_other_programs() {
    let file = File::sound(Role::Pdf);
    let reason = ["its metadata has no `bake.spec`, so another program wrote it"];
    refused(&file.bytes_with(HashMap::new()), &reason);
    let other = HashMap::from([("spec".to_string(), file.spec.to_string())]);
    refused(&file.bytes_with(other), &reason);
    refused(&file_of(b"{}", &[]), &reason);
}
