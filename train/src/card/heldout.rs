//! The fixed held-out places of every measure, `tests/heldout.json`: directions, and points of the unit cube that become
//! values of whatever parameters a material leaves free.

use crate::error::{Error, Result};
use crate::places::value_at;
use bake_runtime::Material;
use bake_runtime::bsdf::direction;
use glam::DVec3;
use serde::Deserialize;
use std::collections::BTreeMap;

const HELDOUT: &str = include_str!("../../../tests/heldout.json");

/// Most free scalars: the principled family has 13.
pub const DIMENSIONS: usize = 16;

/// Places per stratum.
pub const PER_STRATUM: usize = 32;

/// Names of the strata, from the normal to the horizon.
pub const STRATA: [&str; 3] = ["theta_0_75", "theta_75_85", "theta_85_89"];

#[derive(Deserialize)]
struct File {
    /// (θ, φ) in degrees.
    wo: BTreeMap<String, Vec<[f64; 2]>>,
    /// Shares of the ranges of free scalars.
    shares: BTreeMap<String, Vec<[f64; DIMENSIONS]>>,
}

/// One held-out place.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldOut {
    /// Values of the free scalars, in the order of [`Material::free`].
    pub params: Vec<f64>,
    /// Camera direction.
    pub wo: DVec3,
}

fn file() -> File {
    serde_json::from_str(HELDOUT).expect("the held-out file is compiled in")
}

/// The [`PER_STRATUM`] places of every stratum in the domain of `material`.
///
/// # Errors
/// [`Error::Runtime`] where more than [`DIMENSIONS`] scalars are free.
pub fn places(material: &Material) -> Result<BTreeMap<String, Vec<HeldOut>>> {
    let free = material.free();
    if free.len() > DIMENSIONS {
        return Err(Error::Runtime(bake_runtime::Error::parameter(
            &free[DIMENSIONS].0,
            format!(
                "is one of {} that are free; there are held-out values for {DIMENSIONS}",
                free.len()
            ),
        )));
    }
    let File { wo, shares } = file();
    let strata = wo.into_iter().map(|(name, angles)| {
        let places = angles.iter().zip(&shares[&name]).map(|(&[theta, phi], shares)| {
            let values = free.iter().zip(shares);
            HeldOut {
                params: values
                    .map(|((label, min, max), x)| value_at(label, *min, *max, *x))
                    .collect(),
                wo: direction(theta, phi),
            }
        });
        let places = places.collect();
        (name, places)
    });
    Ok(strata.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::{Family, Rng, Scalar, Setting};

    /// Smallest and largest θ of every stratum, degrees.
    const THETAS: [[f64; 2]; 3] = [[0.0, 75.0], [75.0, 85.0], [85.0, 89.0]];
    /// Golden ratio's fraction of a full turn between azimuths, and from stratum to stratum, degrees.
    const TURN_DEG: f64 = 360.0 * 0.618_033_988_749_895;
    const OFFSET_DEG: f64 = 360.0 * 0.137;
    /// Key of the scrambling of shares; training uses another.
    const KEY: u64 = 0x4e1d_0007;
    /// Rounding of degrees and of shares in the file.
    const ROUNDING: [f64; 3] = [5.01e-5, 5.01e-4, 5.01e-6];

    /// (θ, φ) and shares of place `k` of stratum `s`.
    fn generated(s: usize, k: usize) -> ([f64; 2], [f64; DIMENSIONS]) {
        let [low, high] = THETAS[s];
        let theta = low + (high - low) * (k as f64 + 0.5) / PER_STRATUM as f64;
        let phi = ((s + 1) as f64 * OFFSET_DEG + k as f64 * TURN_DEG) % 360.0;
        let scramble = (Rng::new(&[KEY, s as u64]).bits() >> 32) as u32;
        let share = |d: usize| f64::from(sobol_burley::sample(k as u32, d as u32, scramble));
        ([theta, phi], std::array::from_fn(share))
    }

    #[test]
    fn the_file_is_what_its_note_says() {
        let file = file();
        for (s, name) in STRATA.iter().enumerate() {
            assert_eq!(
                (file.wo[*name].len(), file.shares[*name].len()),
                (PER_STRATUM, PER_STRATUM)
            );
            for k in 0..PER_STRATUM {
                let (angles, shares) = generated(s, k);
                for c in 0..2 {
                    assert!(
                        (file.wo[*name][k][c] - angles[c]).abs() < ROUNDING[c],
                        "{name} {k}"
                    );
                }
                for (a, b) in file.shares[*name][k].iter().zip(shares) {
                    assert!(
                        (a - b).abs() < ROUNDING[2] && (0.0..1.0).contains(a),
                        "{name} {k}"
                    );
                }
            }
        }
    }

    /// One value in each of 32 equal parts of every dimension, and in each quarter of the square of any two dimensions a
    /// fair number.
    #[test]
    fn shares_fill_the_cube_evenly() {
        for (name, shares) in file().shares {
            for d in 0..DIMENSIONS {
                let mut parts: Vec<usize> = shares
                    .iter()
                    .map(|x| (x[d] * PER_STRATUM as f64) as usize)
                    .collect();
                parts.sort_unstable();
                assert_eq!(
                    parts,
                    (0..PER_STRATUM).collect::<Vec<_>>(),
                    "{name}, dimension {d}"
                );
                for e in 0..d {
                    let both = shares.iter().filter(|x| x[d] < 0.5 && x[e] < 0.5).count();
                    assert!((4..=12).contains(&both), "{name}, dimensions {e} and {d}: {both}");
                }
            }
        }
    }

    #[test]
    fn shares_become_values_of_the_domain() {
        let range = |min, max| Scalar::Free { min, max };
        let material = Material {
            name: "metal".into(),
            family: Family::Conductor,
            parameters: vec![
                (
                    "alpha".into(),
                    Setting::Numbers(vec![range(0.01, 1.0), Scalar::Fixed(0.2)]),
                ),
                ("reflectance".into(), Setting::Numbers(vec![range(0.0, 1.0); 3])),
            ],
        };
        let strata = places(&material).expect("four are free");
        let shares = &file().shares["theta_75_85"];
        for (place, x) in strata["theta_75_85"].iter().zip(shares) {
            assert_eq!(place.params.len(), 4);
            assert!((place.params[0] - (0.1 + 0.9 * x[0]).powi(2)).abs() < 1e-12);
            assert_eq!(place.params[1..], x[1..4]);
            material.bind(&place.params).expect("within the ranges");
        }
        let table = Material {
            name: "table".into(),
            family: Family::Imported,
            parameters: (0..17)
                .map(|i| (format!("p{i}"), Setting::Numbers(vec![range(0.0, 1.0)])))
                .collect(),
        };
        let error = places(&table).expect_err("17 are too many").to_string();
        assert!(error.contains("17") && error.contains("p16"), "{error}");
    }

    /// Writes the file anew: `cargo test -p bake-train --release heldout -- --ignored`.
    #[test]
    #[ignore = "writes tests/heldout.json"]
    fn regenerate() {
        let note = "Held-out places, 32 per stratum, never drawn for training (training draws other scramblings of the Sobol \
            sequence). wo: (theta, phi) in degrees, over all azimuths; theta: midpoints of 32 equal parts of the stratum; phi: \
            multiples of the golden ratio's fraction of 360, offset per stratum. shares: the first 32 points of an \
            Owen-scrambled 16-dimensional Sobol sequence per stratum; of a material with n free parameters the first n \
            numbers of each are carried into its ranges, evenly, or evenly in the square root for alpha.";
        let list = |row: &dyn Fn(usize, usize) -> String| {
            let strata = STRATA.iter().enumerate().map(|(s, name)| {
                let rows: Vec<String> = (0..PER_STRATUM).map(|k| row(s, k)).collect();
                format!("    \"{name}\": [\n      {}\n    ]", rows.join(",\n      "))
            });
            strata.collect::<Vec<_>>().join(",\n")
        };
        let wo = list(&|s, k| {
            let ([theta, phi], _) = generated(s, k);
            format!("[{theta:.4}, {phi:.3}]")
        });
        let shares = list(&|s, k| {
            let shares = generated(s, k).1.map(|x| format!("{x:.5}"));
            format!("[{}]", shares.join(", "))
        });
        let text = format!(
            "{{\n  \"note\": \"{note}\",\n  \"wo\": {{\n{wo}\n  }},\n  \"shares\": {{\n{shares}\n  }}\n}}\n"
        );
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/heldout.json");
        std::fs::write(path, text).expect("the repository can be written");
    }
}
