//! Triangle meshes with smooth normals and tangents, and the ray queries on them (BVH by crate `obvhs`).

use crate::profile::{ProfilePoint, smooth_pieces};
use glam::{Vec2, Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, builder::build_bvh2};
use obvhs::ray::{Ray, RayHit};
use std::f32::consts::TAU;
use std::time::Duration;

/// Rays start this far off the surface, relative to 1 + the largest coordinate: 100 roundings of f32.
const RAY_OFFSET: f32 = 1e-5;

/// Number of sectors of a ground disk's rim.
const DISK_SECTORS: usize = 96;

/// Direction along which a surface's x axis (and the first roughness) lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Grain {
    /// Around the axis of revolution.
    Circumference,
    /// Along the profile.
    Profile,
}

/// A corner of a triangle.
#[derive(Clone, Copy, Debug)]
struct Vertex {
    position: Vec3,
    normal: Vec3,
    tangent: Vec3,
}

/// Triangles before they are put into a BVH.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    vertices: Vec<Vertex>,
    triangles: Vec<[u32; 3]>,
    surfaces: Vec<u32>,
}

impl Mesh {
    /// Adds the surface that `profile` = (radius, height) sweeps around the vertical axis through `position`,
    /// in `sectors` sectors and `steps` rings between two control points; see [`smooth_pieces`].
    pub fn add_revolution(
        &mut self,
        profile: &[Vec2],
        position: Vec3,
        grain: Grain,
        tessellation: [usize; 2],
        surface: u32,
    ) {
        let [sectors, steps] = tessellation;
        for piece in smooth_pieces(profile, steps) {
            let first = self.vertices.len() as u32;
            for ring in &piece {
                self.vertices.extend(
                    (0..=sectors).map(|i| ring_vertex(*ring, i as f32 / sectors as f32, position, grain)),
                );
            }
            let stride = sectors as u32 + 1;
            for ring in 0..piece.len() as u32 - 1 {
                for sector in 0..sectors as u32 {
                    let a = first + ring * stride + sector;
                    let (b, c, d) = (a + 1, a + stride, a + stride + 1);
                    self.add_triangle([a, c, b], surface);
                    self.add_triangle([b, c, d], surface);
                }
            }
        }
    }

    /// Adds a level disk of `radius` around `centre`, facing up, x axis along world x.
    pub fn add_disk(&mut self, centre: Vec3, radius: f32, surface: u32) {
        let vertex = |position| Vertex {
            position,
            normal: Vec3::Y,
            tangent: Vec3::X,
        };
        let first = self.vertices.len() as u32;
        self.vertices.push(vertex(centre));
        for i in 0..DISK_SECTORS {
            let (sin, cos) = (TAU * i as f32 / DISK_SECTORS as f32).sin_cos();
            self.vertices
                .push(vertex(centre + radius * Vec3::new(sin, 0.0, cos)));
        }
        for i in 0..DISK_SECTORS as u32 {
            self.add_triangle(
                [first, first + 1 + i, first + 1 + (i + 1) % DISK_SECTORS as u32],
                surface,
            );
        }
    }

    /// Adds a triangle unless it is degenerate, as those at the axis of revolution are.
    fn add_triangle(&mut self, corners: [u32; 3], surface: u32) {
        let [a, b, c] = corners.map(|i| self.vertices[i as usize].position);
        if (b - a).cross(c - a).length_squared() > 0.0 {
            self.triangles.push(corners);
            self.surfaces.push(surface);
        }
    }
}

fn ring_vertex((point, along): ProfilePoint, turn: f32, centre: Vec3, grain: Grain) -> Vertex {
    // The last sector ends exactly where the first begins.
    let (sin, cos) = (TAU * turn.fract()).sin_cos();
    let outward = Vec3::new(sin, 0.0, cos);
    let around = Vec3::new(cos, 0.0, -sin);
    let tangent = match grain {
        Grain::Circumference => around,
        Grain::Profile => outward * along.x + Vec3::Y * along.y,
    };
    Vertex {
        position: centre + outward * point.x + Vec3::Y * point.y,
        normal: outward * along.y - Vec3::Y * along.x,
        tangent,
    }
}

/// A hit, with every vector on the side that the ray came from: surfaces are two-sided.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Where.
    pub position: Vec3,
    /// Unit normal of the triangle.
    pub geometric_normal: Vec3,
    /// Interpolated unit normal.
    pub normal: Vec3,
    /// Interpolated direction of the surface's x axis; neither unit nor perpendicular to `normal`.
    pub tangent: Vec3,
    /// Index of the surface, as it was given to [`Mesh`].
    pub surface: u32,
}

/// Triangles in a bounding volume hierarchy.
pub struct Geometry {
    mesh: Mesh,
    /// In the order of the hierarchy's leaves.
    triangles: Vec<Triangle>,
    bvh: Option<Bvh2>,
}

impl Geometry {
    /// Builds the hierarchy; the same mesh gives the same hierarchy.
    pub fn new(mesh: Mesh) -> Geometry {
        let corner = |i: u32| Vec3A::from(mesh.vertices[i as usize].position);
        let list: Vec<Triangle> = mesh.triangles.iter().map(|t| Triangle(t.map(corner))).collect();
        // The library wants at least one primitive.
        let bvh = (!list.is_empty()).then(|| {
            let boxes: Vec<Aabb> = list.iter().map(|t| Aabb::from_points(&t.0)).collect();
            build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut Duration::default())
        });
        let leaves = bvh.as_ref().map_or(&[][..], |bvh| &bvh.primitive_indices);
        let triangles = leaves.iter().map(|&i| list[i as usize]).collect();
        Geometry { mesh, triangles, bvh }
    }

    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        self.mesh.triangles.len()
    }

    /// The nearest hit of the ray from `origin` along the unit vector `direction`.
    pub fn intersect(&self, origin: Vec3, direction: Vec3) -> Option<Hit> {
        let bvh = self.bvh.as_ref()?;
        let ray = Ray::new_inf(origin.into(), direction.into());
        let mut hit = RayHit::none();
        bvh.ray_traverse(ray, &mut hit, |ray, i| {
            self.triangles[i]
                .intersect(ray)
                .map_or(f32::INFINITY, |hit| hit.0)
        });
        let index = *bvh.primitive_indices.get(hit.primitive_id as usize)? as usize;
        let (_, weights) = self.triangles[hit.primitive_id as usize].intersect(&ray)?;
        Some(self.surface_at(index, weights, direction))
    }

    /// Whether nothing stands in the way from `origin` along the unit vector `direction` to infinity.
    pub fn unoccluded(&self, origin: Vec3, direction: Vec3) -> bool {
        let ray = Ray::new_inf(origin.into(), direction.into());
        self.bvh.as_ref().is_none_or(|bvh| {
            bvh.ray_traverse_miss(ray, |ray, i| {
                self.triangles[i]
                    .intersect(ray)
                    .map_or(f32::INFINITY, |hit| hit.0)
            })
        })
    }

    /// Position and interpolated vectors where a ray along `direction` meets triangle `index`, whose corners
    /// have the barycentric `weights` there.
    fn surface_at(&self, index: usize, weights: Vec3A, direction: Vec3) -> Hit {
        let corners = self.mesh.triangles[index].map(|i| self.mesh.vertices[i as usize]);
        let mix = |of: fn(&Vertex) -> Vec3| {
            of(&corners[0]) * weights.x + of(&corners[1]) * weights.y + of(&corners[2]) * weights.z
        };
        let [a, b, c] = corners.map(|corner| corner.position);
        let facing = (b - a).cross(c - a).normalize();
        let geometric_normal = if facing.dot(direction) > 0.0 {
            -facing
        } else {
            facing
        };
        // Winding and vertex normals may disagree; the triangle decides which side this is.
        let normal = mix(|v| v.normal).normalize_or(geometric_normal);
        Hit {
            position: mix(|v| v.position),
            geometric_normal,
            normal: if normal.dot(geometric_normal) < 0.0 {
                -normal
            } else {
                normal
            },
            tangent: mix(|v| v.tangent),
            surface: self.mesh.surfaces[index],
        }
    }
}

/// Three corners.
#[derive(Clone, Copy, Debug)]
struct Triangle([Vec3A; 3]);

impl Triangle {
    /// Distance along `ray` and barycentric weights of the corners, or `None`; both sides count.
    ///
    /// The three signed volumes of edge and ray (Plücker coordinates) change nothing but their sign when an
    /// edge is traversed the other way, rounding included: no ray slips through between two neighbours.
    fn intersect(&self, ray: &Ray) -> Option<(f32, Vec3A)> {
        let [a, b, c] = self.0.map(|corner| corner - ray.origin);
        let volumes = Vec3A::new(
            b.cross(c).dot(ray.direction),
            c.cross(a).dot(ray.direction),
            a.cross(b).dot(ray.direction),
        );
        if volumes.min_element() < 0.0 && volumes.max_element() > 0.0 {
            return None;
        }
        let weights = volumes / volumes.element_sum();
        let distance = (a * weights.x + b * weights.y + c * weights.z).dot(ray.direction);
        // The comparison is false for the NaN of a triangle seen edge-on.
        (distance > ray.tmin && distance < ray.tmax).then_some((distance, weights))
    }
}

impl Hit {
    /// Origin of a ray that leaves the surface along `direction` without meeting it again.
    pub fn ray_origin(&self, direction: Vec3) -> Vec3 {
        let offset = RAY_OFFSET * (1.0 + self.position.abs().max_element());
        self.position + self.geometric_normal * offset * direction.dot(self.geometric_normal).signum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::Rng;

    /// Half a great circle as a profile: a unit sphere.
    fn sphere() -> Geometry {
        let profile: Vec<Vec2> = (0..=16)
            .map(|i| std::f32::consts::PI * i as f32 / 16.0)
            .map(|t| Vec2::new(if t.cos().abs() == 1.0 { 0.0 } else { t.sin() }, -t.cos()))
            .collect();
        let mut mesh = Mesh::default();
        let profile = [&[Vec2::new(0.0, -1.0)], &profile[1..16], &[Vec2::new(0.0, 1.0)]].concat();
        mesh.add_revolution(&profile, Vec3::ZERO, Grain::Circumference, [128, 4], 7);
        Geometry::new(mesh)
    }

    /// Sagitta of 128 sectors is 3e-4; the spline through 17 points is closer than that.
    const SPHERE_TOL: f32 = 1e-3;

    #[test]
    fn sphere_is_hit_where_a_sphere_is() {
        let sphere = sphere();
        let mut rng = Rng::new(&[5]);
        for _ in 0..20_000 {
            let [a, b] = rng.pair();
            let direction = crate::environment::direction_of(6.3 * a, 3.1 * (b - 0.5));
            let hit = sphere
                .intersect(direction * 3.0, -direction)
                .expect("a ray through the centre hits");
            assert!((hit.position - direction).length() < SPHERE_TOL, "{hit:?}");
            // Normals of a sphere are its directions; between spline points they are a little off.
            assert!(hit.normal.dot(direction) > 0.9999, "{hit:?} {direction}");
            assert!(hit.geometric_normal.dot(direction) > 0.99 && hit.surface == 7);
            let inside = sphere.intersect(Vec3::ZERO, direction).expect("closed");
            assert!(inside.normal.dot(direction) < -0.9999, "two-sided");
            assert!(sphere.unoccluded(hit.ray_origin(direction), direction));
            assert!(!sphere.unoccluded(hit.ray_origin(-direction), -direction));
        }
        assert!(sphere.intersect(Vec3::new(0.0, 3.0, 1.1), Vec3::NEG_Y).is_none());
    }

    #[test]
    fn tangent_follows_the_grain() {
        let along_x = |grain| {
            let mut mesh = Mesh::default();
            mesh.add_revolution(
                &[Vec2::new(1.0, 0.0), Vec2::new(1.0, 2.0)],
                Vec3::ZERO,
                grain,
                [64, 2],
                0,
            );
            let hit = Geometry::new(mesh)
                .intersect(Vec3::new(0.0, 1.0, 3.0), Vec3::NEG_Z)
                .unwrap();
            hit.tangent.normalize()
        };
        assert!(along_x(Grain::Circumference).dot(Vec3::X).abs() > 0.999);
        assert!(along_x(Grain::Profile).dot(Vec3::Y).abs() > 0.999);
    }

    #[test]
    fn disk_is_flat_and_bounded() {
        let mut mesh = Mesh::default();
        mesh.add_disk(Vec3::new(0.0, 0.5, 0.0), 2.0, 1);
        let disk = Geometry::new(mesh);
        let hit = disk.intersect(Vec3::new(1.0, 3.0, 1.0), Vec3::NEG_Y).unwrap();
        assert!(
            (hit.position - Vec3::new(1.0, 0.5, 1.0)).length() < 1e-6,
            "roundings of numbers of order 1"
        );
        assert_eq!((hit.normal, hit.surface), (Vec3::Y, 1));
        assert!(disk.intersect(Vec3::new(2.0, 3.0, 1.0), Vec3::NEG_Y).is_none());
        assert!(Geometry::new(Mesh::default()).unoccluded(Vec3::ZERO, Vec3::Y));
    }
}
