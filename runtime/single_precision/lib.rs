//! The reference models in single precision: the library's own files beside a twin of `real.rs`, which names the
//! precision. Nothing here is written twice, so a difference between the two builds is one of rounding.
#![deny(unsafe_code)]

#[path = "../src/bsdf.rs"]
pub mod bsdf;
#[path = "../src/concentric.rs"]
pub mod concentric;
#[path = "../src/conductor/mod.rs"]
pub mod conductor;
#[path = "../src/error.rs"]
pub mod error;
#[path = "../src/fresnel.rs"]
pub mod fresnel;
#[path = "../src/layered/mod.rs"]
pub mod layered;
#[path = "../src/microfacet.rs"]
pub mod microfacet;
#[path = "../src/moments.rs"]
pub mod moments;
#[path = "../src/principled/mod.rs"]
pub mod principled;
#[path = "../src/random.rs"]
pub mod random;
pub mod real;

pub use error::Error;
