//! The precision that the reference models compute in, named in this one place.
//!
//! Every model is written against these names, so that the same source builds in single precision, too: the test
//! `single_precision` includes the models beside a twin of this file and compares the two builds on hard cases.

/// Scalar of the reference models.
pub type Real = f64;

/// Vector of the reference models: a direction, or linear RGB.
pub type Vec3 = glam::DVec3;

pub use std::f64::consts;
