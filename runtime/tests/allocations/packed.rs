//! What packed networks keep of the memory, and that queries take none.

use crate::{kept, peak};
use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::{Backend, BakedMaterial, Points, Role};
use std::path::{Path, PathBuf};

/// Memory that packed networks may keep, as a multiple of their files.
const FILES_MAX: f64 = 2.0;
/// The same of what a material with bound parameters keeps for itself: biases, without weights.
const BOUND_MAX: f64 = 0.5;

/// Folders of the materials that ship.
fn shipped() -> Vec<PathBuf> {
    let materials = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/materials");
    let entries = std::fs::read_dir(materials).expect("materials are part of the tree");
    let folders = entries.map(|entry| entry.expect("the folder can be read").path());
    let folders: Vec<PathBuf> = folders
        .filter(|folder| folder.join("sample.safetensors").is_file())
        .collect();
    assert!(!folders.is_empty(), "some materials ship with their networks");
    folders
}

/// Every material that ships keeps no more than [`FILES_MAX`] times its files, on every tier.
pub fn shipped_materials() {
    for folder in shipped() {
        let material = BakedMaterial::load(&folder).expect("it ships");
        let files = Role::ALL.map(|role| {
            let path = folder.join(role.name()).with_extension("safetensors");
            path.metadata().expect("it was just read").len()
        });
        let files = files.iter().sum::<u64>() as f64;
        let free = material.sample.spec.material.free().len();
        for tier in Tier::available() {
            let what = format!("{} on {}", folder.display(), tier.name());
            let (packed, backend) = kept(|| NativeBackend::new(&material, tier).expect("it ships"));
            let packed = packed as f64;
            // Less than half would mean that something is not counted.
            assert!(
                packed <= FILES_MAX * files && packed > 0.5 * files,
                "{what}: {packed} bytes for files of {files}"
            );
            let (own, _bound) = kept(|| backend.bind(&vec![Some(0.5); free]).expect("finite values"));
            assert!((own as f64) < BOUND_MAX * files, "{what}, bound: {own} bytes");
        }
    }
}

/// After a thread's first queries no others allocate, however many they are.
pub fn queries() {
    for folder in shipped() {
        let material = BakedMaterial::load(&folder).expect("it ships");
        let values = vec![[0.5f32]; material.sample.spec.material.free().len()];
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
                let (taken, done) = peak(|| {
                    backend.sample_learned(points, [&u, &u], [a, b, c], [d, e, f])?;
                    backend.sample_jacobian(points, [&u, &u], [a, b, c], d)?;
                    backend.sample_mixture(points, [&u, &u], [a, b, c], d)?;
                    backend.eval(points, [&x, &y, &z], [a, b, c])?;
                    backend.pdf(points, [&x, &y, &z], a)
                });
                assert!(done.is_ok());
                assert!(
                    round == 0 || taken == 0,
                    "{} on {}, {count} queries: {taken} bytes",
                    folder.display(),
                    tier.name()
                );
            }
        }
    }
}
