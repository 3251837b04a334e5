//! Training of the networks.

pub mod data;
pub mod density;
pub mod fresh;
pub mod mlp;
pub mod sample;
pub mod schedule;
pub mod trainer;
