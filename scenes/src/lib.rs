//! Scene and material files, and the small wavefront path tracer that renders them.
//!
//! World: right-handed, y up, lengths without unit; radiance is RGB without unit. Directions in a surface's
//! shading frame follow `bake-runtime`: `wo` to the camera, `wi` to the light, z = normal.
//! References in f64 (`bake_runtime::Bsdf`) meet the tracer, which is f32, in [`tracer::shader`] alone.
#![forbid(unsafe_code)]

mod box_filter;
pub mod camera;
mod curve_axis;
mod curve_paper;
pub mod curve_picture;
pub mod entry_picture;
pub mod environment;
pub mod error;
pub mod exr_file;
pub mod geometry;
pub mod grey_picture;
pub mod image;
mod label;
pub mod map_picture;
mod map_tile;
pub mod material_file;
pub mod metrics;
pub mod picture;
pub mod profile;
pub mod sampler;
pub mod scene;
pub mod scene_file;
mod sheet;
pub mod slice_picture;
pub mod studio;
mod toml_file;
pub mod tracer;

pub use camera::Camera;
pub use environment::Environment;
pub use error::{Error, Result};
pub use geometry::Geometry;
pub use image::Image;
pub use material_file::load_material;
pub use scene::{Scene, Surface};
pub use scene_file::load_scene;
pub use tracer::{Backends, Estimator, Method, RenderSettings, render};
