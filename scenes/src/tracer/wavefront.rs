//! The stages of path tracing, each over a whole block of paths, so that every material sees full batches.
//!
//! A block goes through `generate`, then per reflection `intersect`, and per surface `sample_lights` and
//! `bounce`. Radiance is estimated by environment sampling and BSDF sampling, joined by the balance heuristic
//! (Veach and Guibas 1995) in a form that never divides by the BSDF's density: with p the density both
//! techniques agree on and q the environment's, a light sample counts f·L/(p + q), and a BSDF sample its
//! weight·L·p/(p + q). The two factors add up to 1 for every direction, whatever p is.

use super::shader::{Batch, Scattered, Shader};
use super::shading::ShadingFrame;
use crate::error::Result;
use crate::geometry::Hit;
use crate::sampler::SamplePoint;
use crate::scene::Scene;
use bake_runtime::Rng;
use glam::Vec3;

/// Keys of the random streams of one interaction.
const LIGHT_STREAM: u64 = 0;
const BSDF_STREAM: u64 = 1;

/// One sample of one pixel.
#[derive(Clone, Copy, Debug)]
pub struct PixelSample {
    /// Number of the pixel in the image.
    pub pixel: u32,
    /// Number of the sample in the pixel's sequence.
    pub sample: u64,
}

/// What became of one [`PixelSample`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Outcome {
    /// Radiance, RGB.
    pub radiance: Vec3,
    /// Reflectance at the first hit.
    pub albedo: Vec3,
    /// Shading normal at the first hit.
    pub normal: Vec3,
    /// Surface of the first hit plus one, or 0.
    pub object: u32,
}

/// A path on its way to the next surface.
#[derive(Clone, Copy, Debug)]
struct Path {
    slot: usize,
    origin: Vec3,
    direction: Vec3,
    /// Product of the weights so far.
    beta: Vec3,
    /// Density of `direction` that the multiple importance sampling weights use, sr⁻¹.
    pdf: f32,
}

/// A path at a surface.
struct Interaction {
    path: Path,
    hit: Hit,
    frame: ShadingFrame,
}

/// Traces blocks of paths; one per thread, its buffers are reused.
pub struct Wavefront<'a> {
    scene: &'a Scene,
    seed: u64,
    /// First-hit reflectance of each surface.
    albedos: Vec<Vec3>,
    shaders: Vec<Box<dyn Shader>>,
    outcomes: Vec<Outcome>,
    non_finite: u64,
    paths: Vec<Path>,
    /// By surface.
    interactions: Vec<Vec<Interaction>>,
    batch: Batch,
    scattered: Scattered,
}

impl<'a> Wavefront<'a> {
    /// A tracer of `scene` with one shader and one albedo for each of its surfaces.
    pub fn new(scene: &'a Scene, seed: u64, shaders: Vec<Box<dyn Shader>>, albedos: Vec<Vec3>) -> Self {
        Wavefront {
            scene,
            seed,
            albedos,
            outcomes: Vec::new(),
            non_finite: 0,
            paths: Vec::new(),
            interactions: shaders.iter().map(|_| Vec::new()).collect(),
            shaders,
            batch: Batch::default(),
            scattered: Scattered::default(),
        }
    }

    /// Traces `samples`; returns their outcomes in the same order, and how many contributions were not finite.
    ///
    /// # Errors
    /// What a backend returns.
    pub fn trace(&mut self, samples: &[PixelSample]) -> Result<(&[Outcome], u64)> {
        self.generate(samples);
        for depth in 0..=self.scene.max_depth {
            self.intersect(depth);
            if depth == self.scene.max_depth {
                break;
            }
            for surface in 0..self.shaders.len() {
                let interactions = std::mem::take(&mut self.interactions[surface]);
                if !interactions.is_empty() {
                    self.sample_lights(&interactions, samples, surface, depth)?;
                    self.bounce(&interactions, samples, surface, depth)?;
                }
                self.interactions[surface] = interactions;
            }
        }
        Ok((&self.outcomes, self.non_finite))
    }

    /// Camera rays.
    fn generate(&mut self, samples: &[PixelSample]) {
        self.outcomes.clear();
        self.outcomes.resize(samples.len(), Outcome::default());
        self.non_finite = 0;
        self.paths.clear();
        for (slot, sample) in samples.iter().enumerate() {
            let (width, height) = (self.scene.width, self.scene.height);
            let [u, v] = self.point(sample).pixel();
            let (x, y) = (sample.pixel as usize % width, sample.pixel as usize / width);
            let (x, y) = ((x as f32 + u) / width as f32, (y as f32 + v) / height as f32);
            let (origin, direction) = self.scene.camera.ray(x, y);
            self.paths.push(Path {
                slot,
                origin,
                direction,
                beta: Vec3::ONE,
                pdf: 0.0,
            });
        }
    }

    /// Finds the next hits and sorts them by surface; paths that escape collect the environment.
    fn intersect(&mut self, depth: usize) {
        self.interactions.iter_mut().for_each(Vec::clear);
        for path in std::mem::take(&mut self.paths) {
            let Some(hit) = self.scene.geometry.intersect(path.origin, path.direction) else {
                let environment = &self.scene.environment;
                let seen = match depth {
                    0 => environment.backdrop(path.direction),
                    _ => {
                        let weight = share(path.pdf, environment.pdf(path.direction));
                        environment.radiance(path.direction) * weight
                    }
                };
                self.deposit(path.slot, path.beta * seen);
                continue;
            };
            let surface = hit.surface as usize;
            if depth == 0 {
                let outcome = &mut self.outcomes[path.slot];
                outcome.albedo = self.albedos[surface];
                outcome.normal = hit.normal;
                outcome.object = hit.surface + 1;
            }
            let frame = ShadingFrame::new(&hit, -path.direction);
            self.interactions[surface].push(Interaction { path, hit, frame });
        }
    }

    /// One environment sample per interaction, with a shadow ray where it would count.
    fn sample_lights(
        &mut self,
        interactions: &[Interaction],
        samples: &[PixelSample],
        surface: usize,
        depth: usize,
    ) -> Result<()> {
        let mut lights = Vec::with_capacity(interactions.len());
        self.clear_batch();
        for interaction in interactions {
            let sample = &samples[interaction.path.slot];
            let Some(light) = self.scene.environment.sample(self.point(sample).light(depth)) else {
                continue;
            };
            let wi = interaction.frame.to_local(light.direction);
            // Light from below the triangle cannot arrive, although the bent normal may see it.
            if wi.z > 0.0 && light.direction.dot(interaction.hit.geometric_normal) > 0.0 {
                self.scattered.wi.push(wi);
                self.batch
                    .wo
                    .push(interaction.frame.to_local(-interaction.path.direction));
                self.batch.rng.push(self.stream(sample, depth, LIGHT_STREAM));
                lights.push((interaction, light));
            }
        }
        if lights.is_empty() {
            return Ok(());
        }
        self.scattered.resize(lights.len());
        self.shaders[surface].eval(&mut self.batch, &mut self.scattered)?;
        for (i, (interaction, light)) in lights.into_iter().enumerate() {
            let f_cos = self.scattered.value.at(i);
            let contribution =
                interaction.path.beta * f_cos * light.radiance / (self.scattered.pdf[i] + light.pdf);
            let origin = interaction.hit.ray_origin(light.direction);
            if contribution != Vec3::ZERO && self.scene.geometry.unoccluded(origin, light.direction) {
                self.deposit(interaction.path.slot, contribution);
            }
        }
        Ok(())
    }

    /// Draws each path's next direction by its surface's method; paths without weight end here.
    fn bounce(
        &mut self,
        interactions: &[Interaction],
        samples: &[PixelSample],
        surface: usize,
        depth: usize,
    ) -> Result<()> {
        self.clear_batch();
        for interaction in interactions {
            let sample = &samples[interaction.path.slot];
            self.batch
                .wo
                .push(interaction.frame.to_local(-interaction.path.direction));
            let u = self.point(sample).bsdf(depth);
            self.batch
                .u
                .iter_mut()
                .zip(u)
                .for_each(|(lanes, u)| lanes.push(u));
            self.batch.rng.push(self.stream(sample, depth, BSDF_STREAM));
        }
        self.scattered.resize(interactions.len());
        self.shaders[surface].sample(&mut self.batch, &mut self.scattered)?;
        for (i, interaction) in interactions.iter().enumerate() {
            let direction = interaction.frame.to_world(self.scattered.wi.at(i)).normalize();
            let beta = interaction.path.beta * self.scattered.value.at(i);
            if !(beta.is_finite() && direction.is_finite()) {
                self.non_finite += 1;
            } else if beta != Vec3::ZERO && direction.dot(interaction.hit.geometric_normal) > 0.0 {
                let origin = interaction.hit.ray_origin(direction);
                self.paths.push(Path {
                    slot: interaction.path.slot,
                    origin,
                    direction,
                    beta,
                    pdf: self.scattered.pdf[i],
                });
            }
        }
        Ok(())
    }

    fn clear_batch(&mut self) {
        self.batch.wo.clear();
        self.batch.u.iter_mut().for_each(Vec::clear);
        self.batch.rng.clear();
        self.scattered.wi.clear();
    }

    /// Adds to a sample's radiance; what is not finite is counted instead.
    fn deposit(&mut self, slot: usize, contribution: Vec3) {
        if contribution.is_finite() {
            self.outcomes[slot].radiance += contribution;
        } else {
            self.non_finite += 1;
        }
    }

    fn point(&self, sample: &PixelSample) -> SamplePoint {
        SamplePoint::new(self.seed, sample.pixel, sample.sample)
    }

    fn stream(&self, sample: &PixelSample, depth: usize, stream: u64) -> Rng {
        Rng::new(&[
            self.seed,
            u64::from(sample.pixel),
            sample.sample,
            depth as u64,
            stream,
        ])
    }
}

/// Balance heuristic: the share of the technique of density `p` against that of density `q`.
fn share(p: f32, q: f32) -> f32 {
    if p > 0.0 { p / (p + q) } else { 0.0 }
}
