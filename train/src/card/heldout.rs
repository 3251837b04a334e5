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
    /// Key of the permutations.
    const KEY: u64 = 0x4e1d_0007;
    /// Permutations that each dimension is chosen out of.
    const CANDIDATES: usize = 2000;
    /// Correlation that is left between two dimensions, or between one and θ.
    const CORRELATION_MAX: f64 = 0.18;
    /// Rounding of degrees and of shares in the file.
    const ROUNDING: [f64; 3] = [5.01e-5, 5.01e-4, 5.01e-7];

    /// (θ, φ) of place `k` of stratum `s`.
    fn angles(s: usize, k: usize) -> [f64; 2] {
        let [low, high] = THETAS[s];
        let theta = low + (high - low) * (k as f64 + 0.5) / PER_STRATUM as f64;
        [theta, ((s + 1) as f64 * OFFSET_DEG + k as f64 * TURN_DEG) % 360.0]
    }

    fn correlation(a: &[usize], b: &[usize]) -> f64 {
        let n = PER_STRATUM as f64;
        let centred = |v: usize| v as f64 - 0.5 * (n - 1.0);
        let sum: f64 = a.iter().zip(b).map(|(a, b)| centred(*a) * centred(*b)).sum();
        sum / (n * (n * n - 1.0) / 12.0)
    }

    /// Shares of stratum `s`: a Latin hypercube whose dimensions are chosen one by one for the least correlation with
    /// those before, of which the first is θ.
    fn hypercube(s: usize) -> Vec<[f64; DIMENSIONS]> {
        let mut columns: Vec<Vec<usize>> = vec![(0..PER_STRATUM).collect()];
        let mut rng = Rng::new(&[KEY, s as u64]);
        for _ in 0..DIMENSIONS {
            let candidates = (0..CANDIDATES).map(|_| {
                let mut column = columns[0].clone();
                (1..PER_STRATUM).for_each(|i| column.swap(i, (rng.uniform() * (i + 1) as f64) as usize));
                let largest = columns.iter().map(|c| correlation(c, &column).abs());
                (largest.fold(0.0, f64::max), column)
            });
            let best = candidates.min_by(|a, b| a.0.total_cmp(&b.0));
            columns.push(best.expect("there are candidates").1);
        }
        let share = |k: usize, d: usize| (columns[d + 1][k] as f64 + 0.5) / PER_STRATUM as f64;
        (0..PER_STRATUM)
            .map(|k| std::array::from_fn(|d| share(k, d)))
            .collect()
    }

    #[test]
    fn the_file_is_what_its_note_says() {
        let file = file();
        for (s, name) in STRATA.iter().enumerate() {
            let cube = hypercube(s);
            assert_eq!(
                (file.wo[*name].len(), file.shares[*name].len()),
                (PER_STRATUM, PER_STRATUM)
            );
            for (k, corner) in cube.into_iter().enumerate() {
                for (c, angle) in angles(s, k).iter().enumerate() {
                    assert!((file.wo[*name][k][c] - angle).abs() < ROUNDING[c], "{name} {k}");
                }
                for (a, b) in file.shares[*name][k].iter().zip(corner) {
                    assert!((a - b).abs() < ROUNDING[2], "{name} {k}");
                }
            }
        }
    }

    /// One value in each of 32 equal parts of every dimension, and no two dimensions go together.
    #[test]
    fn shares_fill_the_cube_evenly() {
        let order: Vec<usize> = (0..PER_STRATUM).collect();
        for (name, shares) in file().shares {
            let part = |d: usize| {
                let parts = shares.iter().map(move |x| (x[d] * PER_STRATUM as f64) as usize);
                parts.collect::<Vec<_>>()
            };
            for d in 0..DIMENSIONS {
                let mut parts = part(d);
                assert!(
                    correlation(&parts, &order).abs() < CORRELATION_MAX,
                    "{name}, dimension {d}"
                );
                for e in 0..d {
                    let found = correlation(&parts, &part(e));
                    assert!(
                        found.abs() < CORRELATION_MAX,
                        "{name}, dimensions {e} and {d}: {found}"
                    );
                }
                parts.sort_unstable();
                assert_eq!(parts, order, "{name}, dimension {d}");
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
}
