//! The reference principled BRDF against Mitsuba's values, against its own integrals, and at the inputs where such
//! models usually break.

mod edges;
mod integrals;
mod quadrature;
mod sampling;
mod tables;

use crate::support::direction;
use bake_runtime::principled::{Principled, PrincipledParameters};
use bake_runtime::{Bsdf, Rng};
use glam::DVec3;

/// A setting with its name for messages.
type Setting = (&'static str, Principled);

fn bound(parameters: PrincipledParameters) -> Principled {
    Principled::new(parameters).expect("valid parameters")
}

fn eval(bsdf: &Principled, wo: DVec3, wi: DVec3) -> DVec3 {
    bsdf.eval(wo, wi, &mut Rng::new(&[]))
}

/// Every lobe alone, rough and narrow, and mixtures of them.
fn settings() -> Vec<Setting> {
    let default = PrincipledParameters::default();
    let black = PrincipledParameters {
        base_color: DVec3::ZERO,
        specular: 0.0,
        ..default
    };
    let metal = PrincipledParameters {
        base_color: DVec3::new(1.0, 0.8, 0.3),
        metallic: 1.0,
        ..default
    };
    let everything = PrincipledParameters {
        base_color: DVec3::new(0.8, 0.4, 0.1),
        metallic: 0.2,
        roughness: 0.3,
        specular: 0.7,
        specular_tint: 0.4,
        anisotropic: 0.6,
        sheen: 0.8,
        sheen_tint: 0.5,
        clearcoat: 0.9,
        clearcoat_gloss: 0.6,
        flatness: 0.4,
    };
    vec![
        ("default", bound(default)),
        ("everything", bound(everything)),
        ("black", bound(black)),
        (
            "rough metal",
            bound(PrincipledParameters {
                roughness: 1.0,
                ..metal
            }),
        ),
        (
            "brushed metal",
            bound(PrincipledParameters {
                roughness: 0.4,
                anisotropic: 1.0,
                ..metal
            }),
        ),
        (
            "polished metal",
            bound(PrincipledParameters {
                roughness: 0.0,
                ..metal
            }),
        ),
        (
            "polished plastic",
            bound(PrincipledParameters {
                roughness: 0.03,
                ..default
            }),
        ),
        (
            "rough coat",
            bound(PrincipledParameters {
                clearcoat: 1.0,
                ..black
            }),
        ),
        (
            "glossy coat",
            bound(PrincipledParameters {
                clearcoat: 1.0,
                clearcoat_gloss: 1.0,
                ..black
            }),
        ),
        (
            "velvet",
            bound(PrincipledParameters {
                base_color: DVec3::splat(0.05),
                roughness: 1.0,
                sheen: 1.0,
                flatness: 1.0,
                ..black
            }),
        ),
    ]
}
