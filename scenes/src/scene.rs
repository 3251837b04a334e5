//! A scene, ready to be rendered.

use crate::camera::Camera;
use crate::environment::Environment;
use crate::geometry::Geometry;
use bake_runtime::Material;
use glam::Vec3;

/// What a surface is made of.
#[derive(Clone, Debug, PartialEq)]
pub enum Surface {
    /// Lambertian with this albedo, RGB: the ground, which needs no baking.
    Diffuse(Vec3),
    /// A material that has a reference model and can be baked.
    Material(Material),
}

/// Everything a picture depends on but the method.
pub struct Scene {
    /// Name of the scene's folder.
    pub name: String,
    /// Width of the picture in pixels.
    pub width: usize,
    /// Height of the picture in pixels.
    pub height: usize,
    /// Largest number of reflections of a path, at least 1.
    pub max_depth: usize,
    /// Exposure of PNG pictures, in stops.
    pub exposure: f32,
    /// The camera.
    pub camera: Camera,
    /// The light.
    pub environment: Environment,
    /// The objects; their surface numbers are indices into `surfaces`.
    pub geometry: Geometry,
    /// What the objects are made of, each once.
    pub surfaces: Vec<Surface>,
}

impl Scene {
    /// The materials that can be baked, in order of appearance.
    pub fn materials(&self) -> impl Iterator<Item = &Material> {
        self.surfaces.iter().filter_map(|surface| match surface {
            Surface::Diffuse(_) => None,
            Surface::Material(material) => Some(material),
        })
    }
}
