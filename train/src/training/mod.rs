//! Training of the networks.

pub mod checkpoint;
pub mod curve;
pub mod data;
pub mod density;
pub mod disk;
pub mod fresh;
pub mod mlp;
pub mod paper;
pub mod run;
pub mod sample;
pub mod schedule;
pub mod trainer;
