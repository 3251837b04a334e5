//! What a database gives back is what was put in, and what is in it is the slice that the reference model has.

use bake_runtime::bsdf::shifted_r2;
use bake_runtime::chart::Chart;
use bake_runtime::field::Fields;
use bake_runtime::{Bsdf, Material};
use bake_train::Error;
use bake_train::card::binned::BinnedSlice;
use bake_train::card::bins::l1;
use bake_train::compare::{Target, slices_of};
use bake_train::database::{self, SHARD_SLICES};
use bake_train::lobes::{LUMINANCE, Lobe, LobeSlice, WALKS};
use bake_train::maps::{Charts, Job, MappedSlice, WALK_SEED, compute};
use bake_train::places::{self, Place, THETA_MAX_DEG};
use bake_train::transport::Solver;
use bake_train::transport::frame_map::FrameMap;
use bake_train::transport::map::ImportanceMap;
use bake_train::transport::measure::BINNING_POINTS;
use bake_train::view;
use glam::DVec3;
use std::ops::ControlFlow;
use std::path::Path;

/// Degrees that an arc cosine next to the normal may lose.
const ANGLE_TOL: f64 = 1e-6;
/// Polar angles of `wo` that are compared, degrees.
const THETAS_DEG: [f64; 5] = [10.0, 45.0, 75.0, 85.0, 89.0];

/// Cells per side of the maps.
const CELLS: usize = 32;
/// Points behind a mean weight.
const POINTS: u64 = 1 << 14;
/// Mean weight over the albedo: noise of the reference's walks and of the table's, half a percent each, and the error of the
/// points.
const ALBEDO_TOL: f64 = 0.01;
/// Probabilities of charts, summed.
const SHARE_TOL: f64 = 1e-12;
/// Binning L1 of an entry of 32² cells, by a frame (0.021 and less) and by the bilinear marginal map on the disk (0.073).
const VIEW_L1_MAX: [f64; 2] = [0.03, 0.09];
/// Mean weight of an entry over its energy: the density of a map of 32² cells, and midpoints of 128²; 0.009 and less.
const WEIGHT_TOL: f64 = 0.02;

const LAYERED: &str =
    r#"{"family":"layered","alpha":0.1,"sigma_t":0.8,"albedo":[0.9,0.6,0.3],"base":[0.8,0.5,0.2]}"#;
const METAL: &str = r#"{"family":"principled","metallic":1,"roughness":{"min":0.4,"max":0.8}}"#;
const PLASTIC: &str = r#"{"family":"principled","roughness":0.4}"#;

fn material(json: &str) -> Material {
    let fields: Fields = serde_json::from_str(json).expect("valid JSON");
    Material::read("m", fields, Path::new("")).expect("known parameters")
}

fn job<'a>(material: &'a Material, places: &'a [Place], solver: Solver) -> Job<'a> {
    Job {
        material,
        places,
        drawn: "drawn",
        charts: Charts::Fitted,
        solver,
        cells: CELLS,
        seed: 1,
    }
}

/// The first `count` slices of `material` by way of a database.
fn stored(material: &Material, count: usize, solver: Solver) -> Vec<MappedSlice> {
    let places = places::draw(material, count, 1);
    let job = job(material, &places, solver);
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    compute(&job, folder.path(), &|_, _| ControlFlow::Continue(())).expect("bright slices");
    database::load(folder.path(), count, &job.fingerprint()).expect("just written")
}

#[test]
fn slices_come_back_as_they_were() {
    let mut slices = stored(&material(PLASTIC), 3, Solver::Frame);
    assert!(slices.iter().all(|s| s.charts.len() == 2));
    // A slice with one chart in a shard with room for two, and a marginal map, which has no potential.
    slices[1].charts.truncate(1);
    slices[2].charts[0].potential.clear();
    slices[2].charts[0].fallback = true;
    for (i, slice) in slices.iter_mut().enumerate() {
        slice.parameters = vec![0.1 * i as f64, 0.7];
        slice.smoothing_error = 1e-3 * i as f64;
        for (k, chart) in slice.charts.iter_mut().enumerate() {
            let r = &mut chart.residuals;
            (r.constant, r.residual, r.softened, r.folds, r.uncovered) = (0.1, 0.2, 0.3, 0.4, 0.5 + k as f64);
        }
    }
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    database::save_shard(folder.path(), 1, &slices, 2, "this").expect("it can be written");
    let load = |count, fingerprint| {
        database::load_shard(folder.path(), 1, count, fingerprint).expect("a whole shard")
    };
    assert_eq!(load(3, "this").as_deref(), Some(&slices[..]));
    assert_eq!(load(2, "this").as_deref(), Some(&slices[..2]));
    assert_eq!(load(4, "this"), None, "there are but three");
    assert_eq!(load(3, "that"), None, "made of something else");
    let second = database::load_slice(folder.path(), SHARD_SLICES + 1).expect("a whole shard");
    assert_eq!(second.as_ref(), Some(&slices[1]));
    assert_eq!(
        database::load_slice(folder.path(), SHARD_SLICES + 3).expect("a whole shard"),
        None
    );
    assert_eq!(
        database::load_slice(folder.path(), 0).expect("nothing to read"),
        None
    );
    match database::load(folder.path(), 3, "this") {
        Err(Error::Checkpoint { path, .. }) => assert!(path.ends_with("maps-0000.safetensors")),
        other => panic!("the first shard is not there, but: {other:?}"),
    }
}

#[test]
fn entries_without_charts_are_refused() {
    let mut slices = stored(&material(PLASTIC), 2, Solver::Frame);
    slices[1].charts.clear();
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    database::save_shard(folder.path(), 0, &slices, 2, "this").expect("it can be written");
    match database::load_slice(folder.path(), 0) {
        Err(Error::Checkpoint { reason, .. }) => assert!(reason.contains("entry 1"), "{reason}"),
        other => panic!("an entry has no charts, but: {other:?}"),
    }
}

#[test]
fn fingerprints_tell_jobs_apart() {
    let (metal, plastic) = (material(METAL), material(PLASTIC));
    let places = places::draw(&plastic, 2, 1);
    let one = job(&plastic, &places, Solver::Frame);
    let others = [
        job(&metal, &places, Solver::Frame),
        job(&plastic, &places, Solver::Marginal),
        Job { cells: 64, ..one },
        Job { seed: 2, ..one },
        Job {
            drawn: "otherwise",
            ..one
        },
    ];
    for other in others {
        assert_ne!(one.fingerprint(), other.fingerprint());
    }
    let fewer = Job {
        places: &places[..1],
        ..one
    };
    assert_eq!(one.fingerprint(), fewer.fingerprint(), "more slices may be added");
}

#[test]
fn weights_of_stored_maps_carry_the_albedo() {
    let material = material(LAYERED);
    let bsdf = material.bind(&[]).expect("nothing is free");
    let stored = stored(&material, 2, Solver::Frame);
    let entry = &stored[1];
    assert_eq!(entry.charts.len(), 2);
    assert!((entry.charts.iter().map(|c| c.share).sum::<f64>() - 1.0).abs() < SHARE_TOL);
    let wo = DVec3::from_array(entry.wo);
    let slice = LobeSlice::new(&bsdf, wo, WALKS, WALK_SEED).expect("bright");
    let map = FrameMap::new(&entry.charts);
    let split = map.breaks()[0];
    let weights = (0..POINTS).map(|i| {
        let u = shifted_r2(i, [0.0; 2]);
        let (wi, jacobian) = map.direction(u);
        let lobe = if u[0] < split { Lobe::Sharp } else { Lobe::Smooth };
        slice.f_cos(lobe, wi).dot(LUMINANCE) * jacobian
    });
    let mean = weights.sum::<f64>() / POINTS as f64;
    let chart = slice.sharp_chart().unwrap_or(Chart::IDENTITY);
    let albedo: f64 = BinnedSlice::new(&bsdf as &dyn Bsdf, wo, &chart).mass.iter().sum();
    assert!((mean / albedo - 1.0).abs() < ALBEDO_TOL, "{mean} {albedo}");
    let shares = entry
        .charts
        .iter()
        .map(|c| c.table.albedo().dot(LUMINANCE) / albedo);
    for (share, chart) in shares.zip(&entry.charts) {
        assert!(
            (share - chart.share).abs() < ALBEDO_TOL,
            "{share} {}",
            chart.share
        );
    }
}

/// The picture of an entry: its samples fall where they belong, and its weights average to the energy of its charts.
#[test]
fn views_show_maps_that_fit() {
    for (json, solver, charts) in [
        (METAL, Solver::Frame, 1),
        (PLASTIC, Solver::Frame, 2),
        (PLASTIC, Solver::Marginal, 1),
    ] {
        let material = material(json);
        let stored = stored(&material, 2, solver);
        let entry = &stored[1];
        let bsdf = material.bind(&entry.parameters).expect("in range");
        let views = view::charts(&bsdf, entry, solver).expect("bright");
        assert_eq!((views.len(), entry.charts.len()), (charts, charts));
        for (shown, chart) in views.iter().zip(&entry.charts) {
            let on_disk = solver != Solver::Frame;
            assert_eq!(shown.disk, on_disk);
            let counts: Vec<u64> = shown
                .bins
                .iter()
                .map(|b| (b * BINNING_POINTS as f64).round() as u64)
                .collect();
            let distance = l1(&counts, &shown.reference);
            assert!(
                distance < VIEW_L1_MAX[usize::from(on_disk)],
                "{json} {solver}: {distance}"
            );
            let weights = shown.weight.iter().map(|w| DVec3::from_array(*w).dot(LUMINANCE));
            let mean = weights.sum::<f64>() / shown.weight.len() as f64;
            let energy = chart.table.albedo().dot(LUMINANCE);
            assert!(
                (mean / energy - 1.0).abs() < WEIGHT_TOL,
                "{json} {solver}: {mean} {energy}"
            );
        }
    }
}

#[test]
fn places_start_from_their_nearest_and_stay_above_the_horizon() {
    let places = places::draw(&material(METAL), 600, 3);
    let distance = |a: &Place, b: &Place| -> f64 {
        a.coordinates
            .iter()
            .zip(&b.coordinates)
            .map(|(a, b)| (a - b).powi(2))
            .sum()
    };
    for (k, place) in places.iter().enumerate().skip(1) {
        let parent = places::parent(&places, k).expect("there are earlier ones");
        let earlier = &places[..1 << k.ilog2()];
        let nearest = earlier
            .iter()
            .map(|p| distance(p, place))
            .fold(f64::INFINITY, f64::min);
        assert_eq!(distance(&places[parent], place), nearest);
    }
    let lowest = places
        .iter()
        .map(|p| p.wo[2].acos().to_degrees())
        .fold(0.0, f64::max);
    assert!(lowest > 89.0 && lowest <= THETA_MAX_DEG + 1e-9, "{lowest}");
}

#[test]
fn a_material_is_compared_at_three_roughnesses_and_five_angles() {
    let names = |json: &str| -> Vec<String> {
        let targets = slices_of(&material(json), &THETAS_DEG).expect("valid parameters");
        targets
            .iter()
            .map(|target| match target {
                Target::Slice { name, wo, .. } => {
                    let theta = wo.z.acos().to_degrees();
                    assert!(
                        THETAS_DEG.iter().any(|t| (t - theta).abs() < ANGLE_TOL),
                        "{theta}"
                    );
                    name.clone()
                }
                Target::Picture { name, .. } => panic!("{name} is a picture"),
            })
            .collect()
    };
    let at = |lead: &str| THETAS_DEG.map(|theta| format!("m {lead}θ {theta}°"));
    assert_eq!(names(PLASTIC), at(""));
    let metal = ["roughness 0.400 ", "roughness 0.600 ", "roughness 0.800 "]
        .map(at)
        .concat();
    assert_eq!(names(METAL), metal);
    // Roughness as the microfacet model takes it is halved in its square root: ((0.2 + 0.8)/2)².
    let conductor =
        r#"{"family":"conductor","alpha":[{"min":0.04,"max":0.64},{"min":0.04,"max":0.64}],"ior":"gold"}"#;
    let rough = ["alpha 0.040 ", "alpha 0.250 ", "alpha 0.640 "].map(at).concat();
    assert_eq!(names(conductor), rough);
}
