//! Our route: a chart per lobe, the Monge–Ampère equation in its square, and a marginal map where that cannot be solved.

use super::continuation::{self, Solved};
use super::map::ImportanceMap;
use super::potential::Potential;
use super::square_map::SquareMap;
use crate::error::Result;
use crate::lobes::{ALBEDO_MIN, LUMINANCE, Lobe, LobeSlice, direction_at};
use crate::slice::SliceTable;
use crate::spline::cell_centre;
use bake_runtime::chart::Chart;
use glam::DVec3;

/// Share of a uniform density mixed into what transport sees: keeps the map's derivative bounded where the
/// BSDF vanishes. It only shapes the proposal; weights come from the true model.
pub const UNIFORM_SHARE: f64 = 0.005;

/// How well a chart's map solves its equation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Residuals {
    /// The constant c, which a perfect solution does without.
    pub constant: f64,
    /// Root mean square residual of log det + log q − c.
    pub residual: f64,
    /// Mass that the density had to be softened by.
    pub softened: f64,
    /// Share of the square that folds.
    pub folds: f64,
    /// Share of the square that is not covered.
    pub uncovered: f64,
}

/// One lobe with its chart, its density and its map.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartMap {
    /// Where its square lies.
    pub chart: Chart,
    /// Probability of this chart: its part of the slice's energy.
    pub share: f64,
    /// The density in the square.
    pub table: SliceTable,
    /// Images of the cell centres, in the square.
    pub map: Vec<[f32; 2]>,
    /// Coefficients of the potential, in f32 so that a resumed run warm-starts from the same numbers; empty where there is
    /// none.
    pub potential: Vec<f32>,
    /// How well it solves its equation; zeros where there is no potential.
    pub residuals: Residuals,
    /// Whether the marginal map stands in.
    pub fallback: bool,
}

impl ChartMap {
    /// The map of its square.
    pub fn square_map(&self) -> SquareMap {
        if self.fallback {
            return SquareMap::marginal(&softened_logs(&self.table), self.table.cells);
        }
        let coefficients: Vec<f64> = self.potential.iter().map(|&c| f64::from(c)).collect();
        SquareMap::Potential(Potential::new(self.table.cells, &coefficients))
    }
}

/// ln of the density that transport sees: the table's luminance with the uniform share, mean 1.
fn softened_logs(table: &SliceTable) -> Vec<f64> {
    table
        .luminance()
        .iter()
        .map(|q| ((1.0 - UNIFORM_SHARE) * q + UNIFORM_SHARE).ln())
        .collect()
}

/// Solves the maps of the `charts` of a slice on `cells`² cells (16·2^k), each warm-started from the potential in `near`
/// at its place, if there is one.
///
/// # Errors
/// [`crate::Error::Slice`] for a lobe without energy.
pub fn solve(
    slice: &LobeSlice,
    charts: &[(Lobe, Chart)],
    cells: usize,
    near: &[Option<&[f32]>],
) -> Result<Vec<ChartMap>> {
    let mut maps = Vec::with_capacity(charts.len());
    for (i, (lobe, chart)) in charts.iter().enumerate() {
        if charts.len() > 1 && slice.energy(*lobe) <= ALBEDO_MIN {
            maps.push(black_chart(*chart, cells));
            continue;
        }
        let table = SliceTable::tabulate(slice, *lobe, chart, cells)?;
        let near: Option<Vec<f64>> = near
            .get(i)
            .copied()
            .flatten()
            .map(|phi| phi.iter().map(|&c| f64::from(c)).collect());
        maps.push(solve_chart(*chart, table, near.as_deref()));
    }
    let energy: f64 = maps.iter().map(|m| m.share).sum();
    maps.iter_mut().for_each(|m| m.share /= energy);
    Ok(maps)
}

/// What stands for a lobe without light beside another: an even density and the identity, with no share.
fn black_chart(chart: Chart, cells: usize) -> ChartMap {
    let plane = vec![ALBEDO_MIN.ln() as f32; cells * cells];
    ChartMap {
        chart,
        share: 0.0,
        table: SliceTable {
            cells,
            log_density: [0; 3].map(|_| plane.clone()),
        },
        map: (0..cells * cells)
            .map(|k| cell_centre(k, cells).map(|v| v as f32))
            .collect(),
        potential: vec![0.0; cells * cells],
        residuals: Residuals::default(),
        fallback: false,
    }
}

/// Solves one chart; its share is its energy still.
fn solve_chart(chart: Chart, table: SliceTable, near: Option<&[f64]>) -> ChartMap {
    let cells = table.cells;
    let log_q = softened_logs(&table);
    let share = table.albedo().dot(LUMINANCE);
    let solved = continuation::solve(&log_q, cells, near);
    let (square, potential, residuals) = match solved {
        Some(Solved {
            transport,
            softened,
            folds,
            uncovered,
        }) => (
            SquareMap::Potential(Potential::new(cells, &transport.potential)),
            transport.potential.iter().map(|&c| c as f32).collect(),
            Residuals {
                constant: transport.constant,
                residual: transport.residual,
                softened,
                folds,
                uncovered,
            },
        ),
        None => (
            SquareMap::marginal(&log_q, cells),
            Vec::new(),
            Residuals::default(),
        ),
    };
    let map = (0..cells * cells)
        .map(|k| square.at(cell_centre(k, cells)).0.map(|v| v as f32))
        .collect();
    ChartMap {
        chart,
        share,
        table,
        map,
        fallback: potential.is_empty(),
        potential,
        residuals,
    }
}

/// The map of a whole slice, ready to be sampled.
#[derive(Clone, Debug)]
pub struct FrameMap {
    /// Per chart: its probability, its place, its map.
    charts: Vec<(f64, Chart, SquareMap)>,
}

impl FrameMap {
    /// The map made of these charts.
    pub fn new(charts: &[ChartMap]) -> FrameMap {
        FrameMap {
            charts: charts
                .iter()
                .map(|c| (c.share, c.chart, c.square_map()))
                .collect(),
        }
    }

    /// The chart that `u` falls into, and where in its own unit square.
    fn locate(&self, u: [f64; 2]) -> (&(f64, Chart, SquareMap), [f64; 2]) {
        let mut start = 0.0;
        let last = self.charts.len() - 1;
        for chart in &self.charts[..last] {
            if u[0] < start + chart.0 {
                return (chart, [(u[0] - start) / chart.0, u[1]]);
            }
            start += chart.0;
        }
        let chart = &self.charts[last];
        (chart, [((u[0] - start) / chart.0).clamp(0.0, 1.0), u[1]])
    }

    /// Direction for `u`, and the signed solid angle per unit of `u` (sr).
    pub fn direction(&self, u: [f64; 2]) -> (DVec3, f64) {
        let ((share, chart, map), local) = self.locate(u);
        let (s, determinant) = map.at(local);
        let (wi, area) = direction_at(chart, s);
        (wi, area * determinant / share)
    }
}

impl ImportanceMap for FrameMap {
    fn at(&self, u: [f64; 2]) -> [f64; 2] {
        let (wi, _) = self.direction(u);
        [wi.x, wi.y]
    }

    fn determinant(&self, u: [f64; 2]) -> f64 {
        let ((_, _, map), local) = self.locate(u);
        map.at(local).1
    }

    fn breaks(&self) -> Vec<f64> {
        let mut end = 0.0;
        self.charts[..self.charts.len() - 1]
            .iter()
            .map(|c| {
                end += c.0;
                end
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lobes::WALKS;
    use bake_runtime::bsdf::{direction, shifted_r2};
    use bake_runtime::layered::Layered;
    use bake_runtime::principled::{Principled, PrincipledParameters};

    /// Cells per side of the maps.
    const CELLS: usize = 64;
    /// The mean over 2¹⁴ R2 points of a weight that varies by a few percent.
    const ALBEDO_TOL: f64 = 2e-3;
    /// Finite differences with step 1e-6 across a map that stretches by up to a hundred.
    const DIFFERENCE_TOL: f64 = 1e-3;

    fn plastic() -> Principled {
        Principled::new(PrincipledParameters {
            roughness: 0.2,
            ..PrincipledParameters::default()
        })
        .expect("valid parameters")
    }

    fn map_of(slice: &LobeSlice) -> Vec<ChartMap> {
        solve(slice, &slice.fitted(), CELLS, &[None, None]).expect("bright lobes")
    }

    /// The weight of a chart's sample is its own lobe over its own density, so the mean is the albedo.
    #[test]
    fn two_charts_carry_the_whole_albedo() {
        let bsdf = plastic();
        let wo = direction(60.0, 0.0);
        let slice = LobeSlice::new(&bsdf, wo, 1, 0).expect("bright");
        let charts = map_of(&slice);
        assert_eq!(charts.len(), 2);
        let map = FrameMap::new(&charts);
        let n = 1 << 14;
        let split = map.breaks()[0];
        let sum: f64 = (0..n)
            .map(|i| {
                let u = shifted_r2(i, [0.0; 2]);
                let (wi, jacobian) = map.direction(u);
                let lobe = if u[0] < split { Lobe::Sharp } else { Lobe::Smooth };
                slice.f_cos(lobe, wi).dot(LUMINANCE) * jacobian
            })
            .sum();
        let albedo: f64 = charts.iter().map(|c| c.table.albedo().dot(LUMINANCE)).sum();
        assert!(
            (sum / n as f64 / albedo - 1.0).abs() < ALBEDO_TOL,
            "{} {albedo}",
            sum / n as f64
        );
    }

    #[test]
    fn determinants_belong_to_images_of_both_kinds_of_map() {
        let bsdf = Layered::new(0.3, 1.5, 1.0, [0.8; 3], [0.5; 3], 0.0).expect("valid parameters");
        let slice = LobeSlice::new(&bsdf, direction(70.0, 0.0), WALKS, 0).expect("bright");
        let mut charts = map_of(&slice);
        for fallback in [false, true] {
            if fallback {
                charts[0].fallback = true;
            }
            let map = charts[0].square_map();
            let h = 1e-6;
            for k in 0..200 {
                let u = shifted_r2(k, [0.0; 2]).map(|v| 0.02 + 0.96 * v);
                let (_, determinant) = map.at(u);
                let d = |e: [f64; 2]| {
                    let (a, _) = map.at([u[0] + e[0], u[1] + e[1]]);
                    let (b, _) = map.at([u[0] - e[0], u[1] - e[1]]);
                    [0, 1].map(|c: usize| (a[c] - b[c]) / (2.0 * h))
                };
                let (x, y) = (d([h, 0.0]), d([0.0, h]));
                let found = x[0] * y[1] - x[1] * y[0];
                assert!(determinant > 0.0);
                assert!(
                    (found / determinant - 1.0).abs() < DIFFERENCE_TOL,
                    "{found} {determinant}"
                );
            }
        }
    }
}
