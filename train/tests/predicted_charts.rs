//! Predicted charts beside fitted ones: a lobe should be about as even in the chart that a network predicts as in the one
//! that is fitted to it, because what unevenness is left is the sampling network's work.

use bake_runtime::{BakedMaterial, oracle};
use bake_train::card::heldout::{self, STRATA};
use bake_train::lobes::{LobeSlice, WALKS};
use bake_train::presets;
use bake_train::slice::SliceTable;
use bake_train::spline::edge_cell_weight;
use glam::DVec3;
use std::path::Path;

/// Cells per side of the squares that are looked at.
const CELLS: usize = 48;
/// Every so many of the held-out places are looked at.
const EVERY: usize = 4;
/// How much larger the variance of a lobe in its predicted chart may be, in the mean over places. The fit itself is no
/// optimum of this variance, so single places may gain.
const VARIANCE_RATIO: f64 = 1.25;

/// Variance of the luminance density over the square, relative to its mean.
fn variance(table: &SliceTable) -> f64 {
    let density = table.luminance();
    let squares = density
        .iter()
        .enumerate()
        .map(|(k, q)| q * q * edge_cell_weight(k, table.cells));
    squares.sum::<f64>() / density.len() as f64 - 1.0
}

#[test]
fn lobes_are_as_even_in_predicted_charts_as_in_fitted_ones() {
    for name in ["vase", "conductor", "layered", "principled"] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../scenes/materials")
            .join(name);
        let network = BakedMaterial::load(&folder).expect("the material ships").sample;
        let spec = network.spec.charts().expect("the warp preset has charts");
        let lobes = presets::lobes(network.spec.material.family);
        let places = heldout::places(&network.spec.material).expect("few free parameters");
        for stratum in STRATA {
            let (mut predicted, mut fitted) = (0.0, 0.0);
            for place in places[stratum].iter().step_by(EVERY) {
                let (wo, _) = oracle::fold(network.spec.symmetry, place.wo.to_array());
                let bsdf = network.spec.material.bind(&place.params).expect("in the domain");
                let slice = LobeSlice::new(&bsdf, DVec3::from_array(wo), WALKS, 0).expect("a bright slice");
                let charts = oracle::charts_of(&network, &place.params, wo);
                for ((lobe, anchor), (_, chart)) in lobes.iter().zip(&spec.anchors).zip(&charts) {
                    let start = anchor.chart(wo, spec.alpha_at(&place.params));
                    let fit = slice.fitted_from(*lobe, &start);
                    let table =
                        |chart| SliceTable::tabulate(&slice, *lobe, chart, CELLS).map(|t| variance(&t));
                    // A lobe without light has no variance.
                    if let (Ok(of_predicted), Ok(of_fitted)) = (table(chart), table(&fit)) {
                        predicted += of_predicted;
                        fitted += of_fitted;
                    }
                }
            }
            assert!(fitted > 0.0);
            assert!(
                predicted <= VARIANCE_RATIO * fitted,
                "{name}, {stratum}: {predicted} against {fitted}"
            );
        }
    }
}
