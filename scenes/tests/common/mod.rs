//! Small scenes with known pictures, and a backend without networks.

use bake_runtime::conductor::Conductor;
use bake_runtime::{Backend, Bsdf, Family, Material, Points, Result, Rng};
use bake_scenes::geometry::{Grain, Mesh};
use bake_scenes::tracer::shader::cosine_direction;
use bake_scenes::{Camera, Environment, Geometry, Image, Method, RenderSettings, Scene, Surface};
use glam::{DVec3, Vec2, Vec3};
use std::f64::consts::PI;
use std::ops::ControlFlow;
use std::sync::Arc;

/// A conductor whose every parameter is fixed.
pub fn conductor(alpha: [f64; 2], reflectance: [f64; 3]) -> Material {
    Material::fixed(
        "metal",
        Family::Conductor,
        &[("alpha", &alpha), ("reflectance", &reflectance)],
    )
    .expect("valid parameters")
}

/// A unit sphere of `surface` that nearly fills a square picture, alone in `environment`.
pub fn sphere(surface: Surface, environment: Environment, side: usize) -> Scene {
    let mut mesh = Mesh::default();
    // Poles exactly on the axis.
    let arc = (1..24)
        .map(|i| PI * f64::from(i) / 24.0)
        .map(|t| Vec2::new(t.sin() as f32, -t.cos() as f32));
    let profile: Vec<Vec2> = [Vec2::NEG_Y].into_iter().chain(arc).chain([Vec2::Y]).collect();
    mesh.add_revolution(&profile, Vec3::ZERO, Grain::Circumference, [256, 8], 0);
    scene(mesh, surface, environment, side, Vec3::new(0.0, 2.0, 4.0), 28.0)
}

/// A picture filled by a level plane of `surface` in `environment`.
pub fn plane(surface: Surface, environment: Environment, side: usize) -> Scene {
    let mut mesh = Mesh::default();
    mesh.add_disk(Vec3::ZERO, 100.0, 0);
    scene(mesh, surface, environment, side, Vec3::new(0.0, 3.0, 4.0), 30.0)
}

fn scene(mesh: Mesh, surface: Surface, environment: Environment, side: usize, eye: Vec3, fov: f32) -> Scene {
    Scene {
        name: "test".into(),
        width: side,
        height: side,
        max_depth: 4,
        exposure: 0.0,
        camera: Camera::look_at(eye, Vec3::ZERO, fov, 1.0).unwrap(),
        environment,
        geometry: Geometry::new(mesh),
        surfaces: vec![surface],
    }
}

/// Settings of a render from its first sample on.
pub fn settings(method: Method, spp: u64) -> RenderSettings {
    RenderSettings {
        method,
        spp,
        sample_offset: 0,
        seed: 1,
    }
}

/// Renders with [`CosineBackend`] for baked materials, and checks that every contribution was finite.
pub fn render(scene: &Scene, settings: &RenderSettings) -> Image {
    let material = scene.materials().next().cloned();
    let backend = move |name: &str| -> Result<Arc<dyn Backend>> {
        let material = material
            .as_ref()
            .filter(|m| m.name == name)
            .expect("a material of the scene");
        let reference = material.reference()?;
        let conductor = reference.as_conductor().expect("the tests bake conductors");
        Ok(Arc::new(CosineBackend(conductor.clone())))
    };
    let image =
        bake_scenes::render(scene, settings, &backend, &|_, _| ControlFlow::Continue(())).expect("renders");
    assert_eq!(image.non_finite, 0);
    image
}

/// Mean over the pixels whose object number `is_wanted`, all channels together.
pub fn mean(image: &Image, is_wanted: impl Fn(f32) -> bool) -> f64 {
    let pixels = image
        .rgb
        .iter()
        .zip(&image.object)
        .filter(|(_, o)| is_wanted(**o));
    let values: Vec<f64> = pixels.flat_map(|(p, _)| p.map(f64::from)).collect();
    values.iter().sum::<f64>() / values.len() as f64
}

/// Stands in for a baked material: its map is the cosine's, its evaluation the reference's, and its pdf wrong on
/// purpose, because no estimator may depend on it.
pub struct CosineBackend(Conductor);

/// The pdf that [`CosineBackend`] claims, sr⁻¹, for any direction.
const WRONG_PDF: f32 = 0.3;

impl CosineBackend {
    fn directions(u: [&[f32]; 2]) -> impl Iterator<Item = DVec3> {
        u[0].iter()
            .zip(u[1])
            .map(|(&a, &b)| cosine_direction([f64::from(a), f64::from(b)]))
    }
}

fn at(lanes: [&[f32]; 3], i: usize) -> DVec3 {
    DVec3::new(lanes[0][i].into(), lanes[1][i].into(), lanes[2][i].into()).normalize()
}

fn set(lanes: &mut [&mut [f32]; 3], i: usize, value: DVec3) {
    lanes
        .iter_mut()
        .zip(value.to_array())
        .for_each(|(lane, v)| lane[i] = v as f32);
}

impl Backend for CosineBackend {
    fn sample_learned(
        &self,
        points: Points,
        u: [&[f32]; 2],
        mut wi: [&mut [f32]; 3],
        mut weight: [&mut [f32]; 3],
    ) -> Result<()> {
        for (i, direction) in Self::directions(u).enumerate() {
            set(&mut wi, i, direction);
            let mut rng = Rng::new(&[u[0][i].to_bits().into(), u[1][i].to_bits().into()]);
            set(
                &mut weight,
                i,
                self.0.eval(at(points.wo, i), direction, &mut rng) * PI / direction.z.max(1e-9),
            );
        }
        Ok(())
    }

    fn sample_jacobian(
        &self,
        _points: Points,
        u: [&[f32]; 2],
        mut wi: [&mut [f32]; 3],
        jacobian: &mut [f32],
    ) -> Result<()> {
        for (i, direction) in Self::directions(u).enumerate() {
            set(&mut wi, i, direction);
            jacobian[i] = (PI / direction.z.max(1e-9)) as f32;
        }
        Ok(())
    }

    fn eval(&self, points: Points, wi: [&[f32]; 3], mut f_cos: [&mut [f32]; 3]) -> Result<()> {
        for i in 0..points.len() {
            let mut rng = Rng::new(&[points.wo[0][i].to_bits().into(), wi[0][i].to_bits().into()]);
            set(&mut f_cos, i, self.0.eval(at(points.wo, i), at(wi, i), &mut rng));
        }
        Ok(())
    }

    fn pdf(&self, _points: Points, _wi: [&[f32]; 3], pdf: &mut [f32]) -> Result<()> {
        pdf.fill(WRONG_PDF);
        Ok(())
    }
}
