//! The shading frame of a hit, kept usable where interpolated normals and triangles disagree.

use crate::geometry::Hit;
use glam::Vec3;

/// Smallest cosine of `wo` in a shading frame: cos 89°, where the verification of baked materials ends.
pub const WO_COS_MIN: f32 = 0.017_452_406;

/// A right-handed orthonormal frame: x along the surface's grain, z = normal.
#[derive(Clone, Copy, Debug)]
pub struct ShadingFrame {
    x: Vec3,
    y: Vec3,
    z: Vec3,
}

impl ShadingFrame {
    /// The frame at `hit` for light that leaves along the unit vector `wo`.
    ///
    /// Where the interpolated normal faces away from `wo`, or is within 1° of doing so (the silhouettes of
    /// triangle meshes), it is turned towards `wo` until their cosine is [`WO_COS_MIN`]: the surface stays
    /// lit there instead of getting a black rim. Both `wo` and the interpolated normal are on the same side of
    /// the triangle, so they never point opposite ways.
    pub fn new(hit: &Hit, wo: Vec3) -> ShadingFrame {
        let cos = hit.normal.dot(wo);
        let z = if cos >= WO_COS_MIN {
            hit.normal
        } else {
            let across = (hit.normal - wo * cos).normalize_or(wo.any_orthonormal_vector());
            across * (1.0 - WO_COS_MIN * WO_COS_MIN).sqrt() + wo * WO_COS_MIN
        };
        let x = (hit.tangent - z * z.dot(hit.tangent)).normalize_or(z.any_orthonormal_vector());
        ShadingFrame { x, y: z.cross(x), z }
    }

    /// World to shading space.
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.x), v.dot(self.y), v.dot(self.z))
    }

    /// Shading to world space.
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.x * v.x + self.y * v.y + self.z * v.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A few roundings of unit vectors in f32.
    const TOL: f32 = 1e-6;

    #[test]
    fn frame_is_orthonormal_and_sees_wo() {
        let normal = Vec3::new(0.3, 0.8, -0.2).normalize();
        let hit = |normal| Hit {
            position: Vec3::ZERO,
            geometric_normal: normal,
            normal,
            tangent: Vec3::new(2.0, 0.1, 0.0),
            surface: 0,
        };
        let behind = (normal.any_orthonormal_vector() - 0.05 * normal).normalize();
        for wo in [Vec3::Y, behind, normal] {
            let frame = ShadingFrame::new(&hit(normal), wo);
            assert!(frame.to_local(wo).z > WO_COS_MIN - TOL);
            assert!((frame.x.cross(frame.y) - frame.z).length() < TOL);
            let v = Vec3::new(0.2, -0.7, 0.4);
            assert!((frame.to_world(frame.to_local(v)) - v).length() < TOL);
            if normal.dot(wo) > WO_COS_MIN {
                assert_eq!(frame.z, normal);
            }
        }
    }
}
