//! A backend without networks whose sampler is perfect but for the damage done to it: what measures are tested with.

use crate::lobes::{LUMINANCE, Lobe, LobeSlice, direction_at};
use crate::spline::{crowd, edge_cell_centre, edge_cell_weight};
use crate::transport::marginal::MarginalMap;
use bake_runtime::chart::Chart;
use bake_runtime::{Backend, Family, Material, Points, Reference, Result};
use glam::DVec3;
use std::sync::{Arc, Mutex};

/// Cells per side of the tables that the sampler inverts.
const CELLS: usize = 256;
/// Walks behind its slices, and their seed.
const WALKS: usize = 1 << 12;
const SEED: u64 = 7;

/// The gold of the scene `vase`, with every parameter fixed.
pub fn vase() -> Material {
    let given = [("alpha", &[0.3, 0.1][..]), ("reflectance", &[1.0, 0.782, 0.344])];
    Material::fixed("vase", Family::Conductor, &given).expect("valid parameters")
}

/// What is wrong with a backend.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Damage {
    /// Nothing.
    None,
    /// Positions are drawn for u₀ to this power, and nobody says so.
    Squeezed(f64),
    /// f_cos, and the learned weight, times this.
    Brighter(f64),
    /// The pdf times this.
    Denser(f64),
    /// Jacobians times this.
    Wider(f64),
    /// Jacobians are negative for u₀ below this.
    Folded(f64),
    /// Samples for u₁ above this go to the rim of the disk, with a Jacobian of 0.
    Lost(f64),
}

/// The backend of a material of any family.
pub struct Fake {
    material: Material,
    damage: Damage,
    slices: Mutex<Vec<Arc<FakeSlice>>>,
}

/// The charts of one slice with the maps onto its lobes.
struct FakeSlice {
    params: Vec<f32>,
    wo: [f32; 3],
    lobes: LobeSlice<'static>,
    charts: Vec<FakeChart>,
}

struct FakeChart {
    share: f64,
    chart: Chart,
    /// Luminance in the crowded cells, and in all of them.
    mass: Vec<f64>,
    total: f64,
    map: MarginalMap,
}

impl FakeChart {
    fn new(lobes: &LobeSlice, lobe: Lobe) -> FakeChart {
        let chart = lobes.chart(lobe);
        let mass: Vec<f64> = (0..CELLS * CELLS)
            .map(|k| {
                let (wi, area) = direction_at(&chart, edge_cell_centre(k, CELLS));
                lobes.f_cos(lobe, wi).dot(LUMINANCE) * area * edge_cell_weight(k, CELLS)
            })
            .collect();
        let total = mass.iter().sum();
        FakeChart {
            share: total,
            total,
            chart,
            map: MarginalMap::new(&mass, CELLS),
            mass,
        }
    }

    /// Density of its samples, sr⁻¹.
    fn density(&self, wi: DVec3) -> f64 {
        let s = self.chart.direction_to_square(wi.to_array());
        // Inverse of the smoothstep.
        let t = s.map(|v| 0.5 - ((1.0 - 2.0 * v.clamp(0.0, 1.0)).asin() / 3.0).sin());
        let cell = t.map(|t| ((t * CELLS as f64) as usize).min(CELLS - 1));
        let share = self.mass[cell[1] * CELLS + cell[0]] / self.total;
        let slope: f64 = t.iter().map(|t| 6.0 * t * (1.0 - t)).product();
        share * (CELLS * CELLS) as f64 * self.chart.density(wi.to_array()) / slope.max(f64::MIN_POSITIVE)
    }
}

impl FakeSlice {
    fn new(material: &Material, params: Vec<f32>, wo: [f32; 3]) -> Result<FakeSlice> {
        let values: Vec<f64> = params.iter().map(|v| f64::from(*v)).collect();
        // A few slices of a test live as long as it does.
        let reference: &'static Reference = Box::leak(Box::new(material.bind(&values)?));
        let direction = DVec3::from_array(wo.map(f64::from)).normalize();
        let lobes = LobeSlice::new(reference, direction, WALKS, SEED).expect("a bright slice");
        let lobes_with_charts = lobes.charts().into_iter();
        let mut charts: Vec<FakeChart> = lobes_with_charts
            .map(|lobe| FakeChart::new(&lobes, lobe))
            .collect();
        let sum: f64 = charts.iter().map(|c| c.share).sum();
        charts.iter_mut().for_each(|c| c.share /= sum);
        Ok(FakeSlice {
            params,
            wo,
            lobes,
            charts,
        })
    }

    fn sample(&self, mut u: [f64; 2]) -> DVec3 {
        let first = self.charts[0].share;
        let drawn = match self.charts.len() > 1 && u[0] >= first {
            true => {
                u[0] = (u[0] - first) / (1.0 - first);
                &self.charts[1]
            }
            false => {
                u[0] /= first;
                &self.charts[0]
            }
        };
        let s = drawn.map.at(u).map(crowd);
        DVec3::from_array(drawn.chart.square_to_direction(s).0)
    }

    fn pdf(&self, wi: DVec3) -> f64 {
        self.charts.iter().map(|c| c.share * c.density(wi)).sum()
    }
}

impl Fake {
    /// A backend of `material` with `damage`.
    pub fn new(material: &Material, damage: Damage) -> Fake {
        Fake {
            material: material.clone(),
            damage,
            slices: Mutex::new(Vec::new()),
        }
    }

    /// The slice that `points` ask for, made when they first do.
    fn slice(&self, points: &Points) -> Result<Arc<FakeSlice>> {
        points.check(self.material.free().len())?;
        let params: Vec<f32> = points.params.iter().map(|column| column[0]).collect();
        let wo = points.wo.map(|column| column[0]);
        let mut made = self.slices.lock().expect("no thread panicked in here");
        match made.iter().find(|slice| slice.params == params && slice.wo == wo) {
            Some(slice) => Ok(slice.clone()),
            None => {
                let slice = Arc::new(FakeSlice::new(&self.material, params, wo)?);
                made.push(slice.clone());
                Ok(slice)
            }
        }
    }
}

fn set(columns: &mut [&mut [f32]; 3], i: usize, value: DVec3) {
    for (column, component) in columns.iter_mut().zip(value.to_array()) {
        column[i] = component as f32;
    }
}

fn at(columns: &[&[f32]; 3], i: usize) -> DVec3 {
    DVec3::from_array(columns.map(|c| c[i].into())).normalize()
}

impl Backend for Fake {
    fn sample_learned(
        &self,
        points: Points,
        u: [&[f32]; 2],
        mut wi: [&mut [f32]; 3],
        mut weight: [&mut [f32]; 3],
    ) -> Result<()> {
        let mut jacobian = vec![0.0; points.len()];
        let [x, y, z] = &mut wi;
        self.sample_jacobian(points, u, [x, y, z], &mut jacobian)?;
        let damage = self.damage;
        let slice = self.slice(&points)?;
        for (i, jacobian) in jacobian.iter().enumerate() {
            let wi = DVec3::from_array([0, 1, 2].map(|c: usize| wi[c][i].into()));
            let mut found = slice.lobes.f_cos(Lobe::Whole, wi) * f64::from(*jacobian).abs();
            if let Damage::Brighter(factor) = damage {
                found *= factor;
            }
            set(&mut weight, i, found);
        }
        Ok(())
    }

    fn sample_jacobian(
        &self,
        points: Points,
        u: [&[f32]; 2],
        mut wi: [&mut [f32]; 3],
        jacobian: &mut [f32],
    ) -> Result<()> {
        let damage = self.damage;
        let slice = self.slice(&points)?;
        for (i, jacobian) in jacobian.iter_mut().enumerate() {
            let mut u = u.map(|c| f64::from(c[i]));
            if let Damage::Squeezed(power) = damage {
                u[0] = u[0].powf(power);
            }
            let drawn = slice.sample(u);
            let found = 1.0 / slice.pdf(drawn);
            let (drawn, found) = match damage {
                Damage::Wider(factor) => (drawn, factor * found),
                Damage::Folded(below) if u[0] < below => (drawn, -found),
                Damage::Lost(above) if u[1] > above => (DVec3::new(1.0, 0.0, 1e-3).normalize(), 0.0),
                _ => (drawn, found),
            };
            set(&mut wi, i, drawn);
            *jacobian = found as f32;
        }
        Ok(())
    }

    fn eval(&self, points: Points, wi: [&[f32]; 3], mut f_cos: [&mut [f32]; 3]) -> Result<()> {
        let damage = self.damage;
        let slice = self.slice(&points)?;
        for i in 0..points.len() {
            let mut found = slice.lobes.f_cos(Lobe::Whole, at(&wi, i));
            if let Damage::Brighter(factor) = damage {
                found *= factor;
            }
            set(&mut f_cos, i, found);
        }
        Ok(())
    }

    fn pdf(&self, points: Points, wi: [&[f32]; 3], pdf: &mut [f32]) -> Result<()> {
        let damage = self.damage;
        let slice = self.slice(&points)?;
        for (i, pdf) in pdf.iter_mut().enumerate() {
            let factor = match damage {
                Damage::Denser(factor) => factor,
                _ => 1.0,
            };
            *pdf = (factor * slice.pdf(at(&wi, i))) as f32;
        }
        Ok(())
    }
}
