//! Training loops of the frame, sampling, evaluation and pdf networks.

pub mod data;
pub mod density;
pub mod sample;
pub mod trainer;
