//! The fixed held-out directions of every measure, `tests/heldout.json`.

use bake_runtime::bsdf::direction;
use glam::DVec3;
use serde::Deserialize;
use std::collections::BTreeMap;

const HELDOUT: &str = include_str!("../../../tests/heldout.json");

#[derive(Deserialize)]
struct File {
    wo: BTreeMap<String, Vec<[f64; 2]>>,
}

/// Directions per stratum.
pub const PER_STRATUM: usize = 32;

/// Strata by name, each with its [`PER_STRATUM`] directions.
pub fn strata() -> BTreeMap<String, Vec<DVec3>> {
    let file: File = serde_json::from_str(HELDOUT).expect("the held-out file is compiled in");
    file.wo
        .into_iter()
        .map(|(name, wo)| (name, wo.iter().map(|a| direction(a[0], a[1])).collect()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strata_hold_32_directions_each_in_their_range() {
        let strata = strata();
        for (name, low, high) in [
            ("theta_0_75", 0.0, 75.0),
            ("theta_75_85", 75.0, 85.0),
            ("theta_85_89", 85.0, 89.0),
        ] {
            assert_eq!(strata[name].len(), PER_STRATUM);
            assert!(
                strata[name]
                    .iter()
                    .all(|w| (low..=high).contains(&w.z.acos().to_degrees()))
            );
        }
    }
}
