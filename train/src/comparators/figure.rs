//! One slice as every sampler draws it: the map from u and the bins that its samples fall into, beside the truth.
//!
//! What Bai et al. 2023 show in their Figs. 9 and 12.

use super::SliceSampler;
use super::measure::{Errors, Histogram, histogram, measure};
use super::standings::Contender;
use crate::card::bins::{Bins, SIDE, l1};
use crate::card::heldout::{self, HeldOut};
use crate::card::measure::BINNING_POINTS;
use crate::card::truth::Truth;
use crate::error::Result;
use crate::lobes::{LobeSlice, WALKS};
use crate::maps::{CELLS, WALK_SEED};
use crate::presets::{lobes, symmetry};
use crate::spline::cell_centre;
use crate::transport::disk_map::raster;
use crate::transport::frame_map::{self, FrameMap};
use crate::transport::measure::{count, shares};
use bake_runtime::oracle::{fold, unfold};
use bake_runtime::{Bsdf, Material, Reference};
use glam::DVec3;

/// Roughness along one axis over that along the other, and polar angle, that a slice should have to be shown: those of the
/// vase, plain to see and no mere line, in between the normal and the horizon.
const RATIO: f64 = 3.0;
/// See [`RATIO`]; degrees.
const THETA_DEG: f64 = 60.0;

/// Pixels per side of the slice itself.
pub const TARGET_SIDE: usize = 4 * SIDE;

/// One sampler on the slice.
pub struct Portrait {
    /// x and y of the directions at the centres of [`SIDE`]² cells of u; NaN where there are none.
    pub map: Vec<[f64; 2]>,
    /// Shares of its samples in the bins.
    pub bins: Vec<f64>,
    /// What it is judged by.
    pub errors: Errors,
}

/// The importance map of the slice, as samplers should know it.
pub struct Solved {
    /// As [`Portrait::map`].
    pub map: Vec<[f64; 2]>,
    /// As [`Portrait::bins`].
    pub bins: Vec<f64>,
    /// As [`Errors::binning_l1`].
    pub binning_l1: f64,
    /// As [`Errors::binning_floor`].
    pub binning_floor: f64,
}

/// The slice and what samplers make of it.
pub struct Figure {
    /// Its density on [−1, 1]², [`TARGET_SIDE`]² pixels.
    pub target: Vec<f64>,
    /// Shares that belong into the bins.
    pub reference: Vec<f64>,
    /// Whether bins lie in the square of the lobe's chart, because the lobe is too narrow for the disk.
    pub narrow: bool,
    /// Its importance map by transport alone, on [`CELLS`]² cells, with fitted charts for the [`lobes`] of its family.
    pub solved: Solved,
    /// The samplers, in their order.
    pub portraits: Vec<Portrait>,
}

/// The held-out place of `material` that is shown: θ_o near 60°, the sharp lobe about three times as rough along one axis as
/// along the other where the material can be.
///
/// # Errors
/// As [`heldout::places`] and [`Material::bind`].
pub fn place(material: &Material) -> Result<HeldOut> {
    let mut places = heldout::places(material)?;
    let mut best: Option<(f64, HeldOut)> = None;
    for place in places.remove(heldout::STRATA[0]).unwrap_or_default() {
        let reference = material.bind(&place.params)?;
        let [x, y] = reference.slice(place.wo, 0, 0).alpha();
        let theta = place.wo.z.acos().to_degrees();
        let far = ((x / y).ln().abs() - RATIO.ln()).abs() + (theta / THETA_DEG).ln().abs();
        if best.as_ref().is_none_or(|(nearest, _)| far < *nearest) {
            best = Some((far, place));
        }
    }
    let (_, place) = best.unwrap_or_else(|| unreachable!("every stratum has places"));
    Ok(place)
}

/// Draws the slice of `material` at `place` with every one of `contenders`.
///
/// # Errors
/// As [`super::standings::standings`].
pub fn figure(material: &Material, place: &HeldOut, contenders: &[Contender]) -> Result<Figure> {
    let reference = material.bind(&place.params)?;
    let truth = Truth::new(&reference, place.wo)?;
    let total: f64 = truth.binned.mass.iter().sum();
    let draw = |contender: &Contender| portrait(contender(place, &truth)?.as_mut(), &reference, &truth);
    Ok(Figure {
        target: raster(&truth.lobes, TARGET_SIDE)?.mass,
        reference: truth.binned.mass.iter().map(|m| m / total).collect(),
        narrow: truth.binned.bins != Bins::Disk,
        solved: solved(material, &reference, &truth)?,
        portraits: contenders.iter().map(draw).collect::<Result<_>>()?,
    })
}

/// Solves the importance map of the slice that `truth` was measured of, folded and cut into lobes as networks see it.
fn solved(material: &Material, reference: &Reference, truth: &Truth) -> Result<Solved> {
    let (wo, unfolding) = fold(symmetry(material)?, truth.wo.to_array());
    let slice = LobeSlice::new(reference, DVec3::from_array(wo), WALKS, WALK_SEED)?;
    let charts: Vec<_> = lobes(material.family)
        .iter()
        .map(|lobe| (*lobe, slice.chart(*lobe)))
        .collect();
    let map = FrameMap::new(&frame_map::solve(&slice, &charts, CELLS, &[])?);
    let direction = |u: [f64; 2]| DVec3::from_array(unfold(unfolding, map.direction(u).0.to_array()));
    let counts = count(BINNING_POINTS, |u| truth.binned.bins.index(direction(u)));
    let centres = (0..SIDE * SIDE).map(|k| direction(cell_centre(k, SIDE)));
    Ok(Solved {
        map: centres.map(|wi| [wi.x, wi.y]).collect(),
        bins: shares(&counts, BINNING_POINTS),
        binning_l1: l1(&counts, &truth.binned.mass),
        binning_floor: truth.binned.floor(BINNING_POINTS),
    })
}

fn portrait(sampler: &mut dyn SliceSampler, reference: &Reference, truth: &Truth) -> Result<Portrait> {
    let u: Vec<[f64; 2]> = (0..SIDE * SIDE).map(|k| cell_centre(k, SIDE)).collect();
    let mut drawn = vec![None; u.len()];
    sampler.draw(&u, &mut drawn)?;
    let Histogram { counts, .. } = histogram(sampler, truth, BINNING_POINTS)?;
    Ok(Portrait {
        map: drawn
            .iter()
            .map(|d| d.map_or([f64::NAN; 2], |d| [d.wi.x, d.wi.y]))
            .collect(),
        bins: shares(&counts, BINNING_POINTS),
        errors: measure(sampler, reference, truth, 0)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::comparators::blinn_phong::BlinnPhong;
    use bake_runtime::field::Fields;
    use std::path::Path;

    fn material(json: &str) -> Material {
        let fields: Fields = serde_json::from_str(json).expect("valid JSON");
        Material::read("m", fields, Path::new("")).expect("known parameters")
    }

    #[test]
    fn the_slice_shown_is_anisotropic_where_one_can_be() {
        let free = r#"{"min":0.01,"max":1}"#;
        for (json, expected) in [
            (
                r#"{"family":"conductor","alpha":[0.3,0.1],"ior":"gold"}"#.to_string(),
                3.0,
            ),
            (
                r#"{"family":"conductor","alpha":[0.2,0.2],"ior":"gold"}"#.to_string(),
                1.0,
            ),
            (
                format!(r#"{{"family":"conductor","alpha":[{free},{free}],"ior":"gold"}}"#),
                3.0,
            ),
        ] {
            let material = material(&json);
            let place = place(&material).expect("few are free");
            let theta = place.wo.z.acos().to_degrees();
            let [x, y] = match place.params[..] {
                [x, y] => [x, y],
                _ => [expected, 1.0],
            };
            let ratio = (x / y).max(y / x);
            assert!((45.0..75.0).contains(&theta), "{json}: {theta}");
            assert!((ratio / expected).ln().abs() < 0.3, "{json}: {ratio}");
        }
    }

    /// A map of 64² cells against the slice itself; turned into another quadrant it would be off by more than 1.
    const SOLVED_MAX: f64 = 0.02;

    #[test]
    fn the_solved_map_lies_where_the_slice_does() {
        let material = material(r#"{"family":"conductor","alpha":[0.3,0.1],"ior":"gold"}"#);
        let mut place = place(&material).expect("nothing is free");
        for signs in [DVec3::ONE, DVec3::new(-1.0, 1.0, 1.0), DVec3::new(1.0, -1.0, 1.0)] {
            place.wo *= signs;
            let Figure {
                solved, reference, ..
            } = figure(&material, &place, &[]).expect("a bright slice");
            let off: f64 = solved
                .bins
                .iter()
                .zip(&reference)
                .map(|(a, b)| (a - b).abs())
                .sum();
            assert!(
                (off - solved.binning_l1).abs() < 1e-12,
                "{off} {}",
                solved.binning_l1
            );
            assert!(
                off < SOLVED_MAX && off < 4.0 * solved.binning_floor,
                "{off} at {}",
                place.wo
            );
            assert!(solved.map.iter().all(|[x, y]| x.hypot(*y) <= 1.0));
        }
    }

    #[test]
    fn what_is_lost_has_no_place_in_the_map_and_is_missing_in_the_bins() {
        let material = material(r#"{"family":"conductor","alpha":[0.3,0.1],"ior":"gold"}"#);
        let place = place(&material).expect("nothing is free");
        let broad: Contender = &|place, _| {
            Ok(Box::new(BlinnPhong {
                wo: place.wo,
                exponent: 2.0,
                share: 1.0,
            }))
        };
        let figure = figure(&material, &place, &[broad]).expect("a bright slice");
        let Portrait { map, bins, errors } = &figure.portraits[0];
        let lost = map.iter().filter(|p| p[0].is_nan()).count() as f64 / map.len() as f64;
        let missing = 1.0 - bins.iter().sum::<f64>();
        assert!(lost > 0.05 && (lost - missing).abs() < 5e-3, "{lost} {missing}");
        assert!((figure.reference.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert_eq!(figure.target.len(), TARGET_SIDE * TARGET_SIDE);
        assert!((errors.lost - missing).abs() < 1e-12, "{} {missing}", errors.lost);
    }
}
