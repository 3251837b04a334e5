//! `bake rivals` through the real program: the shipped vase beside a flow that is hardly trained and a fitted lobe, and
//! what is refused.

#[path = "support/complaint.rs"]
mod complaint;
#[path = "support/program.rs"]
mod program;

use bake_scenes::grey_picture::read_grey;
use bake_train::card::heldout::STRATA;
use complaint::complains;
use program::{SCENE, Studio, finish};
use serde_json::Value;
use std::path::Path;
use std::time::Duration;

/// Far more than the run takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(600);
/// The copy of the shipped networks in a [`Studio`].
const MODEL: &str = "baked";
/// Steps of the flow: some have no effect on a network that is warmed up over as many.
const STEPS: u64 = 120;
/// Smallest sides of a picture of a slice, its solved map and three samplers, in columns of at least this many pixels.
const TILE_MIN: usize = 128;

/// A studio with the shipped networks of the vase in [`MODEL`]; their card, which asks for as many slices as they learned
/// from, only if wanted.
fn studio(with_card: bool) -> Studio {
    let studio = Studio::new();
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/materials/vase");
    std::fs::create_dir(studio.path(MODEL)).expect("it can be written");
    let card = with_card.then_some("card.json");
    for file in ["sample.safetensors", "eval.safetensors", "pdf.safetensors"]
        .into_iter()
        .chain(card)
    {
        std::fs::copy(shipped.join(file), studio.path(MODEL).join(file))
            .expect("the vase is part of the tree");
    }
    studio
}

fn positive(row: &Value, pointer: &str) -> f64 {
    let found = row.pointer(pointer).and_then(Value::as_f64);
    let number = found.unwrap_or_else(|| panic!("{pointer} is no number in {row}"));
    assert!(number.is_finite() && number > 0.0, "{pointer}: {number} in {row}");
    number
}

#[test]
fn the_baked_vase_wins() {
    let studio = studio(false);
    let steps = STEPS.to_string();
    let arguments = [
        "rivals", MODEL, "--quick", "--steps", &steps, "--out", "held", "--json",
    ];
    let child = studio.bake(&arguments).spawn().expect("the program starts");
    let output = finish(child, PATIENCE);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");

    let file = std::fs::read(studio.path("held/rivals.json")).expect("a table");
    let report: Value = serde_json::from_slice(&file).expect("JSON");
    let printed: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(report, printed);
    assert_eq!(report["material"], "vase");
    assert_eq!(report["flow"]["steps"], STEPS);
    let rows = report["rows"].as_array().expect("a list");
    let names: Vec<&str> = rows.iter().filter_map(|row| row["sampler"].as_str()).collect();
    assert_eq!(names, ["warp", "realnvp", "blinn_phong"]);
    for row in rows {
        positive(row, "/parameters");
        for stratum in STRATA {
            let at = |key: &str| positive(row, &format!("/strata/{stratum}/{key}"));
            let (mean, worst) = (at("binning_l1/mean"), at("binning_l1/worst"));
            assert!(
                at("binning_floor") < mean && mean <= worst && worst <= 2.0,
                "{row}"
            );
            assert!(at("weight_relvar/mean") <= at("weight_relvar/worst"), "{row}");
            at("weight_max");
        }
        positive(row, "/albedo_bias/se");
    }
    let [warp, flow, lobe] = &rows[..] else {
        unreachable!("they were counted");
    };
    for row in [warp, flow] {
        assert!(
            positive(row, "/macs") <= positive(row, "/macs_with_density"),
            "{row}"
        );
    }
    positive(flow, "/training_minutes");
    // As near as whole couplings come.
    let size = positive(flow, "/parameters") / positive(warp, "/parameters");
    assert!((0.5..1.5).contains(&size), "{size} times as many parameters");
    for rival in [flow, lobe] {
        for stratum in STRATA {
            let binning = |row| positive(row, &format!("/strata/{stratum}/binning_l1/mean"));
            assert!(binning(warp) < binning(rival), "{stratum}: {warp}, {rival}");
        }
    }

    assert_eq!(report["picture"], "held/rivals.png");
    let picture = read_grey(&studio.path("held/rivals.png")).expect("a picture");
    assert!(
        picture.width >= 5 * TILE_MIN && picture.height >= 3 * TILE_MIN,
        "{} × {}",
        picture.width,
        picture.height
    );
}

#[test]
fn what_is_refused() {
    let with_card = studio(true);
    let warp = [
        "rivals", MODEL, "--paper", MODEL, "--steps", "100", "--out", "held",
    ];
    complains(&with_card, &warp, &["--paper baked", "warp", "--preset paper"]);
    for folder in ["nowhere", SCENE] {
        let missing = format!("{folder}/sample.safetensors: there is no such file");
        complains(&with_card, &["rivals", folder, "--steps", "100"], &[&missing]);
    }
    let without = studio(false);
    let untold = ["baked: nothing says how long", "--seconds or --steps"];
    complains(&without, &["rivals", MODEL, "--quick"], &untold);
}
