//! The pinhole camera.

use glam::Vec3;

/// A pinhole camera that looks along its own −z axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    position: Vec3,
    right: Vec3,
    up: Vec3,
    forward: Vec3,
}

impl Camera {
    /// A camera at `position` that looks at `target`, upright, with a full vertical field of view of
    /// `fov_degrees` in (0, 180), for images of `aspect` = width / height.
    ///
    /// `None` when `target` is `position`, or straight above or below it.
    pub fn look_at(position: Vec3, target: Vec3, fov_degrees: f32, aspect: f32) -> Option<Camera> {
        let forward = (target - position).try_normalize()?;
        let right = forward.cross(Vec3::Y).try_normalize()?;
        let half = (0.5 * fov_degrees.to_radians()).tan();
        Some(Camera {
            position,
            right: right * half * aspect,
            up: right.cross(forward) * half,
            forward,
        })
    }

    /// Origin and unit direction of the ray through (`x`, `y`) in `[0,1]²`, the origin at the top left.
    pub fn ray(&self, x: f32, y: f32) -> (Vec3, Vec3) {
        let direction = self.forward + self.right * (2.0 * x - 1.0) + self.up * (1.0 - 2.0 * y);
        (self.position, direction.normalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_span_the_field_of_view() {
        let camera = Camera::look_at(Vec3::new(0.0, 0.0, 5.0), Vec3::ZERO, 90.0, 2.0).unwrap();
        let (origin, centre) = camera.ray(0.5, 0.5);
        assert_eq!((origin, centre), (Vec3::new(0.0, 0.0, 5.0), Vec3::NEG_Z));
        let top_left = camera.ray(0.0, 0.0).1;
        // tan 45° = 1 upwards, twice that sideways.
        assert!((top_left * (-1.0 / top_left.z) - Vec3::new(-2.0, 1.0, -1.0)).length() < 1e-6);
        assert_eq!(Camera::look_at(Vec3::ZERO, Vec3::Y, 40.0, 1.0), None);
    }
}
