//! Training loops of the frame, sampling, evaluation and pdf networks.

pub mod checkpoint;
pub mod curve;
pub mod data;
pub mod density;
pub mod paper;
pub mod run;
pub mod sample;
pub mod schedule;
pub mod trainer;
