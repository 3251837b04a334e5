//! What a flow knows of its slice: the free parameters and `wo`, folded by the symmetry of the material.

use crate::places::{azimuths_deg, is_alpha};
use bake_runtime::Material;
use bake_runtime::encoding::{GRAZING_FEATURES, grazing};
use glam::{DMat2, DVec2, DVec3};

/// How the slices of a material become features.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    /// Name and range of every free scalar.
    free: Vec<(String, f64, f64)>,
    /// Degrees of azimuth that tell slices apart.
    turn_deg: f64,
}

/// An orthogonal map of x and y that takes `wo` to where slices were made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fold(DMat2);

impl Fold {
    /// `w` folded.
    pub fn apply(&self, w: DVec3) -> DVec3 {
        (self.0 * w.truncate()).extend(w.z)
    }

    /// `w` unfolded.
    pub fn undo(&self, w: DVec3) -> DVec3 {
        (self.0.transpose() * w.truncate()).extend(w.z)
    }
}

impl Condition {
    /// The condition of `material`'s slices.
    pub fn new(material: &Material) -> Condition {
        Condition {
            free: material.free(),
            turn_deg: azimuths_deg(material),
        }
    }

    /// Number of features.
    pub fn width(&self) -> usize {
        GRAZING_FEATURES + self.free.len()
    }

    /// What takes `wo` to the azimuths that slices are made at.
    pub fn fold(&self, wo: DVec3) -> Fold {
        let sign = |v: f64| if v < 0.0 { -1.0 } else { 1.0 };
        Fold(match self.turn_deg {
            0.0 => DMat2::from_angle(-wo.y.atan2(wo.x)),
            90.0 => DMat2::from_diagonal(DVec2::new(sign(wo.x), sign(wo.y))),
            _ => DMat2::IDENTITY,
        })
    }

    /// Features of the slice with the values `parameters` of the free scalars at a folded `wo`: those of `wo` as our own
    /// networks see it, and every parameter on [−1, 1], even in what places are drawn evenly in.
    pub fn features(&self, parameters: &[f64], wo: DVec3) -> Vec<f64> {
        let share = |(value, (label, min, max)): (&f64, &(String, f64, f64))| {
            let even = |v: f64| if is_alpha(label) { v.sqrt() } else { v };
            let width = even(*max) - even(*min);
            match width > 0.0 {
                true => 2.0 * (even(*value) - even(*min)) / width - 1.0,
                false => 0.0,
            }
        };
        let parameters = parameters.iter().zip(&self.free).map(share);
        grazing(wo.to_array()).into_iter().chain(parameters).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::places;
    use bake_runtime::Rng;
    use bake_runtime::bsdf::direction;
    use bake_runtime::field::Fields;
    use std::path::Path;

    /// A rotation and its inverse.
    const ROUND_OFF: f64 = 1e-15;
    /// A square root and its square.
    const SHARE_TOL: f64 = 1e-12;

    fn condition(json: &str) -> (Material, Condition) {
        let fields: Fields = serde_json::from_str(json).expect("valid JSON");
        let material = Material::read("m", fields, Path::new("")).expect("known parameters");
        let condition = Condition::new(&material);
        (material, condition)
    }

    #[test]
    fn folds_lead_to_where_slices_are_made_and_back() {
        let mut rng = Rng::new(&[0xf01d]);
        for (json, turn) in [
            (r#"{"family":"conductor","alpha":[0.2,0.2],"ior":"gold"}"#, 0.0),
            (r#"{"family":"conductor","alpha":[0.2,0.1],"ior":"gold"}"#, 90.0),
        ] {
            let (_, condition) = condition(json);
            for _ in 0..100 {
                let wo = direction(90.0 * rng.uniform(), 360.0 * rng.uniform());
                let fold = condition.fold(wo);
                let there = fold.apply(wo);
                let azimuth = there.y.atan2(there.x).to_degrees();
                assert!(
                    azimuth > -ROUND_OFF.to_degrees() && azimuth < turn + 1e-9,
                    "{azimuth}"
                );
                assert!((fold.undo(there) - wo).length() < ROUND_OFF);
            }
        }
    }

    #[test]
    fn parameters_fill_their_range_as_places_do() {
        let (material, condition) = condition(
            r#"{"family":"conductor","alpha":[{"min":0.01,"max":1},0.1],"reflectance":[1,{"min":0.2,"max":0.6},0.5]}"#,
        );
        assert_eq!(condition.width(), GRAZING_FEATURES + 2);
        for x in [0.0, 0.3, 1.0] {
            let at = |(label, min, max): &(String, f64, f64)| places::value_at(label, *min, *max, x);
            let values: Vec<f64> = material.free().iter().map(at).collect();
            let features = condition.features(&values, DVec3::Z);
            for feature in &features[GRAZING_FEATURES..] {
                assert!((feature - (2.0 * x - 1.0)).abs() < SHARE_TOL);
            }
        }
    }
}
