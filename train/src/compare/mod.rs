//! All solvers on one target, with what each is judged by: the rows of `bake maps --compare`.

mod truth;

use crate::Tick;
use crate::card::bins::{Bins, SIDE, l1};
use crate::error::{Error, Result};
use crate::lobes::{LobeSlice, WALKS};
use crate::maps::WALK_SEED;
use crate::places::{azimuths_deg, is_alpha, value_at};
use crate::transport::frame_map::{self, FrameMap};
use crate::transport::map::{ImportanceMap, MapImage};
use crate::transport::measure::{self, Domain};
use crate::transport::raster::Raster;
use crate::transport::square_map::PictureMap;
use crate::transport::{Solver, disk_map, hierarchical, kantorovich, marginal, points, sinkhorn_sliced};
use bake_runtime::bsdf::direction;
use bake_runtime::chart::Chart;
use bake_runtime::{Material, Reference};
use glam::DVec3;
use serde::Serialize;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;
use truth::{BINNING_POINTS, Truth};

/// Azimuth of `wo`, degrees from x, where it matters: neither an axis of the surface nor the middle between two.
const PHI_DEG: f64 = 30.0;

/// One solver on one target: a row of the table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The target.
    pub slice: String,
    /// The solver.
    pub solver: &'static str,
    /// Cells of the map, or points.
    pub n: usize,
    /// Mean squared distance on [−1, 1]² over that of the exact assignment of as many row-column points, or, where these
    /// are too many, over a lower bound of it.
    pub cost_ratio: f64,
    /// Share of the square where the map's determinant is not positive.
    pub fold_fraction: f64,
    /// Largest singular value of the derivative on [−1, 1]².
    pub max_stretch: f64,
    /// Share of samples in the wrong one of 64² bins, twice counted.
    pub binning_l1: f64,
    /// What a perfect map would score.
    pub binning_floor: f64,
    /// Share of samples outside the disk, for a picture outside the square.
    pub outside: f64,
    /// Wall seconds from the density to the map.
    pub seconds: f64,
    /// What stands in for the map that the solver should have made; `null` as a rule.
    pub fallback: Option<&'static str>,
}

/// One row with what pictures show of it.
pub struct Compared {
    /// The numbers.
    pub row: Row,
    /// Positions of the centres of [`SIDE`]² cells of u.
    pub map: Vec<[f64; 2]>,
    /// Shares of samples in the bins.
    pub bins: Vec<f64>,
}

/// All rows of one target.
pub struct Comparison {
    /// The target.
    pub slice: String,
    /// Its density on [−1, 1]², [`SIDE`]² pixels.
    pub target: Vec<f64>,
    /// Whether that is the disk of directions.
    pub disk: bool,
    /// Whether bins lie in the square of the lobe's chart, because the lobe is too narrow for the disk.
    pub narrow: bool,
    /// Shares that belong into the bins.
    pub reference: Vec<f64>,
    /// The rows, in the order of sides and solvers.
    pub rows: Vec<Compared>,
}

/// What maps are compared on.
pub enum Target {
    /// A slice of a reference model.
    Slice {
        /// Its name.
        name: String,
        /// The model.
        bsdf: Box<Reference>,
        /// Camera direction.
        wo: DVec3,
    },
    /// A picture over [−1, 1]².
    Picture {
        /// Its name.
        name: String,
        /// Its density.
        raster: Raster,
    },
}

/// The slices that stand for a material: the polar angles `thetas_deg` of `wo` at its smallest, middle and largest
/// roughness, everything else that is free in the middle of its range.
///
/// # Errors
/// As [`Material::bind`].
pub fn slices_of(material: &Material, thetas_deg: &[f64]) -> Result<Vec<Target>> {
    let free = material.free();
    let rough = |label: &str| is_alpha(label) || label == "roughness";
    let shares: &[f64] = match free.iter().any(|(label, ..)| rough(label)) {
        true => &[0.0, 0.5, 1.0],
        false => &[0.5],
    };
    let phi = if azimuths_deg(material) > 0.0 {
        PHI_DEG
    } else {
        0.0
    };
    let mut targets = Vec::new();
    for share in shares {
        let at = |label: &str| if rough(label) { *share } else { 0.5 };
        let values: Vec<f64> = free
            .iter()
            .map(|(label, min, max)| value_at(label, *min, *max, at(label)))
            .collect();
        let mut named = free.iter().zip(&values).filter(|((label, ..), _)| rough(label));
        let roughness = named.next().map(|((label, ..), value)| {
            let word = label.split('[').next().unwrap_or(label);
            format!("{word} {value:.3} ")
        });
        let bsdf = material.bind(&values)?;
        for &theta in thetas_deg {
            targets.push(Target::Slice {
                name: format!(
                    "{} {}θ {theta}°",
                    material.name,
                    roughness.as_deref().unwrap_or("")
                ),
                bsdf: Box::new(bsdf.clone()),
                wo: direction(theta, phi),
            });
        }
    }
    Ok(targets)
}

/// A map with what it took.
struct Made {
    map: Box<dyn ImportanceMap>,
    seconds: f64,
    fallback: Option<&'static str>,
}

/// Where maps start from.
enum Source<'a> {
    Slice(&'a LobeSlice<'a>),
    Picture(&'a Raster),
}

impl Source<'_> {
    fn raster(&self, side: usize) -> Result<Raster> {
        match self {
            Source::Slice(slice) => disk_map::raster(slice, side),
            Source::Picture(raster) => Ok((*raster).clone()),
        }
    }
}

/// Runs `solvers` on `target` with maps of `sides`² cells each (16·2^k); exact assignment only where it is not too large.
///
/// # Errors
/// [`Error::Slice`] or [`Error::Density`] for a target without energy; [`Error::Interrupted`] when `tick` breaks.
pub fn compare(
    target: &Target,
    solvers: &[Solver],
    sides: &[usize],
    seed: u64,
    tick: Tick,
) -> Result<Comparison> {
    match target {
        Target::Slice { name, bsdf, wo } => {
            let slice = LobeSlice::new(&**bsdf, *wo, WALKS, WALK_SEED)?;
            let chart = slice.sharp_chart().unwrap_or(Chart::IDENTITY);
            let truth = Truth::of_slice(bsdf, *wo, &chart);
            run(name, &Source::Slice(&slice), truth, solvers, sides, seed, tick)
        }
        Target::Picture { name, raster } => {
            let truth = Truth::of_picture(raster);
            run(name, &Source::Picture(raster), truth, solvers, sides, seed, tick)
        }
    }
}

fn run(
    name: &str,
    source: &Source,
    truth: Truth,
    solvers: &[Solver],
    sides: &[usize],
    seed: u64,
    tick: Tick,
) -> Result<Comparison> {
    let mut rows = Vec::new();
    let total = (sides.len() * (solvers.len() + 1)) as u64;
    let done = AtomicU64::new(0);
    let step = || match tick(done.fetch_add(1, Ordering::Relaxed), total) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(Error::Interrupted),
    };
    // Inside a step only whether to go on matters.
    let inner: Tick = &|_, _| tick(done.load(Ordering::Relaxed).saturating_sub(1), total);
    for side in sides {
        step()?;
        let raster = source.raster(*side)?;
        let points = PointRoute::new(&raster, *side, seed, inner)?;
        for solver in solvers {
            step()?;
            let Some(made) = make(&raster, source, *solver, *side, &points)? else {
                continue;
            };
            rows.push(judge(name, &made, *solver, *side, points.cost, &truth));
        }
    }
    Ok(Comparison {
        slice: name.to_string(),
        target: measure::reference_bins(&source.raster(2 * SIDE)?),
        disk: truth.domain == Domain::Disk,
        narrow: truth.bins != Bins::Disk,
        reference: truth.reference,
        rows,
    })
}

/// The paper's route with what else its points tell.
struct PointRoute {
    image: MapImage,
    seconds: f64,
    /// The exact assignment of the same points and its seconds, where they are not too many.
    exact: Option<(MapImage, f64)>,
    /// What costs are divided by: the exact assignment's, or a lower bound of it.
    cost: f64,
}

impl PointRoute {
    fn new(raster: &Raster, side: usize, seed: u64, tick: Tick) -> Result<PointRoute> {
        let clock = Instant::now();
        let near = sinkhorn_sliced::solve(raster, side, seed, tick)?;
        let seconds = clock.elapsed().as_secs_f64();
        let (exact, cost) = if side * side <= disk_map::EXACT_MAX {
            let (map, cost) = disk_map::exact(&near)?;
            (Some((map, clock.elapsed().as_secs_f64())), cost)
        } else {
            let source = points::source_points(side);
            (
                None,
                kantorovich::lower_bound(&source, &near.points, &near.duals[1]),
            )
        };
        Ok(PointRoute {
            image: near.map,
            seconds,
            exact,
            cost,
        })
    }
}

/// Makes one map; `None` for an exact assignment of too many points.
fn make(
    raster: &Raster,
    source: &Source,
    solver: Solver,
    side: usize,
    points: &PointRoute,
) -> Result<Option<Made>> {
    let clock = Instant::now();
    let image = |image: MapImage, seconds: f64| Made {
        map: Box::new(image),
        seconds,
        fallback: None,
    };
    let fallback = |any: bool| any.then_some(Solver::Marginal.name());
    Ok(Some(match (solver, source) {
        (Solver::Marginal, _) => {
            let map = marginal::solve(raster, side);
            image(map, clock.elapsed().as_secs_f64())
        }
        (Solver::Hierarchical, _) => {
            let map = hierarchical::solve(raster, side);
            image(map, clock.elapsed().as_secs_f64())
        }
        (Solver::SinkhornSliced, _) => image(points.image.clone(), points.seconds),
        (Solver::Exact, _) => match &points.exact {
            Some((map, seconds)) => image(map.clone(), *seconds),
            None => return Ok(None),
        },
        (Solver::Frame, Source::Picture(raster)) => {
            let map = PictureMap::new(raster, side);
            Made {
                seconds: clock.elapsed().as_secs_f64(),
                fallback: fallback(map.is_fallback()),
                map: Box::new(map),
            }
        }
        (Solver::Frame, Source::Slice(slice)) => {
            let maps = frame_map::solve(slice, &slice.fitted(), side, &[])?;
            Made {
                seconds: clock.elapsed().as_secs_f64(),
                map: Box::new(FrameMap::new(&maps)),
                fallback: fallback(maps.iter().any(|m| m.fallback)),
            }
        }
    }))
}

/// Measures one map.
fn judge(name: &str, made: &Made, solver: Solver, side: usize, cost: f64, truth: &Truth) -> Compared {
    let map = &*made.map;
    let counts = measure::count(BINNING_POINTS, |u| truth.index(map.at(u)));
    let row = Row {
        slice: name.to_string(),
        solver: solver.name(),
        n: side * side,
        cost_ratio: measure::cost(map, side) / cost,
        fold_fraction: measure::fold_fraction(map, side),
        max_stretch: measure::max_stretch(map, side),
        binning_l1: l1(&counts, &truth.reference),
        binning_floor: truth.floor,
        outside: measure::outside(map, truth.domain, measure::BINNING_POINTS),
        seconds: made.seconds,
        fallback: made.fallback,
    };
    Compared {
        row,
        map: (0..SIDE * SIDE)
            .map(|k| map.at(crate::spline::cell_centre(k, SIDE)))
            .collect(),
        bins: measure::shares(&counts, BINNING_POINTS),
    }
}
