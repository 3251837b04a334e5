//! What a material takes of the memory, and that queries take none: an allocator that counts.
#![expect(unsafe_code, reason = "an allocator is unsafe to implement")]

use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::{Backend, BakedMaterial, Points, Role};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::{Path, PathBuf};

/// The system's allocator, which counts what each thread takes and gives back.
struct Counting;

thread_local! {
    /// Bytes that this thread took and did not give back.
    static LIVE: Cell<isize> = const { Cell::new(0) };
    /// Times that this thread asked for memory.
    static CALLS: Cell<usize> = const { Cell::new(0) };
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

// SAFETY: everything is passed on to the system's allocator; cells without destructors live as long as their thread.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.set(CALLS.get() + 1);
        LIVE.set(LIVE.get() + layout.size() as isize);
        // SAFETY: the caller's promises are those that `System` asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        LIVE.set(LIVE.get() - layout.size() as isize);
        // SAFETY: `pointer` came from `System` with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Memory that packed networks may take, as a multiple of their files.
const FILES_MAX: f64 = 2.0;

/// Folders of the materials that ship.
fn shipped() -> Vec<PathBuf> {
    let materials = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/materials");
    let entries = std::fs::read_dir(materials).expect("materials are part of the tree");
    let folders = entries.map(|entry| entry.expect("the folder can be read").path());
    folders
        .filter(|folder| folder.join("sample.safetensors").is_file())
        .collect()
}

#[test]
fn a_packed_material_takes_no_more_than_twice_its_files() {
    let folders = shipped();
    assert!(!folders.is_empty());
    for folder in folders {
        let material = BakedMaterial::load(&folder).expect("it ships");
        let files = Role::ALL.map(|role| {
            let path = folder.join(role.name()).with_extension("safetensors");
            path.metadata().expect("it was just read").len()
        });
        let files: u64 = files.iter().sum();
        for tier in Tier::available() {
            let before = LIVE.get();
            let backend = NativeBackend::new(&material, tier).expect("it ships");
            let packed = (LIVE.get() - before) as f64;
            assert!(
                packed <= FILES_MAX * files as f64 && packed > 0.5 * files as f64,
                "{}: {packed} bytes for files of {files}",
                folder.display()
            );
            // Bound materials share the weights.
            let free = material.sample.spec.material.free().len();
            let before = LIVE.get();
            let bound = backend.bind(&vec![Some(0.5); free]).expect("finite values");
            let own = (LIVE.get() - before) as f64;
            assert!(own < 0.5 * files as f64, "{}: {own} bytes", folder.display());
            drop((backend, bound));
        }
    }
}

#[test]
fn queries_allocate_nothing_after_a_threads_first() {
    for folder in shipped() {
        let material = BakedMaterial::load(&folder).expect("it ships");
        let free = material.sample.spec.material.free().len();
        let values = vec![[0.5f32]; free];
        let params: Vec<&[f32]> = values.iter().map(|v| &v[..]).collect();
        for tier in Tier::available() {
            let backend = NativeBackend::new(&material, tier).expect("it ships");
            for (round, count) in [200, 200, 1, 3, 17, 1000].into_iter().enumerate() {
                let [x, y, z] = [0.0, 0.6, 0.8].map(|c| vec![c; count]);
                let u = vec![0.3; count];
                let mut out = vec![vec![0.0; count]; 6];
                let [a, b, c, d, e, f] = &mut out[..] else {
                    unreachable!("six of six");
                };
                let points = Points {
                    params: &params,
                    wo: [&x, &y, &z],
                };
                let before = CALLS.get();
                let done = [
                    backend.sample_learned(points, [&u, &u], [a, b, c], [d, e, f]),
                    backend.sample_jacobian(points, [&u, &u], [a, b, c], d),
                    backend.sample_mixture(points, [&u, &u], [a, b, c], d).map(|_| ()),
                    backend.eval(points, [&x, &y, &z], [a, b, c]),
                    backend.pdf(points, [&x, &y, &z], a),
                ];
                let calls = CALLS.get() - before;
                assert!(done.iter().all(Result::is_ok));
                assert!(
                    round == 0 || calls == 0,
                    "{} on {}, {count} queries: {calls} allocations",
                    folder.display(),
                    tier.name()
                );
            }
        }
    }
}
