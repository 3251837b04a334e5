//! The fixed held-out directions of every measure, `tests/heldout.json`.

use glam::DVec3;
use serde::Deserialize;
use std::collections::BTreeMap;

const HELDOUT: &str = include_str!("../../../tests/heldout.json");

#[derive(Deserialize)]
struct File {
    wo: BTreeMap<String, Vec<[f64; 2]>>,
}

/// Unit direction at polar angle and azimuth in degrees.
pub fn direction(theta_deg: f64, phi_deg: f64) -> DVec3 {
    let (sin_theta, cos_theta) = theta_deg.to_radians().sin_cos();
    let (sin_phi, cos_phi) = phi_deg.to_radians().sin_cos();
    DVec3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta)
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
