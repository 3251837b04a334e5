//! The path tracer: what to render and how, cut into tiles that threads share.
//!
//! A tile's result depends on nothing but the scene and the settings, so an image is the same bit by bit on
//! any number of threads.

pub mod baked;
pub mod lanes;
pub mod shader;
pub mod shading;
pub mod wavefront;

pub use baked::Estimator;

use crate::error::{Error, Result};
use crate::image::Image;
use crate::scene::{Scene, Surface};
use bake_runtime::Backend;
use baked::BakedShader;
use glam::Vec3;
use rayon::prelude::*;
use shader::{DiffuseShader, Proposal, ReferenceShader, Shader};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use wavefront::{Outcome, PixelSample, Wavefront};

/// Side of the squares of pixels that threads take in turn.
const TILE_SIDE: usize = 32;

/// Samples per pixel of one block of paths: 4096 paths in a full tile, the batch that networks run best on.
const BLOCK_SAMPLES: u64 = 4;

/// How materials are sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The reference model's random walk, low-discrepancy numbers for its first interaction.
    Reference,
    /// The same on plain random numbers.
    ReferenceRandom,
    /// The reference model's analytic proposal (visible normals of a conductor), evaluated with the model.
    Vndf,
    /// Cosine, evaluated with the reference model.
    Cosine,
    /// Baked networks.
    Baked(Estimator),
}

impl Method {
    /// The name on the command line and in reports; the estimator has its own.
    pub fn name(self) -> &'static str {
        match self {
            Method::Reference => "reference",
            Method::ReferenceRandom => "reference_random",
            Method::Vndf => "vndf",
            Method::Cosine => "cosine",
            Method::Baked(_) => "baked",
        }
    }

    /// The estimator, where the method has one.
    pub fn estimator(self) -> Option<Estimator> {
        match self {
            Method::Baked(estimator) => Some(estimator),
            _ => None,
        }
    }
}

/// How an image, or one pass of it, is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderSettings {
    /// How materials are sampled.
    pub method: Method,
    /// Samples per pixel of this pass.
    pub spp: u64,
    /// Samples of every pixel's sequence that earlier passes have used up. Passes that follow each other,
    /// joined by [`Image::merge`], are the image rendered at once; for good stratification let them end at
    /// powers of two.
    pub sample_offset: u64,
    /// Images of different seeds are independent.
    pub seed: u64,
}

/// Finds the backend of the baked material with the given name, which threads share; called only by [`Method::Baked`].
pub type Backends<'a> = dyn Fn(&str) -> bake_runtime::Result<Arc<dyn Backend>> + Sync + 'a;

/// Renders one pass of `scene` on the threads of the current rayon pool.
///
/// `tick` is called from these threads with (blocks done, blocks in all); `Break` cancels.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::Runtime`] when a material has no reference model, or from a backend.
pub fn render(
    scene: &Scene,
    settings: &RenderSettings,
    backends: &Backends,
    tick: &(dyn Fn(u64, u64) -> ControlFlow<()> + Sync),
) -> Result<Image> {
    let tiles: Vec<Tile> = (0..scene.height.div_ceil(TILE_SIDE) * scene.width.div_ceil(TILE_SIDE))
        .map(|i| Tile::new(scene, i))
        .collect();
    let progress = Progress {
        done: AtomicU64::new(0),
        total: tiles.len() as u64 * settings.spp.div_ceil(BLOCK_SAMPLES),
        cancelled: AtomicBool::new(false),
        tick,
    };
    // Tracers wait here for the next tile, so that there are never more than threads.
    let idle = Mutex::new(Vec::new());
    let films: Vec<Film> = tiles
        .par_iter()
        .map(|tile| {
            let waiting = idle.lock().unwrap_or_else(|e| e.into_inner()).pop();
            let mut wavefront = match waiting {
                Some(wavefront) => wavefront,
                None => new_wavefront(scene, settings, backends)?,
            };
            let film = tile.render(&mut wavefront, settings, &progress)?;
            idle.lock().unwrap_or_else(|e| e.into_inner()).push(wavefront);
            Ok(film)
        })
        .collect::<Result<_>>()?;
    let mut image = Image::new(scene.width, scene.height);
    image.spp = settings.spp;
    for (tile, film) in tiles.iter().zip(&films) {
        image.non_finite += film.non_finite;
        for (pixel, sums) in tile.pixels.iter().zip(&film.pixels) {
            sums.write(&mut image, *pixel as usize, settings.spp);
        }
    }
    Ok(image)
}

fn new_wavefront<'a>(
    scene: &'a Scene,
    settings: &RenderSettings,
    backends: &Backends,
) -> Result<Wavefront<'a>> {
    let (mut shaders, mut albedos) = (Vec::<Box<dyn Shader>>::new(), Vec::new());
    for surface in &scene.surfaces {
        match surface {
            Surface::Diffuse(albedo) => {
                shaders.push(Box::new(DiffuseShader { albedo: *albedo }));
                albedos.push(*albedo);
            }
            Surface::Material(material) => {
                let bsdf = material.reference()?;
                albedos.push(bsdf.base_color().as_vec3());
                let proposal = match settings.method {
                    Method::Baked(estimator) => {
                        shaders.push(Box::new(BakedShader::new(
                            backends(&material.name)?,
                            material.reference()?,
                            estimator,
                        )));
                        continue;
                    }
                    Method::Reference => Proposal::Walk,
                    Method::ReferenceRandom => Proposal::RandomWalk,
                    Method::Vndf => Proposal::Vndf,
                    Method::Cosine => Proposal::Cosine,
                };
                shaders.push(Box::new(ReferenceShader { bsdf, proposal }));
            }
        }
    }
    Ok(Wavefront::new(scene, settings.seed, shaders, albedos))
}

struct Progress<'a> {
    done: AtomicU64,
    total: u64,
    cancelled: AtomicBool,
    tick: &'a (dyn Fn(u64, u64) -> ControlFlow<()> + Sync),
}

impl Progress<'_> {
    fn block_done(&self) -> Result<()> {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        if (self.tick)(done, self.total).is_break() {
            self.cancelled.store(true, Ordering::Relaxed);
        }
        if self.cancelled.load(Ordering::Relaxed) {
            Err(Error::Cancelled)
        } else {
            Ok(())
        }
    }
}

/// A square of pixels, by their numbers in the image.
struct Tile {
    pixels: Vec<u32>,
}

impl Tile {
    fn new(scene: &Scene, index: usize) -> Tile {
        let across = scene.width.div_ceil(TILE_SIDE);
        let (left, top) = (index % across * TILE_SIDE, index / across * TILE_SIDE);
        let columns = left..(left + TILE_SIDE).min(scene.width);
        let pixels = (top..(top + TILE_SIDE).min(scene.height))
            .flat_map(|y| columns.clone().map(move |x| (y * scene.width + x) as u32))
            .collect();
        Tile { pixels }
    }

    fn render(
        &self,
        wavefront: &mut Wavefront,
        settings: &RenderSettings,
        progress: &Progress,
    ) -> Result<Film> {
        let mut film = Film {
            pixels: vec![PixelSums::default(); self.pixels.len()],
            non_finite: 0,
        };
        let mut samples = Vec::new();
        for first in (0..settings.spp).step_by(BLOCK_SAMPLES as usize) {
            let block = first..(first + BLOCK_SAMPLES).min(settings.spp);
            samples.clear();
            for &pixel in &self.pixels {
                samples.extend(block.clone().map(|i| PixelSample {
                    pixel,
                    sample: settings.sample_offset + i,
                }));
            }
            let (outcomes, non_finite) = wavefront.trace(&samples)?;
            film.non_finite += non_finite;
            let per_pixel = outcomes.chunks_exact((block.end - block.start) as usize);
            for (sums, outcomes) in film.pixels.iter_mut().zip(per_pixel) {
                outcomes
                    .iter()
                    .enumerate()
                    .for_each(|(i, outcome)| sums.add(outcome, first == 0 && i == 0));
            }
            progress.block_done()?;
        }
        Ok(film)
    }
}

/// Sums over a tile's samples.
struct Film {
    pixels: Vec<PixelSums>,
    non_finite: u64,
}

#[derive(Clone, Copy, Default)]
struct PixelSums {
    radiance: [f64; 3],
    squares: [f64; 3],
    albedo: Vec3,
    normal: Vec3,
    object: u32,
}

impl PixelSums {
    fn add(&mut self, outcome: &Outcome, is_first: bool) {
        for (c, value) in outcome.radiance.to_array().into_iter().enumerate() {
            self.radiance[c] += f64::from(value);
            self.squares[c] += f64::from(value) * f64::from(value);
        }
        self.albedo += outcome.albedo;
        self.normal += outcome.normal;
        if is_first {
            self.object = outcome.object;
        }
    }

    fn write(&self, image: &mut Image, pixel: usize, spp: u64) {
        let n = spp.max(1) as f64;
        for c in 0..3 {
            let mean = self.radiance[c] / n;
            image.rgb[pixel][c] = mean as f32;
            let deviation = (self.squares[c] - mean * self.radiance[c]).max(0.0);
            image.variance[pixel][c] = (deviation / (n - 1.0).max(1.0)) as f32;
        }
        image.albedo[pixel] = (self.albedo / n as f32).to_array();
        image.normal[pixel] = (self.normal / n as f32).to_array();
        image.object[pixel] = self.object as f32;
    }
}
