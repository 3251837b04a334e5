//! What materials and queries take of the memory. One test, because the allocator counts for all threads.

mod loading;
mod packed;

use peak_alloc::PeakAlloc;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// The peak of what `work` allocates, bytes, and what it returns.
fn peak<T>(work: impl FnOnce() -> T) -> (usize, T) {
    let before = MEMORY.current_usage();
    MEMORY.reset_peak_usage();
    let result = work();
    (MEMORY.peak_usage() - before, result)
}

/// What `make` allocates and keeps, bytes, and what it returns.
fn kept<T>(make: impl FnOnce() -> T) -> (usize, T) {
    let before = MEMORY.current_usage();
    let result = make();
    (MEMORY.current_usage() - before, result)
}

#[test]
fn memory_is_what_the_file_justifies() {
    loading::hostile_headers();
    loading::hostile_specifications();
    loading::widest_networks();
    packed::shipped_materials();
    packed::queries();
}
