//! Databases of every family and their pictures: one chart, two charts, and maps on the disk.

use crate::program::Studio;
use crate::slices_file::SlicesFile;
use crate::{METAL, OUT, PLASTIC, json, maps, shards, studio};
use bake_scenes::grey_picture::read_grey;
use serde_json::Value;
use std::f64::consts::FRAC_1_PI;

/// Slices of a database.
const COUNT: usize = 3;

/// Makes a database of `material` and draws its first and last entry; what was said of the two.
fn made_and_seen(studio: &Studio, material: &str, more: &[&str]) -> [Value; 2] {
    let report = json(maps(studio, material, COUNT, &[more, &["--json"]].concat()));
    assert_eq!(
        (&report["slices"], &report["computed"]),
        (&COUNT.into(), &COUNT.into())
    );
    assert_eq!(report["fallback_percent"], 0.0);
    assert_eq!(shards(studio).len(), 1);
    let last = (COUNT - 1).to_string();
    let indices = format!("0,{last}");
    let viewed = json(studio.bake(&["maps", material, "--out", OUT, "--view", &indices, "--json"]));
    let viewed = viewed.as_array().expect("a list of entries").clone();
    for (entry, index) in viewed.iter().zip([0, COUNT - 1]) {
        assert_eq!(entry["index"], index);
        assert_eq!(entry["fallback"], false);
        assert!((0.0..90.0).contains(&entry["theta"].as_f64().expect("a number")));
        let name = entry["picture"].as_str().expect("a path");
        assert_eq!(name, format!("{OUT}/entry-{index:05}.png"));
        let picture = read_grey(&studio.path(name)).expect("a picture");
        let [min, max] =
            [f64::min, f64::max].map(|f| picture.values.iter().copied().reduce(f).expect("pixels"));
        assert!(min < max, "the picture is even");
    }
    viewed.try_into().expect("two entries")
}

#[test]
fn one_chart() {
    for entry in made_and_seen(&studio(), METAL, &[]) {
        assert_eq!(entry["charts"], 1);
        assert_eq!(entry["parameters"], Value::Array(Vec::new()));
    }
}

#[test]
fn two_charts() {
    for entry in made_and_seen(&studio(), PLASTIC, &[]) {
        assert_eq!(entry["charts"], 2);
        assert_eq!(entry["parameters"][0][0], "roughness");
        let roughness = entry["parameters"][0][1].as_f64().expect("a number");
        assert!((0.2..=0.4).contains(&roughness), "{roughness}");
    }
}

#[test]
fn maps_on_the_disk() {
    for entry in made_and_seen(&studio(), PLASTIC, &["--solver", "marginal"]) {
        assert_eq!(entry["charts"], 1);
    }
}

#[test]
fn layered() {
    let studio = studio();
    let text = "family = \"layered\"\nalpha = { min = 0.1, max = 0.5 }\nsigma_t = 0.8\nalbedo = [0.9, 0.6, 0.3]\nbase = [0.8, 0.5, 0.2]\n";
    std::fs::write(studio.path("varnish.toml"), text).expect("it can be written");
    for entry in made_and_seen(&studio, "varnish.toml", &[]) {
        assert_eq!(entry["parameters"][0][0], "alpha");
    }
}

#[test]
fn imported() {
    let studio = studio();
    let f = |[gloss, theta]: [f64; 2], [x, y, _]: [f64; 3]| {
        [(1.0 + gloss) * (2.0 - x), (1.0 + theta / 90.0) * (2.0 + y), 3.0].map(|f| 0.1 * FRAC_1_PI * f)
    };
    SlicesFile::isotropic("gloss", &[0.0, 1.0], &[0.0, 45.0, 85.0], 24, f)
        .write(&studio.path("felt.safetensors"));
    let text = "family = \"imported\"\nfile = \"felt.safetensors\"\ngloss = { min = 0.2, max = 0.8 }\n";
    std::fs::write(studio.path("felt.toml"), text).expect("it can be written");
    for entry in made_and_seen(&studio, "felt.toml", &[]) {
        assert_eq!(
            (&entry["charts"], &entry["parameters"][0][0]),
            (&1.into(), &"gloss".into())
        );
    }
}
