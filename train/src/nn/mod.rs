//! Networks in candle's own operations: for samplers that we compare with, and as the measure of the fused kernel's speed.

pub mod bias_silu;
pub mod mlp;
