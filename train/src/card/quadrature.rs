//! Integrals over the hemisphere in the square of a chart, refined until they hold, with what is left as their error.

use crate::lobes::direction_at;
use crate::spline::{cell_centre, crowd};
use bake_runtime::Estimate;
use bake_runtime::chart::Chart;
use glam::DVec3;

/// Cells per side of the first and of the finest grid.
const CELLS: [usize; 2] = [16, 1024];
/// Change, over the integral of the brightest channel, at which the grid is fine enough: a twentieth of the smallest bias
/// that cards are held to.
const TOLERANCE: f64 = 2.5e-5;

/// ∫ f dω over the hemisphere, RGB, for f in sr⁻¹ that is about even in the square of `chart`.
///
/// Midpoints of cells that crowd towards the edges, twice over: at grazing views a rough surface is bright in a layer at
/// the horizon that is too thin for even cells, and cells crowded once gain little by being halved. The error is the last
/// change, or half of the one before, as a change may be small by chance: both are larger than what is left.
pub fn integral(chart: &Chart, f: impl Fn(DVec3) -> DVec3) -> Estimate {
    let mut cells = CELLS[0];
    let mut coarse = sum(chart, cells, &f);
    let mut before = coarse;
    loop {
        cells *= 2;
        let mean = sum(chart, cells, &f);
        let change = (mean - coarse).abs();
        let se = change.max(0.5 * before);
        if cells == CELLS[1] || se.max_element() <= TOLERANCE * mean.max_element() {
            return Estimate { mean, se };
        }
        (coarse, before) = (mean, change);
    }
}

fn sum(chart: &Chart, cells: usize, f: &impl Fn(DVec3) -> DVec3) -> DVec3 {
    let slope = |t: f64| 6.0 * t * (1.0 - t);
    let sum: DVec3 = (0..cells * cells)
        .map(|k| {
            let t = cell_centre(k, cells);
            let once = t.map(crowd);
            let weight: f64 = t.iter().chain(&once).map(|t| slope(*t)).product();
            let (wi, area) = direction_at(chart, once.map(crowd));
            f(wi) * (area * weight)
        })
        .sum();
    sum / (cells * cells) as f64
}

/// Both together; their errors are independent.
pub fn both(a: Estimate, b: Estimate) -> Estimate {
    Estimate {
        mean: a.mean + b.mean,
        se: (a.se * a.se + b.se * b.se).map(f64::sqrt),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lobes::{Lobe, LobeSlice};
    use bake_runtime::bsdf::direction;
    use bake_runtime::conductor::Conductor;

    #[test]
    fn integrals_keep_to_their_errors() {
        for (alpha, theta) in [
            ([0.01, 0.01], 30.0),
            ([0.02, 0.6], 80.0),
            ([0.02, 0.6], 88.0),
            ([0.3, 0.1], 89.0),
            ([1.0, 1.0], 60.0),
        ] {
            let bsdf = Conductor::new(alpha, [1.0, 0.8, 0.3]).expect("valid parameters");
            let wo = direction(theta, 20.0);
            let chart = LobeSlice::new(&bsdf, wo, 1, 0)
                .expect("bright")
                .chart(Lobe::Sharp);
            let found = integral(&chart, |wi| bsdf.single(wo, wi));
            let fine = sum(&chart, 2 * CELLS[1], &|wi| bsdf.single(wo, wi));
            let error = (found.mean - fine).abs();
            assert!(
                error.cmple(found.se).all(),
                "{alpha:?} {theta}: {error} {}",
                found.se
            );
            assert!(
                found.se.max_element() <= TOLERANCE * found.mean.max_element(),
                "{alpha:?} {theta}: {}",
                found.se
            );
        }
    }
}
