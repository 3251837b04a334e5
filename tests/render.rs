//! The baked vase looks like the reference: unbiased in every tile, and no noisier at equal samples.

use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::{Backend, BakedMaterial};
use bake_scenes::metrics::{relmse, tile_differences};
use bake_scenes::{Estimator, Image, Method, RenderSettings, Scene, load_scene, render};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

/// Side of the compared tiles, pixels.
const TILE: usize = 32;
/// Largest systematic difference of a tile's mean.
const TILE_LIMIT: f64 = 0.01;
/// Standard errors allowed on top: 80 tiles × 3 channels exceed 4.5 by chance once in 600 runs.
const SIGMAS: f64 = 4.5;
/// Samples per pixel at which tiles are compared, and at which noise is.
const HIGH_SPP: u64 = 256;
const LOW_SPP: u64 = 64;

struct Vase {
    scene: Scene,
    material: BakedMaterial,
}

impl Vase {
    fn load() -> Vase {
        let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
        Vase {
            scene: load_scene(&scenes.join("vase")).expect("the shipped scene loads"),
            material: BakedMaterial::load(&scenes.join("materials/vase")).expect("the shipped vase loads"),
        }
    }

    fn render(&self, method: Method, spp: u64, seed: u64) -> Image {
        let settings = RenderSettings {
            method,
            spp,
            sample_offset: 0,
            seed,
        };
        let backend = |_: &str| -> bake_runtime::Result<Arc<dyn Backend>> {
            Ok(Arc::new(NativeBackend::new(&self.material, Tier::best())?))
        };
        render(
            &self.scene,
            &settings,
            &backend,
            &|_, _| ControlFlow::Continue(()),
        )
        .expect("nothing cancels it")
    }
}

#[test]
fn tiles_agree_and_baked_is_no_noisier() {
    let vase = Vase::load();
    let reference = vase.render(Method::Reference, HIGH_SPP, 11);
    let baked = vase.render(Method::Baked(Estimator::Exact), HIGH_SPP, 12);
    assert_eq!((reference.non_finite, baked.non_finite), (0, 0));
    for tile in tile_differences(&baked, &reference, TILE).expect("equal sizes") {
        for c in 0..3 {
            let allowed = TILE_LIMIT + SIGMAS * tile.standard_error[c];
            assert!(tile.relative[c].abs() <= allowed, "{tile:?}");
        }
    }
    // Each method is judged by the other's converged picture as well as its own, so neither is favoured.
    let mut converged = reference.clone();
    converged.merge(&baked).expect("equal sizes");
    let error = |method: Method| {
        let images = [21, 22].map(|seed| vase.render(method, LOW_SPP, seed));
        images
            .iter()
            .map(|i| relmse(i, &converged).expect("equal sizes"))
            .sum::<f64>()
            / 2.0
    };
    let (walk, map) = (error(Method::Reference), error(Method::Baked(Estimator::Exact)));
    assert!(
        map <= walk,
        "relmse at {LOW_SPP} spp: baked {map}, reference {walk}"
    );
}
