//! Places: the parameters and camera directions that slices are made at.
//!
//! Drawn as Bai et al. 2023, §5.1, draw them: roughness evenly in its square root, θ_o = 90°·√ξ, the rest evenly; not at
//! random, but by a scrambled Sobol sequence (Burley 2020), so that any number of first places fills the domain evenly.

use bake_runtime::{Family, Material, Rng};

/// Largest polar angle of a slice, degrees: beyond it less than a thousandth of the light of any view is lost.
pub const THETA_MAX_DEG: f64 = 89.9;

/// Key of the scrambling.
const KEY: u64 = 0x0091_ace5;

/// Points after which the library's sequence ends and is scrambled anew.
const SEQUENCE_BITS: u32 = 16;

/// Where one slice is made.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    /// Values of the material's free scalars, in the order of [`Material::free`].
    pub parameters: Vec<f64>,
    /// Camera direction, unit, above the horizon.
    pub wo: [f64; 3],
    /// The place in a space where neighbours have similar slices.
    pub coordinates: Vec<f64>,
}

/// Azimuths of `wo`, in degrees from 0, that tell different slices apart: none for a material without a direction, a
/// quarter turn for one with two axes, else a full turn.
pub fn azimuths_deg(material: &Material) -> f64 {
    let scalars = |name: &str| material.get(name).map_or(&[][..], |s| s.scalars());
    match material.family {
        Family::Layered => 0.0,
        Family::Imported => 360.0,
        Family::Principled => match scalars("anisotropic") {
            [scalar] if scalar.fixed() == Ok(0.0) => 0.0,
            _ => 90.0,
        },
        Family::Conductor => match scalars("alpha") {
            [x, y] if x.fixed().is_ok() && x.fixed() == y.fixed() => 0.0,
            _ => 90.0,
        },
    }
}

/// Whether the free scalar called `label` is a roughness as the microfacet model takes it.
pub fn is_alpha(label: &str) -> bool {
    label == "alpha" || label.starts_with("alpha[")
}

/// Value at the share `x` of the range `min`..`max` of the free scalar called `label`.
pub fn value_at(label: &str, min: f64, max: f64, x: f64) -> f64 {
    let lerp = |a: f64, b: f64| a + x * (b - a);
    match is_alpha(label) {
        true => lerp(min.sqrt(), max.sqrt()).powi(2).clamp(min, max),
        false => lerp(min, max).clamp(min, max),
    }
}

/// The first `count` places of `material`'s domain.
pub fn draw(material: &Material, count: usize, seed: u64) -> Vec<Place> {
    let free = material.free();
    let turn = azimuths_deg(material);
    (0..count as u64)
        .map(|k| {
            let scramble = (Rng::new(&[KEY, seed, k >> SEQUENCE_BITS]).bits() >> 32) as u32;
            let index = k as u32 & ((1 << SEQUENCE_BITS) - 1);
            let x = |dimension: u32| f64::from(sobol_burley::sample(index, dimension, scramble));
            let theta = (90.0 * x(0).sqrt()).min(THETA_MAX_DEG).to_radians();
            let phi = (turn * x(1)).to_radians();
            let parameters = (2..)
                .zip(&free)
                .map(|(d, (label, min, max))| value_at(label, *min, *max, x(d)));
            // Azimuths matter as much as the tilt that they turn.
            let tilt = theta.sin();
            let mut coordinates = vec![x(0), tilt * phi.cos(), tilt * phi.sin()];
            coordinates.extend((2..).take(free.len()).map(x));
            Place {
                parameters: parameters.collect(),
                wo: [tilt * phi.cos(), tilt * phi.sin(), theta.cos()],
                coordinates,
            }
        })
        .collect()
}

/// Index of the place that place `k` starts from: the nearest of the earlier half, that is of those below the largest power
/// of two ≤ `k`. The tree does not depend on how many places there are, nor on threads.
pub fn parent(places: &[Place], k: usize) -> Option<usize> {
    let earlier = if k == 0 { 0 } else { 1 << k.ilog2() };
    let here = &places[k].coordinates;
    let distance = |j: &usize| -> f64 {
        let there = &places[*j].coordinates;
        here.iter().zip(there).map(|(a, b)| (a - b) * (a - b)).sum()
    };
    (0..earlier).min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::field::Fields;
    use std::path::Path;

    /// 4096 Sobol points: every coarse share is met to half a percent.
    const SHARE_TOL: f64 = 5e-3;

    fn material(json: &str) -> Material {
        let fields: Fields = serde_json::from_str(json).expect("valid JSON");
        Material::read("m", fields, Path::new("")).expect("known parameters")
    }

    #[test]
    fn places_follow_the_distributions_of_the_paper() {
        let conductor = material(
            r#"{"family":"conductor","alpha":[{"min":0.01,"max":1},{"min":0.01,"max":1}],"reflectance":[1,{"min":0.2,"max":0.6},0.5]}"#,
        );
        let places = draw(&conductor, 4096, 1);
        assert_eq!(
            places[..100],
            draw(&conductor, 100, 1),
            "a prefix stays what it was"
        );
        assert_ne!(places[..100], draw(&conductor, 100, 2));
        let share = |f: &dyn Fn(&Place) -> bool| places.iter().filter(|p| f(p)).count() as f64 / 4096.0;
        // θ_o = 90°·√ξ: a quarter lies below 45°; alpha = (0.1 + 0.9ξ)²: half below 0.3025.
        assert!((share(&|p| p.wo[2].acos().to_degrees() < 45.0) - 0.25).abs() < SHARE_TOL);
        assert!((share(&|p| p.parameters[0] < 0.3025) - 0.5).abs() < SHARE_TOL);
        assert!((share(&|p| p.parameters[2] < 0.3) - 0.25).abs() < SHARE_TOL);
        for p in &places {
            assert!(p.wo[0] >= 0.0 && p.wo[1] >= 0.0 && p.wo[2] > 0.0);
            assert!((0.01..=1.0).contains(&p.parameters[1]) && (0.2..=0.6).contains(&p.parameters[2]));
        }
    }

    #[test]
    fn isotropic_materials_are_seen_from_one_azimuth() {
        for (json, turn) in [
            (
                r#"{"family":"layered","alpha":0.1,"sigma_t":1,"albedo":[1,1,1],"base":[0,0,0]}"#,
                0.0,
            ),
            (r#"{"family":"conductor","alpha":[0.2,0.2],"ior":"gold"}"#, 0.0),
            (r#"{"family":"conductor","alpha":[0.2,0.1],"ior":"gold"}"#, 90.0),
            (r#"{"family":"principled"}"#, 0.0),
            (r#"{"family":"principled","anisotropic":0.5}"#, 90.0),
        ] {
            assert_eq!(azimuths_deg(&material(json)), turn, "{json}");
        }
        let places = draw(&material(r#"{"family":"principled"}"#), 64, 1);
        assert!(places.iter().all(|p| p.wo[1] == 0.0 && p.parameters.is_empty()));
    }

    #[test]
    fn parents_are_near_and_earlier() {
        let places = draw(&material(r#"{"family":"principled"}"#), 256, 1);
        assert_eq!(parent(&places, 0), None);
        for k in 1..256usize {
            assert!(parent(&places, k).expect("earlier ones exist") < 1 << k.ilog2());
        }
    }
}
