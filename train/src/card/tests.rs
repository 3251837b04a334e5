//! The measures on a backend whose errors are known: perfect but for its cells, and damaged in known ways.

use super::Runners;
use super::fake::{Damage, Fake};
use super::heldout::HeldOut;
use super::judgement::Bias;
use super::measure::{Samples, errors, measure};
use super::summary::Measured;
use bake_runtime::bsdf::direction;
use bake_runtime::field::Fields;
use bake_runtime::{Backend, Material, Points};
use std::ops::ControlFlow;
use std::path::Path;

/// Fewer than for cards.
const SAMPLES: Samples = Samples {
    binning: 1 << 20,
    exact: 1 << 16,
    mixture: 1 << 14,
    density: 1 << 12,
};
/// Binning L1 that the 256² cells of the backend add to the floor.
const CELLS_L1: f64 = 6e-3;
/// Relative variance within these cells.
const CELLS_RELVAR: f64 = 2e-3;
/// Quadrature of a density with steps at the edges of cells.
const INTEGRAL_TOL: f64 = 4e-3;
/// Relative L1 of two tables of the same slice made with other walks.
const EVAL_TOL: f64 = 1e-2;
/// χ² effect that 65 536 samples in 4096 bins have by chance.
const CHI2_CHANCE: f64 = 0.06;
/// A tenth of u that is lost takes a tenth of the conditional of one coordinate, in every row.
const LOST_COVER: f64 = 0.1;
/// Round-off of f32.
const ROUND_OFF: f64 = 1e-6;
/// Standard errors allowed for a bias that is known.
const SIGMAS: f64 = 4.5;

fn material(json: &str) -> Material {
    let fields: Fields = serde_json::from_str(json).expect("valid JSON");
    let material = Material::read("m", fields, Path::new("")).expect("known parameters");
    material.validate().expect("valid parameters");
    material
}

fn vase() -> Material {
    material(r#"{"family":"conductor","alpha":[0.3,0.1],"reflectance":[1,0.782,0.344]}"#)
}

fn lacquer() -> Material {
    material(r#"{"family":"layered","alpha":0.05,"sigma_t":1,"albedo":[0.9,0.5,0.1],"base":[0.5,0.5,0.5]}"#)
}

fn measured(material: &Material, theta: f64, damage: Damage) -> Measured {
    let native = Fake::new(material, damage);
    let mixture = |points: Points, u: [&[f32]; 2], wi: [&mut [f32]; 3], jacobian: &mut [f32]| {
        native.sample_jacobian(points, u, wi, jacobian)?;
        Ok(points.len() / 4)
    };
    let runners = Runners {
        tier: "none",
        native: &native,
        ort: None,
        mixture: Some(&mixture),
    };
    let place = HeldOut {
        params: Vec::new(),
        wo: direction(theta, 30.0),
    };
    let reference = material.bind(&[]).expect("nothing is free");
    measure(&reference, &place, &runners, &SAMPLES, 1).expect("a bright slice")
}

#[test]
fn a_perfect_sampler_scores_the_floor() {
    let plastic = material(r#"{"family":"principled","roughness":0.2,"base_color":[0.8,0.4,0.1]}"#);
    let paper = material(
        r#"{"family":"layered","alpha":0.1,"eta":1,"sigma_t":0,"albedo":[0,0,0],"base":[0.7,0.5,0.2]}"#,
    );
    for (material, theta) in [(vase(), 45.0), (lacquer(), 60.0), (plastic, 80.0), (paper, 30.0)] {
        let m = measured(&material, theta, Damage::None);
        let name = material.family.name();
        assert!(
            m.binning_l1 < m.binning_floor + CELLS_L1,
            "{name}: {} {}",
            m.binning_l1,
            m.binning_floor
        );
        let mixed = m.mixed.as_ref().expect("a mixture was given");
        for bias in [m.bias_exact, m.bias_map, mixed.bias] {
            let judged = Bias::of(&[bias]);
            assert!(judged.worst_within && judged.mean_within, "{name}: {judged:?}");
        }
        assert!(
            m.relvar_map < CELLS_RELVAR && mixed.relvar < CELLS_RELVAR,
            "{name}: {}",
            m.relvar_map
        );
        assert!(m.relvar > m.relvar_map - CELLS_RELVAR, "{name}: {}", m.relvar);
        assert!(m.chi2_effect < CHI2_CHANCE, "{name}: {}", m.chi2_effect);
        assert!(m.eval_rel_l1 < EVAL_TOL, "{name}: {}", m.eval_rel_l1);
        assert!(
            (m.pdf_integral - 1.0).abs() < INTEGRAL_TOL,
            "{name}: {}",
            m.pdf_integral
        );
        assert!(
            m.pdf_log_l1 < INTEGRAL_TOL && m.fold == 0.0,
            "{name}: {}",
            m.pdf_log_l1
        );
        assert_eq!(mixed.unconverged, 0.25);
    }
}

#[test]
fn squeezed_samples_are_caught() {
    for material in [vase(), lacquer()] {
        let m = measured(&material, 60.0, Damage::Squeezed(1.1));
        assert!(
            m.binning_l1 > 5.0 * m.binning_floor,
            "{} {}",
            m.binning_l1,
            m.binning_floor
        );
        assert!(m.chi2_effect > CHI2_CHANCE, "{}", m.chi2_effect);
    }
}

/// A Jacobian that is off by a percent or three is a bias that the noise of a single slice does not hide.
#[test]
fn wrong_jacobians_are_caught() {
    for (material, factor) in [(vase(), 1.01), (lacquer(), 0.97)] {
        let m = measured(&material, 60.0, Damage::Wider(factor));
        let mixed = m.mixed.expect("a mixture was given");
        for bias in [m.bias_exact, m.bias_map, mixed.bias] {
            let judged = Bias::of(&[bias]);
            assert!(!judged.worst_within && !judged.mean_within, "{judged:?}");
            let error = (bias.mean - (factor - 1.0)).abs();
            assert!(error.cmple(bias.se * SIGMAS + ROUND_OFF).all(), "{bias:?}");
        }
    }
}

#[test]
fn known_damage_is_told_by_its_number() {
    let brighter = measured(&vase(), 60.0, Damage::Brighter(1.05));
    assert!(
        (brighter.eval_rel_l1 - 0.05).abs() < EVAL_TOL,
        "{}",
        brighter.eval_rel_l1
    );
    for bias in [brighter.bias_baked, brighter.bias_learned] {
        assert!(
            !Bias::of(&[bias]).mean_within && (bias.mean - 0.05).abs().max_element() < EVAL_TOL,
            "{bias:?}"
        );
    }
    assert!(Bias::of(&[brighter.bias_exact]).worst_within);

    let denser = measured(&lacquer(), 60.0, Damage::Denser(1.1));
    assert!(
        (denser.pdf_integral - 1.1).abs() < INTEGRAL_TOL,
        "{}",
        denser.pdf_integral
    );
    // Every bin is off by a tenth: sqrt(Σ (0.1 m)²/(1.1 m) / 1.1) = 0.1/1.1.
    assert!(
        (denser.chi2_effect - 0.1 / 1.1).abs() < CHI2_CHANCE,
        "{}",
        denser.chi2_effect
    );

    let folded = measured(&vase(), 60.0, Damage::Folded(0.1));
    assert!((folded.fold - 0.1).abs() < 0.01, "{}", folded.fold);
    // A perfect map's weights are the albedo, nearly so in green alone; a tenth of them are negative.
    let bias = folded.bias_map;
    assert!(
        (bias.mean.y + 0.2).abs() < SIGMAS * bias.se.y + EVAL_TOL,
        "{bias:?}"
    );
    assert!(!Bias::of(&[folded.bias_exact]).worst_within);

    let lost = measured(&vase(), 60.0, Damage::Lost(0.9));
    let bias = lost.bias_map;
    assert!(
        (bias.mean.y + 0.1).abs() < SIGMAS * bias.se.y + EVAL_TOL,
        "{bias:?}"
    );
    assert!(
        lost.binning_l1 > 0.15 && lost.pdf_log_l1 < INTEGRAL_TOL,
        "{} {}",
        lost.binning_l1,
        lost.pdf_log_l1
    );
    assert!(lost.coverage_loss < LOST_COVER, "{}", lost.coverage_loss);
}

/// A domain with a free parameter, one place per stratum.
#[test]
fn strata_hold_places_of_the_domain() {
    let free =
        material(r#"{"family":"principled","roughness":{"min":0.3,"max":0.8},"base_color":[0.8,0.4,0.1]}"#);
    let native = Fake::new(&free, Damage::None);
    let runners = Runners {
        tier: "none",
        native: &native,
        ort: None,
        mixture: None,
    };
    let strata = errors(&free, &runners, 32, &|_, _| ControlFlow::Continue(())).expect("bright slices");
    assert_eq!(strata.len(), 3);
    for (name, stratum) in &strata {
        let [place] = &stratum.places[..] else {
            panic!("{name} has {} places", stratum.places.len());
        };
        assert!((0.3..0.8).contains(&place.params[0]) && place.params.len() == 1);
        assert!(
            stratum.binning_l1.mean < stratum.binning_floor + CELLS_L1,
            "{name}: {stratum:?}"
        );
        assert!(stratum.albedo_bias_exact.mean_within && stratum.albedo_bias_exact.worst_within);
        assert_eq!(stratum.weight_relvar_mixture, None);
        let text = serde_json::to_string(stratum).expect("plain data");
        assert_eq!(
            &serde_json::from_str::<super::StratumErrors>(&text).expect("no NaN"),
            stratum
        );
        assert!(
            text.contains(r#""weight_relvar_mixture":null"#) && text.contains(r#""newton_unconverged":null"#)
        );
    }
    let broken = errors(&free, &runners, 32, &|_, _| ControlFlow::Break(()));
    assert!(matches!(broken, Err(crate::Error::Interrupted)));
}
