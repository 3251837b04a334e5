//! Integrals over the hemisphere in the square of a chart, refined until they hold, with what is left as their error.

use crate::lobes::direction_at;
use crate::spline::{edge_cell_centre, edge_cell_weight};
use bake_runtime::Estimate;
use bake_runtime::chart::Chart;
use glam::DVec3;

/// Cells per side of the first and of the finest grid.
const CELLS: [usize; 2] = [32, 1024];
/// Change, over the integral of the brightest channel, at which the grid is fine enough: a twentieth of the smallest bias
/// that cards are held to.
const TOLERANCE: f64 = 2.5e-5;

/// ∫ f dω over the hemisphere, RGB, for f in sr⁻¹ that is about even in the square of `chart`.
///
/// Midpoints of cells that crowd towards the horizon, where a rough surface is bright in a layer too thin for even ones.
/// The error is the last change, which is larger than what is left.
pub fn integral(chart: &Chart, f: impl Fn(DVec3) -> DVec3) -> Estimate {
    let mut cells = CELLS[0];
    let mut coarse = sum(chart, cells, &f);
    loop {
        cells *= 2;
        let mean = sum(chart, cells, &f);
        let se = (mean - coarse).abs();
        if cells == CELLS[1] || se.max_element() <= TOLERANCE * mean.max_element() {
            return Estimate { mean, se };
        }
        coarse = mean;
    }
}

fn sum(chart: &Chart, cells: usize, f: &impl Fn(DVec3) -> DVec3) -> DVec3 {
    let n = cells * cells;
    let sum: DVec3 = (0..n)
        .map(|k| {
            let (wi, area) = direction_at(chart, edge_cell_centre(k, cells));
            f(wi) * (area * edge_cell_weight(k, cells))
        })
        .sum();
    sum / n as f64
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
                found.se.max_element() <= 2.0 * TOLERANCE,
                "{alpha:?} {theta}: {}",
                found.se
            );
        }
    }
}
