//! Evaluations of the reference that no step sees twice: places drawn anew for every group of a few light directions.
//!
//! A network that never sees a number again cannot learn its noise by heart, and needs no tables.

use crate::charts::ChartsNetwork;
use crate::error::Result;
use crate::places::{THETA_MAX_DEG, azimuths_deg, value_at};
use bake_runtime::bsdf::direction;
use bake_runtime::features::Point;
use bake_runtime::oracle::Charts;
use bake_runtime::spec::CHARTS_MAX;
use bake_runtime::{Bsdf, Material, NetworkSpec, Rng};
use glam::DVec3;
use rayon::prelude::*;

/// Light directions per place: binding a material costs as much as a few of them.
const GROUP: usize = 16;
/// Exponent that favours grazing places: θ_o = θ_max·√(1 − ξ^p), where the paper has p = 1.
const GRAZING_EXPONENT: f64 = 1.3;
/// Share of the light directions that every chart gets whatever its share of the samples.
const EVEN_SHARE: f64 = 0.5;

/// One evaluation, lobe by lobe.
#[derive(Clone, Copy, Debug, Default)]
pub struct Evaluation {
    /// Density at wi of every chart's frame, sr⁻¹.
    pub density: [f32; CHARTS_MAX],
    /// f_cos of the lobe of every chart, RGB, sr⁻¹: unbiased, with the model's noise.
    pub f_cos: [[f32; 3]; CHARTS_MAX],
    /// The density with which wi was drawn, times the albedo's order of magnitude: what f_cos compares to, sr⁻¹.
    pub level: f32,
}

/// A batch of evaluations, with the features of each.
pub struct Evaluations {
    /// Features, row by row.
    pub features: Vec<f32>,
    /// What was found.
    pub values: Vec<Evaluation>,
}

/// A place of `material`'s domain, with a preference for grazing ones: parameters, and `wo`, folded.
pub fn draw_place(material: &Material, rng: &mut Rng) -> (Vec<f64>, DVec3) {
    let free = material.free();
    let params = free
        .iter()
        .map(|(label, min, max)| value_at(label, *min, *max, rng.uniform()));
    let params = params.collect();
    let theta = THETA_MAX_DEG * (1.0 - rng.uniform().powf(GRAZING_EXPONENT)).sqrt();
    let phi = azimuths_deg(material) * rng.uniform();
    (params, direction(theta, phi))
}

/// The drawer of evaluations for networks of `spec` whose charts `network` predicts; without charts, one lobe on the disk.
pub struct Fresh<'a> {
    /// The material.
    pub material: &'a Material,
    /// Whose features are made.
    pub spec: &'a NetworkSpec,
    /// Where light directions are drawn.
    pub network: &'a ChartsNetwork,
}

impl Fresh<'_> {
    /// Draws `size` evaluations from the stream of `rng`; the same for any number of threads.
    ///
    /// # Errors
    /// Those of [`Material::bind`].
    pub fn draw(&self, size: usize, rng: &mut Rng) -> Result<Evaluations> {
        let width = self.spec.input_features();
        let key = rng.bits();
        let mut batch = Evaluations {
            features: vec![0.0; size * width],
            values: vec![Evaluation::default(); size],
        };
        let rows = batch.features.par_chunks_mut(GROUP * width);
        let groups = rows.zip(batch.values.par_chunks_mut(GROUP)).enumerate();
        groups.try_for_each(|(group, (rows, values))| {
            self.fill(&mut Rng::new(&[key, group as u64]), rows, values)
        })?;
        Ok(batch)
    }

    fn fill(&self, rng: &mut Rng, rows: &mut [f32], values: &mut [Evaluation]) -> Result<()> {
        let (params, wo) = draw_place(self.material, rng);
        let bsdf = self.material.bind(&params)?;
        let charts = self.network.predict(&params, wo.to_array());
        let mut point = Point::new(&params, wo.to_array(), self.spec.charts());
        let mut features = Vec::new();
        let width = rows.len() / values.len();
        for (row, value) in rows.chunks_exact_mut(width).zip(values) {
            let chart = pick(&charts, rng);
            let (wi, _) = charts[chart].1.square_to_direction(rng.pair());
            point.wi = wi;
            let [sharp, smooth] = bsdf.eval_lobes(wo, DVec3::from_array(wi), rng);
            for (i, (share, chart)) in charts.iter().enumerate() {
                let (local, density) = chart.to_local(wi);
                point.local[i] = local;
                value.density[i] = density as f32;
                value.level += (share * density) as f32;
            }
            let lobes = match charts.len() {
                1 => [sharp + smooth, DVec3::ZERO],
                _ => [sharp, smooth],
            };
            value.f_cos = lobes.map(|lobe| lobe.as_vec3().to_array());
            features.clear();
            point.append(&self.spec.inputs, &mut features);
            for (out, feature) in row.iter_mut().zip(&features) {
                *out = *feature as f32;
            }
        }
        Ok(())
    }
}

/// A chart: by its share half of the time, else any.
fn pick(charts: &Charts, rng: &mut Rng) -> usize {
    let even = EVEN_SHARE / charts.len() as f64;
    let mut x = rng.uniform();
    for (i, (share, _)) in charts.iter().enumerate() {
        x -= even + (1.0 - EVEN_SHARE) * share;
        if x < 0.0 {
            return i;
        }
    }
    charts.len() - 1
}
