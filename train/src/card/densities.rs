//! What the evaluation and pdf networks of one slice score, by quadrature over the hemisphere.
//!
//! Nodes come from two charts, the one of the reference's sharp lobe and the even one, and each counts by the sum of both
//! densities (the balance heuristic, Veach and Guibas 1995): narrow light, broad light, and whatever a network puts where
//! there should be none are all resolved.

use super::batch::{BATCH, Buffers};
use super::bins::{Bins, SIDE};
use super::measure::Samples;
use super::truth::Truth;
use crate::lobes::direction_at;
use crate::spline::cell_centre;
use bake_runtime::bsdf::shifted_r2;
use bake_runtime::chart::Chart;
use bake_runtime::{Backend, Result};
use glam::DVec3;

/// Midpoints per side of a bin when the pdf network is integrated over it.
const PDF_SUB: usize = 4;
/// Cells per side of the sharp chart: a bin that holds many of their centres gets as many midpoints as [`PDF_SUB`]² of each.
const CHART_CELLS: usize = 64;
/// Bins that expect fewer samples are left out of χ², as its distribution asks.
const CHI2_MIN_EXPECTED: f64 = 5.0;
/// ε of the SMAPE (Bai et al. 2023, §5.2).
const SMAPE_EPSILON: f64 = 0.01;

/// Scores of the evaluation and the pdf network.
pub(super) struct Densities {
    pub eval_rel_l1: f64,
    pub eval_smape: f64,
    pub pdf_integral: f64,
}

/// ‖p − t‖₁ / (‖p‖₁ + ‖t‖₁ + ε) over the channels: L_eval of Bai et al. 2023, §5.2.
pub fn smape(predicted: DVec3, truth: DVec3) -> f64 {
    let sum = |v: DVec3| v.abs().element_sum();
    sum(predicted - truth) / (sum(predicted) + sum(truth) + SMAPE_EPSILON)
}

/// Measures both networks.
pub(super) fn densities(
    truth: &Truth,
    samples: &Samples,
    backend: &dyn Backend,
    buffers: &mut Buffers,
) -> Result<Densities> {
    let charts = [truth.chart, Chart::IDENTITY];
    let nodes = charts.iter().flat_map(|chart| {
        (0..samples.density as u64).map(move |k| chart.square_to_direction(shifted_r2(k, [0.0; 2])).0)
    });
    let nodes: Vec<[f64; 3]> = nodes.collect();
    let (mut error, mut energy, mut loss, mut integral) = (0.0, 0.0, 0.0, 0.0);
    for chunk in nodes.chunks(BATCH) {
        for (i, wi) in chunk.iter().enumerate() {
            buffers.set_wi(i, DVec3::from_array(*wi));
        }
        buffers.eval(backend)?;
        buffers.pdf(backend)?;
        for (i, wi) in chunk.iter().enumerate() {
            let density: f64 = charts.iter().map(|chart| chart.density(*wi)).sum();
            let measure = 1.0 / (density * samples.density as f64);
            let (found, f_cos) = (buffers.rgb(i), truth.binned.f_cos(buffers.wi(i)));
            error += (found - f_cos).abs().element_sum() * measure;
            energy += f_cos.element_sum() * measure;
            loss += smape(found, f_cos);
            integral += f64::from(buffers.scalar[i]) * measure;
        }
    }
    Ok(Densities {
        eval_rel_l1: error / energy,
        eval_smape: loss / nodes.len() as f64,
        pdf_integral: integral,
    })
}

/// sqrt(max(0, χ² − dof) / (N·mass)) of `counts` against the pdf network.
pub(super) fn chi2_effect(
    truth: &Truth,
    counts: &[u64],
    backend: &dyn Backend,
    buffers: &mut Buffers,
) -> Result<f64> {
    let mass = pdf_masses(&truth.binned.bins, &truth.chart, backend, buffers)?;
    let n = counts.iter().sum::<u64>() as f64;
    let (mut chi2, mut dof, mut covered) = (0.0, 0.0, 0.0);
    for (count, mass) in counts.iter().zip(&mass) {
        let expected = n * mass;
        if expected >= CHI2_MIN_EXPECTED {
            chi2 += (*count as f64 - expected).powi(2) / expected;
            dof += 1.0;
            covered += mass;
        }
    }
    Ok(((chi2 - dof).max(0.0) / (n * covered).max(f64::MIN_POSITIVE)).sqrt())
}

/// Integral of the pdf network over every bin.
fn pdf_masses(bins: &Bins, chart: &Chart, backend: &dyn Backend, buffers: &mut Buffers) -> Result<Vec<f64>> {
    let mut cells = vec![0usize; SIDE * SIDE];
    for k in 0..CHART_CELLS * CHART_CELLS {
        cells[bins.index(direction_at(chart, cell_centre(k, CHART_CELLS)).0)] += 1;
    }
    let side = |bin: usize| PDF_SUB * (cells[bin].max(1) as f64).sqrt().ceil() as usize;
    let nodes = (0..SIDE * SIDE).flat_map(|bin| {
        let own = bins.nodes(bin, side(bin));
        own.map(move |(wi, solid_angle)| (bin, wi, solid_angle))
    });
    let nodes: Vec<(usize, DVec3, f64)> = nodes.collect();
    let mut mass = vec![0.0; SIDE * SIDE];
    for chunk in nodes.chunks(BATCH) {
        for (i, (_, wi, _)) in chunk.iter().enumerate() {
            buffers.set_wi(i, *wi);
        }
        buffers.pdf(backend)?;
        for ((bin, _, solid_angle), pdf) in chunk.iter().zip(&buffers.scalar) {
            mass[*bin] += f64::from(*pdf) * solid_angle;
        }
    }
    Ok(mass)
}
