//! Scene and material files: the shipped ones load, and every mistake is one sentence naming file and key.

use bake_runtime::{Family, Material, Scalar, Setting};
use bake_scenes::{Scene, load_material, load_scene};
use std::fs;
use std::path::{Path, PathBuf};

const VASE: &str = include_str!("../vase/scene.toml");
const GOLD: &str = include_str!("../materials/vase.toml");

/// A copy of the shipped files with one text replaced in each.
struct Copy {
    folder: tempfile::TempDir,
}

impl Copy {
    fn new(scene: [&str; 2], material: [&str; 2]) -> Copy {
        let folder = tempfile::tempdir().unwrap();
        for (path, text, [old, new]) in [
            ("vase/scene.toml", VASE, scene),
            ("materials/vase.toml", GOLD, material),
        ] {
            assert!(text.contains(old), "{old} is not in {path}");
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text.replacen(old, new, 1)).unwrap();
        }
        Copy { folder }
    }

    fn scene(&self) -> PathBuf {
        self.folder.path().join("vase")
    }

    fn material(&self) -> PathBuf {
        self.folder.path().join("materials/vase.toml")
    }
}

fn assert_names(error: &str, file: &str, parts: &[&str]) {
    assert!(!error.contains('\n'), "more than one line: {error}");
    for part in parts.iter().chain([&file]) {
        assert!(error.contains(part), "`{part}` is not in: {error}");
    }
}

#[test]
fn vase_loads() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("vase");
    let by_folder: Scene = load_scene(&folder).unwrap();
    let by_file = load_scene(&folder.join("scene.toml")).unwrap();
    assert_eq!((by_folder.name.as_str(), by_file.name.as_str()), ("vase", "vase"));
    assert_eq!(
        (by_folder.width, by_folder.height, by_folder.max_depth),
        (256, 320, 6)
    );
    let expected = Material::fixed(
        "vase",
        Family::Conductor,
        &[("alpha", &[0.3, 0.1]), ("reflectance", &[1.0, 0.782, 0.344])],
    )
    .unwrap();
    assert_eq!(by_folder.materials().collect::<Vec<_>>(), [&expected]);
}

#[test]
fn free_ranges_and_whole_numbers_load() {
    let copy = Copy::new(
        ["", ""],
        ["alpha = [0.3, 0.1]", "alpha = [{ min = 0.01, max = 1 }, 1]"],
    );
    let material = load_material(&copy.material()).unwrap();
    assert_eq!(
        material.get("alpha"),
        Some(&Setting::Numbers(vec![
            Scalar::Free { min: 0.01, max: 1.0 },
            Scalar::Fixed(1.0)
        ]))
    );
}

#[test]
fn the_wide_domains_load() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("materials");
    for (name, family, free) in [
        ("conductor", Family::Conductor, 5),
        ("layered", Family::Layered, 6),
        ("principled", Family::Principled, 5),
    ] {
        let path = folder.join(name).with_extension("toml");
        let material = load_material(&path).unwrap();
        assert_eq!((material.name.as_str(), material.family), (name, family));
        assert_eq!(material.free().len(), free, "{name}");
        assert!(material.middle().free().is_empty());
        // The files explain every parameter that may be given.
        let text = fs::read_to_string(path).unwrap();
        for parameter in family.parameters() {
            assert!(
                text.contains(&format!("{} = ", parameter.name)),
                "{name} hides {}",
                parameter.name
            );
        }
    }
}

/// A material file of its own, with everything that was found wrong with it.
fn load_text(text: &str) -> Result<Material, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sample.toml");
    fs::write(&path, text).unwrap();
    load_material(&path).map_err(|error| {
        assert_names(&error.to_string(), "sample.toml", &[]);
        error.to_string()
    })
}

#[test]
fn defaults_presets_and_files_load() {
    let plastic = load_text("family = \"principled\"\nroughness = { min = 0.1, max = 1 }\n").unwrap();
    assert_eq!(
        plastic.get("specular"),
        Some(&Setting::Numbers(vec![Scalar::Fixed(0.5)]))
    );
    assert_eq!(plastic.free(), [("roughness".to_string(), 0.1, 1.0)]);
    let copper = load_text("family = \"conductor\"\nalpha = [0.1, 0.1]\nior = \"CU\"\n").unwrap();
    let table = "family = \"conductor\"\nalpha = [0.1, 0.1]\nior.eta = [0.201005, 0.92375, 1.102215]\n\
                 ior.k = [3.913262, 2.453045, 2.14209]\n";
    assert_eq!(copper, load_text(table).unwrap());
    // Files lie beside the material file; what else the table has, its own file knows.
    let felt = "family = \"imported\"\nfile = \"slices/felt.safetensors\"\nwear = { min = 0, max = 0.5 }\n";
    let felt = load_text(felt).unwrap();
    let Some(Setting::File(file)) = felt.get("file") else {
        panic!("{felt:?}");
    };
    assert!(
        file.is_absolute() && file.ends_with("slices/felt.safetensors"),
        "{}",
        file.display()
    );
    assert_eq!(felt.free(), [("wear".to_string(), 0.0, 0.5)]);
}

#[test]
fn mistakes_in_every_family_are_named() {
    let coat = "family = \"layered\"\nalpha = 0.1\nsigma_t = 1\nalbedo = [1, 1, 1]\nbase = [0.5, 0.5, 0.5]\n";
    assert!(load_text(coat).is_ok());
    let metal = "family = \"conductor\"\nalpha = [0.1, 0.1]\n";
    let plastic = "family = \"principled\"\n";
    let cases: [(String, &[&str]); 18] = [
        (
            coat.replace("alpha = 0.1\n", ""),
            &["`alpha`", "missing field", "a number in 0.0001..1"],
        ),
        (
            coat.replace("alpha = 0.1", "alpha = [0.1, 0.1]"),
            &["`alpha`", "is [0.1, 0.1]", "a number or a range"],
        ),
        (
            coat.replace("sigma_t", "sigma"),
            &["`sigma`", "unknown field", "`sigma_t`"],
        ),
        (
            coat.replace("sigma_t = 1", "sigma_t = 101"),
            &["`sigma_t`", "is 101", "0..100"],
        ),
        (coat.replace("[1, 1, 1]", "1"), &["`albedo`", "is 1,", "length 3"]),
        (
            coat.replace("[1, 1, 1]", "[1, 1, 1.5]"),
            &["`albedo[2]`", "is 1.5", "0..1"],
        ),
        (format!("{coat}g = 1\n"), &["`g`", "is 1,", "-0.99..0.99"]),
        (
            format!("{coat}eta = {{ min = 0.4, max = 2 }}\n"),
            &["`eta`", "is 0.4", "0.5..4"],
        ),
        (
            format!("{plastic}metallic = \"very\"\n"),
            &["`metallic`", "\"very\"", "a number or a range"],
        ),
        (format!("{plastic}metallic = true\n"), &["`metallic`", "is true"]),
        (
            format!("{plastic}roughnes = 0.1\n"),
            &["`roughnes`", "unknown field", "`roughness`"],
        ),
        (
            format!("{plastic}metallic = {{ min = 1, max = 0 }}\n"),
            &["`metallic`", "min 1 > max 0", "swap"],
        ),
        (metal.into(), &["`reflectance`", "missing field", "`ior`"]),
        (
            format!("{metal}ior = \"brass\"\n"),
            &["`ior`", "\"brass\"", "gold (Au)"],
        ),
        (
            format!("{metal}ior = \"gold\"\nreflectance = [1, 1, 1]\n"),
            &["`reflectance`", "one of the two"],
        ),
        (
            format!("{metal}ior = {{ min = 1, max = 2 }}\n"),
            &["`ior.eta`", "missing field"],
        ),
        (
            "family = \"imported\"\n".into(),
            &["`file`", "missing field", "name of a file"],
        ),
        (
            "family = \"imported\"\nfile = 3\n".into(),
            &["`file`", "is 3", "name of a file"],
        ),
    ];
    for (text, parts) in cases {
        let error = load_text(&text).expect_err(&text);
        assert_names(&error, "sample.toml", parts);
    }
}

#[test]
fn material_mistakes_are_named() {
    let alpha = "alpha = [0.3, 0.1]";
    let cases: [(&str, &str, &[&str]); 13] = [
        ("family = ", "colour = 1\nfamily = ", &["unknown field", "colour"]),
        (
            "family = \"conductor\"",
            "family = \"plastic\"",
            &["family", "plastic", "conductor"],
        ),
        (alpha, "", &["missing field", "alpha"]),
        (
            alpha,
            "alpha = [0.3, \"shiny\"]",
            &["alpha[1]", "shiny", "a number or a range"],
        ),
        (alpha, "alpha = 0.3", &["alpha", "0.3"]),
        (alpha, "alpha = [0.3]", &["alpha", "length"]),
        (alpha, "alpha = [0.0, 0.1]", &["alpha[0]", "is 0"]),
        (alpha, "alpha = [0.3, 1.5]", &["alpha[1]", "is 1.5"]),
        (alpha, "alpha = [nan, 0.1]", &["alpha[0]", "NaN"]),
        (
            alpha,
            "alpha = [{ min = 0.5, max = 0.2 }, 0.1]",
            &["alpha[0]", "min 0.5 > max 0.2"],
        ),
        (alpha, "alpha = [{ min = 0.5 }, 0.1]", &["alpha[0]", "max"]),
        (
            alpha,
            "alpha = [{ min = 0.1, max = 0.2, step = 1 }, 0.1]",
            &["alpha[0]", "step"],
        ),
        (alpha, "alpha = [0.3, ", &["not valid TOML"]),
    ];
    for (old, new, parts) in cases {
        let copy = Copy::new(["", ""], [old, new]);
        let error = load_material(&copy.material()).expect_err(new).to_string();
        assert_names(&error, "vase.toml", parts);
        // The same mistake found through the scene names the material's file too.
        let error = load_scene(&copy.scene()).err().expect(new).to_string();
        assert_names(&error, "vase.toml", parts);
    }
}

#[test]
fn scene_mistakes_are_named() {
    let sky = "[environment.sky]";
    let cases: [(&str, &str, &[&str]); 20] = [
        (
            "width = 256",
            "widht = 256",
            &["picture", "unknown field", "widht"],
        ),
        ("width = 256", "width = -3", &["picture.width", "-3"]),
        ("width = 256", "width = 0", &["picture.width", "is 0"]),
        (
            "max_depth = 6",
            "max_depth = 1000",
            &["picture.max_depth", "1000"],
        ),
        (
            "exposure = 0.0",
            "exposure = inf",
            &["picture.exposure", "finite"],
        ),
        ("fov = 18.6", "fov = 180", &["camera.fov", "180"]),
        (
            "position = [0.0, 2.5, 7.6]",
            "position = [0.0, nan, 7.6]",
            &["camera.position"],
        ),
        (
            "position = [0.0, 2.5, 7.6]",
            "position = [0.0, 2.5, 0.0]",
            &["camera.target"],
        ),
        (
            sky,
            "[environment.skies]",
            &["environment", "unknown field", "skies"],
        ),
        (
            sky,
            "[environment]\nfile = \"a.exr\"\n[environment.sky]",
            &["environment", "either `file`, or `sky`"],
        ),
        (
            "horizon = [0.09, 0.093, 0.104]",
            "horizon = [-1.0, 0.0, 0.0]",
            &["environment.sky.horizon", "negative"],
        ),
        (
            "elevation = 34.0",
            "elevation = 90.0",
            &["environment.softbox[0].elevation", "90"],
        ),
        (
            "size = [20.0, 76.0]",
            "size = [0.0, 76.0]",
            &["environment.softbox[1].size"],
        ),
        (
            "softness = 0.4",
            "softness = nan",
            &["environment.softbox[1].softness", "NaN"],
        ),
        (
            "radiance = [4.6",
            "radiance = [nan",
            &["environment.softbox[1].radiance", "NaN"],
        ),
        (
            "material = \"vase\"",
            "material = \"lead\"",
            &["revolution[0].material", "lead.toml"],
        ),
        (
            "grain = \"profile\"",
            "grain = \"oak\"",
            &["revolution[0].grain", "oak"],
        ),
        (
            "[0.36, 0.002], [0.36, 0.002]",
            "[-0.36, 0.002]",
            &["revolution[0].profile[1]", "radius"],
        ),
        ("radius = 1.75", "radius = 0", &["ground[0].radius", "positive"]),
        ("albedo = [0.45", "albedo = [1.45", &["ground[0].albedo", "1.45"]),
    ];
    for (old, new, parts) in cases {
        let copy = Copy::new([old, new], ["", ""]);
        let error = load_scene(&copy.scene()).err().expect(new).to_string();
        assert_names(&error, "scene.toml", parts);
    }
}

#[test]
fn missing_and_damaged_files_are_named() {
    let copy = Copy::new(["", ""], ["", ""]);
    let nowhere = copy.folder.path().join("nowhere");
    assert_names(&load_scene(&nowhere).err().unwrap().to_string(), "nowhere", &[]);
    assert_names(&load_material(&nowhere).unwrap_err().to_string(), "nowhere", &[]);
    // A scene lit by a file: missing, then not an EXR.
    let cut = VASE.find("# Light comes").unwrap()..VASE.find("# Turned objects").unwrap();
    let lit = VASE.replace(&VASE[cut], "[environment]\nfile = \"studio.exr\"\n");
    fs::write(copy.scene().join("scene.toml"), lit).unwrap();
    let error = load_scene(&copy.scene()).err().unwrap().to_string();
    assert_names(&error, "scene.toml", &["environment.file", "studio.exr"]);
    fs::write(copy.scene().join("studio.exr"), "not an image").unwrap();
    let error = load_scene(&copy.scene()).err().unwrap().to_string();
    assert_names(&error, "studio.exr", &["not an image this program can use"]);
}

#[test]
fn environment_file_lights_a_scene() {
    let copy = Copy::new(["", ""], ["", ""]);
    let cut = VASE.find("# Light comes").unwrap()..VASE.find("# Turned objects").unwrap();
    let lit = VASE.replace(&VASE[cut], "[environment]\nfile = \"map.exr\"\n");
    fs::write(copy.scene().join("scene.toml"), lit).unwrap();
    let mut map = bake_scenes::Image::new(8, 4);
    map.rgb[..8].fill([2.0, 1.0, 0.5]);
    bake_scenes::exr_file::write(&copy.scene().join("map.exr"), &map).unwrap();
    let environment = load_scene(&copy.scene()).unwrap().environment;
    assert_eq!(
        environment.radiance(glam::Vec3::Y),
        glam::Vec3::new(2.0, 1.0, 0.5)
    );
    assert_eq!(environment.radiance(glam::Vec3::NEG_Y), glam::Vec3::ZERO);
}
