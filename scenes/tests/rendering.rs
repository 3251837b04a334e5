//! Pictures whose result is known: furnaces, Lambert's law, agreement of all methods, reproducibility.

mod common;
#[path = "../../tests/support/slices_file.rs"]
mod slices_file;

use bake_runtime::{Family, Material};
use bake_scenes::metrics::tile_differences;
use bake_scenes::{
    Environment, Error, Estimator, Image, Method, RenderSettings, Scene, Surface, load_material,
};
use common::{conductor, mean, plane, render, settings, sphere};
use glam::Vec3;
use slices_file::SlicesFile;
use std::f64::consts::FRAC_1_PI;
use std::ops::ControlFlow;
use std::path::Path;

const METHODS: [Method; 7] = [
    Method::Reference,
    Method::ReferenceRandom,
    Method::Vndf,
    Method::Cosine,
    Method::Baked(Estimator::Learned),
    Method::Baked(Estimator::Exact),
    Method::Baked(Estimator::ExactBaked),
];

/// Half the sky bright, so that directions matter: light from +x, little from elsewhere.
fn sided_environment() -> Environment {
    let texel = |i: usize| {
        if i % 8 < 4 {
            Vec3::new(1.5, 1.2, 1.0)
        } else {
            Vec3::splat(0.3)
        }
    };
    Environment::new(8, 4, (0..32).map(texel).collect())
}

fn metal_sphere(environment: Environment) -> Scene {
    sphere(
        Surface::Material(conductor([0.5, 0.25], [1.0; 3])),
        environment,
        32,
    )
}

/// Standard error of the picture's mean, all channels together, samples taken as independent.
fn standard_error(image: &Image) -> f64 {
    let variance: f64 = image.variance.iter().flatten().map(|v| f64::from(*v)).sum();
    // Channels of one sample move together: the mean of three has at most their mean variance.
    (variance / 3.0 / image.spp as f64).sqrt() / image.rgb.len() as f64
}

/// Standard errors that two means, or a mean and its truth, may differ by: 5 % false alarms in a million tests.
const SIGMAS: f64 = 5.5;

/// Share of a white sphere's light that comes from below its triangles but above its smooth normals, and is lost.
const FURNACE_TOL: f64 = 1e-3;

#[test]
fn white_diffuse_sphere_vanishes_in_a_furnace() {
    let scene = sphere(Surface::Diffuse(Vec3::ONE), Environment::constant(Vec3::ONE), 32);
    let image = render(&scene, &settings(Method::Reference, 64));
    let mut pixels = image.rgb.iter().zip(&image.albedo);
    assert!(
        pixels.all(|(rgb, albedo)| albedo[0] > 0.0 || *rgb == [1.0; 3]),
        "the furnace itself is 1"
    );
    let sphere = mean(&image, |o| o == 1.0);
    assert!(
        (sphere - 1.0).abs() < FURNACE_TOL + SIGMAS * standard_error(&image),
        "{sphere}"
    );
}

#[test]
fn plane_obeys_lambert() {
    let scene = plane(
        Surface::Diffuse(Vec3::new(0.5, 0.25, 0.75)),
        Environment::constant(Vec3::splat(2.0)),
        16,
    );
    let image = render(&scene, &settings(Method::Vndf, 256));
    // E = π·2, so radiance is albedo·2; 1 in the mean of the three channels.
    let plane = mean(&image, |_| true);
    assert!((plane - 1.0).abs() < SIGMAS * standard_error(&image), "{plane}");
    assert!(
        (f64::from(image.rgb[100][0]) - 1.0).abs() < 0.1,
        "{:?}",
        image.rgb[100]
    );
    assert_eq!(
        (image.albedo[0], image.normal[0]),
        ([0.5, 0.25, 0.75], [0.0, 1.0, 0.0])
    );
}

/// Energy that a white metal sphere may lose: light between the triangles' and the smooth horizon (256 sectors
/// differ by at most 0.7°), and what four reflections do not gather.
const FURNACE_LOSS: f64 = 4e-3;

#[test]
fn white_metal_sphere_vanishes_in_a_furnace_up_to_its_rim() {
    let scene = metal_sphere(Environment::constant(Vec3::ONE));
    let image = render(&scene, &settings(Method::Reference, 256));
    let sphere = mean(&image, |o| o == 1.0);
    assert!(
        (sphere - 1.0).abs() < FURNACE_LOSS + SIGMAS * standard_error(&image),
        "{sphere}"
    );
    // Pixels that a silhouette crosses are no darker than others: noise alone keeps single pixels from 1.
    let rim = image
        .rgb
        .iter()
        .zip(&image.albedo)
        .filter(|(_, a)| a[0] > 0.0 && a[0] < 1.0);
    let rim: Vec<f64> = rim.map(|(p, _)| f64::from(p[0])).collect();
    let mean = rim.iter().sum::<f64>() / rim.len() as f64;
    assert!(rim.len() > 50 && mean > 0.97, "{mean} over {} pixels", rim.len());
}

/// Standard error of the mean of a picture of order 1 above which the comparison would say too little.
const NOISE_MAX: f64 = 2e-3;

/// Asserts that every one of `methods` makes the picture that the reference's own walk makes.
fn agree_in_every_tile(scene: &Scene, methods: &[Method]) {
    let reference = render(scene, &settings(Method::Reference, 512));
    let name = scene.materials().next().map_or("", |material| &material.name);
    for method in methods {
        let other = render(
            scene,
            &RenderSettings {
                seed: 2,
                ..settings(*method, 256)
            },
        );
        // Tiles show what is wrong somewhere, the whole picture what is a little wrong everywhere.
        for side in [8, scene.width] {
            for tile in tile_differences(&other, &reference, side).unwrap() {
                for (relative, noise) in tile.relative.iter().zip(tile.standard_error) {
                    assert!(relative.abs() <= SIGMAS * noise, "{name}, {method:?}: {tile:?}");
                }
            }
        }
        let noise = standard_error(&other).hypot(standard_error(&reference));
        assert!(noise < NOISE_MAX, "{name}, {method:?}: {noise}");
    }
}

/// Whatever samples the material, the picture is the same: for baked methods with a pdf that is wrong.
#[test]
fn all_methods_agree_in_every_tile() {
    agree_in_every_tile(&metal_sphere(sided_environment()), &METHODS);
}

/// Methods of materials that are not baked.
const REFERENCE_METHODS: [Method; 4] = [
    Method::Reference,
    Method::ReferenceRandom,
    Method::Vndf,
    Method::Cosine,
];

/// A material of `family` with every parameter fixed.
fn fixed(family: Family, given: &[(&str, &[f64])]) -> Material {
    Material::fixed(family.name(), family, given).expect("valid parameters")
}

/// A table of a diffuse floor under a lobe about the mirror direction, and a material file beside it, in `folder`.
fn felt(folder: &Path) -> Material {
    /// Standard deviation of the lobe on the disk.
    const WIDTH: f64 = 0.4;
    let f = |[gloss, theta]: [f64; 2], [x, y, _]: [f64; 3]| {
        let away = (x + theta.to_radians().sin()).powi(2) + y * y;
        let lobe = gloss * (-0.5 * away / (WIDTH * WIDTH)).exp();
        [0.6, 0.4, 0.2].map(|floor| floor * FRAC_1_PI + 0.3 * lobe)
    };
    let thetas: Vec<f32> = (0..=8).map(|k| 11.0 * k as f32).collect();
    SlicesFile::isotropic("gloss", &[0.0, 1.0], &thetas, 32, f).write(&folder.join("felt.safetensors"));
    let file = folder.join("felt.toml");
    let text = "family = \"imported\"\nfile = \"felt.safetensors\"\ngloss = 0.7\n";
    std::fs::write(&file, text).expect("it can be written");
    load_material(&file).expect("a valid material")
}

#[test]
fn methods_of_every_family_agree_in_every_tile() {
    let varnish: [(&str, &[f64]); 5] = [
        ("alpha", &[0.3]),
        ("sigma_t", &[0.8]),
        ("albedo", &[0.9, 0.6, 0.3]),
        ("base", &[0.8, 0.5, 0.2]),
        ("g", &[0.5]),
    ];
    let paint: [(&str, &[f64]); 6] = [
        ("base_color", &[0.8, 0.4, 0.2]),
        ("metallic", &[0.2]),
        ("anisotropic", &[0.6]),
        ("sheen", &[0.8]),
        ("clearcoat", &[0.9]),
        ("flatness", &[0.4]),
    ];
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    for material in [
        fixed(Family::Layered, &varnish),
        fixed(Family::Principled, &paint),
        felt(folder.path()),
    ] {
        let scene = sphere(Surface::Material(material), sided_environment(), 32);
        agree_in_every_tile(&scene, &REFERENCE_METHODS);
    }
}

/// Without an interface and without absorption a slab returns all light, whatever scatters it: the sphere vanishes.
#[test]
fn white_layered_sphere_vanishes_in_a_furnace() {
    for g in [0.0, 0.7] {
        let white: [(&str, &[f64]); 6] = [
            ("alpha", &[0.2]),
            ("eta", &[1.0]),
            ("sigma_t", &[1.5]),
            ("albedo", &[1.0; 3]),
            ("base", &[1.0; 3]),
            ("g", &[g]),
        ];
        let scene = sphere(
            Surface::Material(fixed(Family::Layered, &white)),
            Environment::constant(Vec3::ONE),
            32,
        );
        for method in REFERENCE_METHODS {
            let image = render(&scene, &settings(method, 256));
            let sphere = mean(&image, |o| o == 1.0);
            let noise = standard_error(&image);
            assert!(
                (sphere - 1.0).abs() < FURNACE_LOSS + SIGMAS * noise && noise < NOISE_MAX,
                "g = {g}, {method:?}: {sphere} ± {noise}"
            );
        }
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    // Larger than a tile, not a multiple of it.
    let scene = sphere(
        Surface::Material(conductor([0.3, 0.1], [1.0, 0.8, 0.3])),
        sided_environment(),
        70,
    );
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        METHODS.map(|method| pool.install(|| render(&scene, &settings(method, 5))))
    };
    let (one, two) = (on(1), on(2));
    for (a, b) in one.iter().zip(&two) {
        assert!(a == b);
    }
    let other_seed = render(
        &scene,
        &RenderSettings {
            seed: 9,
            ..settings(METHODS[0], 5)
        },
    );
    assert!(other_seed.rgb != one[0].rgb);
}

/// Two f32 means of the same samples, summed in another order.
const MERGE_TOL: f32 = 1e-5;

#[test]
fn passes_continue_the_sequence() {
    let scene = metal_sphere(sided_environment());
    let whole = render(&scene, &settings(Method::Vndf, 24));
    let mut merged = Image::new(scene.width, scene.height);
    for (offset, spp) in [(0, 16), (16, 8)] {
        let pass = RenderSettings {
            sample_offset: offset,
            ..settings(Method::Vndf, spp)
        };
        merged.merge(&render(&scene, &pass)).unwrap();
    }
    assert_eq!((merged.spp, &merged.object), (24, &whole.object));
    for (a, b) in merged.rgb.iter().flatten().zip(whole.rgb.iter().flatten()) {
        assert!((a - b).abs() < MERGE_TOL * (1.0 + b), "{a} {b}");
    }
}

#[test]
fn cancelling_is_an_error_of_its_own() {
    let scene = plane(Surface::Diffuse(Vec3::ONE), sided_environment(), 40);
    let tick = |done: u64, total: u64| {
        assert!((1..=total).contains(&done) && total == 4 * 2);
        if done >= 3 {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    };
    let result = bake_scenes::render(
        &scene,
        &settings(Method::Reference, 8),
        &|_| unreachable!(),
        &tick,
    );
    assert!(matches!(result, Err(Error::Cancelled)));
}

#[test]
fn backend_errors_reach_the_caller() {
    let scene = metal_sphere(sided_environment());
    let refuse = |_: &str| Err(bake_runtime::Error::Tier("none"));
    let method = Method::Baked(Estimator::Exact);
    let result = bake_scenes::render(&scene, &settings(method, 1), &refuse, &|_, _| {
        ControlFlow::Continue(())
    });
    assert!(matches!(
        result,
        Err(Error::Runtime(bake_runtime::Error::Tier("none")))
    ));
}
