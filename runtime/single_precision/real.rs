//! The twin of the library's file of the same name: single precision.

/// Scalar of the reference models.
pub type Real = f32;

/// Vector of the reference models: a direction, or linear RGB.
pub type Vec3 = glam::Vec3;

pub use std::f32::consts;
