//! One slice as every sampler draws it.

use super::Model;
use super::report::Row;
use anyhow::Result;
use bake_scenes::map_picture::{Comparison, MapPanel, Square, write_sheet};
use bake_train::card::bins::SIDE;
use bake_train::card::heldout::HeldOut;
use bake_train::comparators::figure::{Figure, Portrait, TARGET_SIDE};
use std::path::Path;

/// Writes the picture of `drawn`, the slice of the material of `model` at `place`; `rows` name its samplers.
pub fn write(path: &Path, model: &Model, place: &HeldOut, drawn: &Figure, rows: &[Row]) -> Result<()> {
    let material = &model.networks.sample.spec.material;
    let square = |side: usize, values: &[f64]| Square {
        side,
        values: values.to_vec(),
    };
    let panel = |(row, portrait): (&Row, &Portrait)| {
        let errors = &portrait.errors;
        let mut lines = vec![
            format!(
                "binning {:.4} (floor {:.4})",
                errors.binning_l1, errors.binning_floor
            ),
            format!(
                "variance {:.2e}, largest weight {:.1}",
                errors.weight_relvar, errors.weight_max
            ),
        ];
        if errors.lost > 0.0 {
            lines.push(format!("{:.2} % below the horizon", 100.0 * errors.lost));
        }
        MapPanel {
            title: row.title().into(),
            lines,
            map: positions(&portrait.map),
            bins: square(SIDE, &portrait.bins),
            reference: square(SIDE, &drawn.reference),
        }
    };
    let solved = MapPanel {
        title: "solved map".into(),
        lines: vec![
            format!(
                "binning {:.4} (floor {:.4})",
                drawn.solved.binning_l1, drawn.solved.binning_floor
            ),
            "by transport, no network".into(),
        ],
        map: positions(&drawn.solved.map),
        bins: square(SIDE, &drawn.solved.bins),
        reference: square(SIDE, &drawn.reference),
    };
    let theta = place.wo.z.acos().to_degrees();
    let phi = place.wo.y.atan2(place.wo.x).to_degrees();
    let mut lines = vec![match drawn.narrow {
        true => "bins in the square of the lobe's chart: it is too narrow for the disk".to_string(),
        false => "bins on the disk".to_string(),
    }];
    let free = material.free();
    lines.extend(
        free.iter()
            .zip(&place.params)
            .map(|((label, ..), value)| format!("{label} {value:.4}")),
    );
    let comparison = Comparison {
        title: format!("{}, θ {theta:.1}°, φ {phi:.1}°", material.name),
        lines,
        target: square(TARGET_SIDE, &drawn.target),
        disk: true,
        panels: std::iter::once(solved)
            .chain(rows.iter().zip(&drawn.portraits).map(panel))
            .collect(),
    };
    Ok(write_sheet(path, &[comparison])?)
}

fn positions(map: &[[f64; 2]]) -> Square<[f32; 2]> {
    Square {
        side: SIDE,
        values: map.iter().map(|p| p.map(|v| v as f32)).collect(),
    }
}
