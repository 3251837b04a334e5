//! A photographer's studio, described by a few numbers and rasterised to a radiance map: a vertical sky
//! gradient and rectangular soft boxes at infinity.

use crate::environment::{Environment, direction_of};
use glam::Vec3;
use std::f64::consts::{PI, TAU};

/// Width of the rasterised map: 0.7° per texel. Larger maps only cost cache misses: nothing sharper than a
/// glossy reflection or a blurred backdrop looks at it.
pub const MAP_WIDTH: usize = 512;

/// Height of the rasterised map.
pub const MAP_HEIGHT: usize = 256;

/// Radiance by elevation, RGB: blended smoothly from `horizon` to `zenith` and to `nadir`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sky {
    /// Straight up.
    pub zenith: Vec3,
    /// At eye level.
    pub horizon: Vec3,
    /// Straight down.
    pub nadir: Vec3,
}

/// A rectangle of light at infinity, upright, that faces the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Softbox {
    /// Direction of its centre, degrees from +z towards +x.
    pub azimuth: f64,
    /// Direction of its centre, degrees above the horizon, in (−90, 90).
    pub elevation: f64,
    /// Full angular width and height in degrees, each in (0, 170].
    pub size: [f64; 2],
    /// Share of the half size over which the edge fades out, in `[0, 1]`.
    pub softness: f64,
    /// Radiance in the middle, RGB, added to the sky's.
    pub radiance: Vec3,
}

/// Rasterises `sky` and `softboxes` to [`MAP_WIDTH`] × [`MAP_HEIGHT`] texels, one value at each centre.
pub fn rasterise(sky: &Sky, softboxes: &[Softbox]) -> Environment {
    let texel = |i: usize| {
        let elevation = PI * (0.5 - ((i / MAP_WIDTH) as f64 + 0.5) / MAP_HEIGHT as f64);
        let azimuth = TAU * ((i % MAP_WIDTH) as f64 + 0.5) / MAP_WIDTH as f64;
        let direction = direction_of(azimuth, elevation);
        softboxes
            .iter()
            .fold(sky.radiance(direction), |sum, b| sum + b.radiance(direction))
    };
    Environment::new(
        MAP_WIDTH,
        MAP_HEIGHT,
        (0..MAP_WIDTH * MAP_HEIGHT).map(texel).collect(),
    )
}

impl Sky {
    /// Radiance from the unit vector `direction`, RGB.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let end = if direction.y > 0.0 {
            self.zenith
        } else {
            self.nadir
        };
        self.horizon.lerp(end, smooth_step(direction.y.abs()))
    }
}

impl Softbox {
    /// Radiance from the unit vector `direction`, RGB.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let centre = direction_of(self.azimuth.to_radians(), self.elevation.to_radians());
        let right = Vec3::Y.cross(centre).normalize_or_zero();
        let depth = direction.dot(centre);
        if depth <= 0.0 {
            return Vec3::ZERO;
        }
        // Position on the plane that touches the unit sphere at the box's centre.
        let position = [
            direction.dot(right) / depth,
            direction.dot(centre.cross(right)) / depth,
        ];
        let cover = |axis: usize| {
            let half = (0.5 * self.size[axis].to_radians()).tan() as f32;
            let inside = 1.0 - position[axis].abs() / half;
            if inside <= 0.0 {
                0.0
            } else {
                smooth_step((inside / self.softness as f32).min(1.0))
            }
        };
        self.radiance * (cover(0) * cover(1))
    }
}

/// 3t² − 2t³: from 0 to 1 with level ends.
fn smooth_step(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn softbox_covers_its_rectangle() {
        let softbox = Softbox {
            azimuth: 90.0,
            elevation: 0.0,
            size: [40.0, 20.0],
            softness: 0.0,
            radiance: Vec3::ONE,
        };
        let at = |azimuth: f64, elevation: f64| {
            softbox
                .radiance(direction_of(azimuth.to_radians(), elevation.to_radians()))
                .x
        };
        assert_eq!([at(90.0, 0.0), at(109.0, 0.0), at(90.0, 9.0)], [1.0; 3]);
        assert_eq!([at(111.0, 0.0), at(90.0, 11.0), at(270.0, 0.0)], [0.0; 3]);
        let soft = Softbox {
            softness: 1.0,
            ..softbox
        };
        let edge = soft.radiance(direction_of(109f64.to_radians(), 0.0)).x;
        assert!(edge > 0.0 && edge < 0.1);
    }

    #[test]
    fn sky_reaches_its_three_colours() {
        let sky = Sky {
            zenith: Vec3::X,
            horizon: Vec3::Y,
            nadir: Vec3::Z,
        };
        for (direction, radiance) in [(Vec3::Y, Vec3::X), (Vec3::X, Vec3::Y), (Vec3::NEG_Y, Vec3::Z)] {
            assert_eq!(sky.radiance(direction), radiance);
        }
    }
}
