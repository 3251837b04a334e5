//! Many threads at once: one material gives the same bytes to all of them, and messages belong to threads.

use crate::support::{Batch, Material, last_error, refused};
use bake::BakeStatus;
use std::path::Path;
use std::sync::Barrier;

const THREADS: u64 = 8;
const COUNT: usize = 3000;

/// Bits of directions and weights.
fn answers(material: &Material, seed: u64) -> Vec<u32> {
    let mut batch = Batch::random(COUNT, material.free(), seed);
    batch.sample(material).expect("a valid batch");
    let values = batch.wi.iter().chain(&batch.color).flatten();
    values.map(|value| value.to_bits()).collect()
}

#[test]
fn threads_that_share_a_material_get_the_bytes_that_one_alone_gets() {
    let material = Material::shipped("conductor");
    let middle = vec![0.5; material.free()];
    let alone: Vec<_> = (0..THREADS).map(|seed| answers(&material, seed)).collect();
    let bound_alone = answers(&material.bind(&middle).expect("one value per parameter"), 1);
    let start = Barrier::new(THREADS as usize);
    std::thread::scope(|scope| {
        for (seed, alone) in (0..).zip(&alone) {
            let (material, start, middle, bound_alone) = (&material, &start, &middle, &bound_alone);
            scope.spawn(move || {
                start.wait();
                for _ in 0..5 {
                    assert!(answers(material, seed) == *alone, "thread {seed}");
                    let bound = material.bind(middle).expect("one value per parameter");
                    assert!(answers(&bound, 1) == *bound_alone, "thread {seed}, bound");
                }
            });
        }
    });
}

#[test]
fn a_material_may_be_freed_on_another_thread_than_it_was_loaded_on() {
    let material = Material::shipped("vase");
    let alone = answers(&material, 3);
    let elsewhere = std::thread::spawn(move || answers(&material, 3));
    assert!(elsewhere.join().expect("it does not panic") == alone);
}

#[test]
fn every_thread_has_its_own_message() {
    let fail = |name: &str| {
        let result = Material::load(Path::new(name), None);
        refused(result.map(drop), BakeStatus::Io, name);
    };
    fail("folder-of-the-first");
    let first = last_error();
    std::thread::scope(|scope| {
        let second = scope.spawn(|| {
            assert_eq!(last_error(), "", "nothing failed on this thread");
            fail("folder-of-the-second");
            last_error()
        });
        let second = second.join().expect("it does not panic");
        assert!(second.contains("folder-of-the-second"), "{second}");
    });
    assert_eq!(last_error(), first);
    drop(Material::shipped("vase"));
    assert_eq!(last_error(), first, "success keeps the message");
}
