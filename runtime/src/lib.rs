//! What a renderer links: reference BSDFs, and the baked networks that sample, evaluate and give the pdf of
//! them, run by our own SIMD kernels or (feature `ort`) by onnxruntime.
//!
//! Words and units: `wo` to the camera, `wi` to the light, both away from the surface, z = normal; `f_cos` is
//! f·cos θ_i in sr⁻¹; `pdf` is per solid angle of `wi`; `weight` is `f_cos / pdf`; `u` are two uniforms.
#![deny(unsafe_code)]

pub mod anchor;
mod archive;
pub mod backend;
pub mod batch;
mod binding;
pub mod boost;
pub mod bsdf;
pub mod chart;
pub mod concentric;
pub mod conductor;
#[cfg(feature = "conformance")]
pub mod conformance;
pub mod encoding;
pub mod error;
pub mod estimator;
pub mod family;
pub mod features;
pub mod field;
pub mod frame;
pub mod fresnel;
pub mod imported;
pub mod layered;
pub mod material;
pub mod metals;
pub mod microfacet;
pub mod moments;
pub mod native;
pub mod network;
#[cfg(feature = "ort")]
pub mod onnxruntime;
pub mod oracle;
pub mod principled;
pub mod query;
pub mod random;
pub mod real;
pub mod reference;
pub mod setting;
pub mod simd;
pub mod spec;

pub use backend::{Backend, BakedMaterial, Points};
pub use bsdf::{Bsdf, BsdfSample, Estimate, Rest, Slice};
pub use error::{Error, Result};
pub use family::Family;
pub use material::Material;
pub use network::{Dense, Network};
pub use random::Rng;
pub use reference::Reference;
pub use setting::{Scalar, Setting};
pub use spec::{NetworkSpec, Role};
