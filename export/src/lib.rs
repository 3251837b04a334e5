//! Writes baked networks as ONNX that any renderer can run without our code: symmetry fold, encodings, charts, layers,
//! heads and Jacobian are all inside the graph, and its inputs are raw parameters, directions and uniforms.
//!
//! The graphs are the f32 counterpart of `bake_runtime::oracle`, which defines what they must compute.
#![forbid(unsafe_code)]

mod anchor;
mod boost;
mod chart;
mod density;
mod encoding;
mod features;
mod frame;
mod graph;
mod layers;
mod proto;
mod query;
mod sample;
mod symmetry;
#[cfg(test)]
mod tests;
mod warp;
mod writer;

pub use writer::{export, layers_to_onnx, to_onnx};
