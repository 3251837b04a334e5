//! Networks under training: candle tensors, and the operations candle lacks.

pub mod bias_silu;
pub mod frame;
pub mod lookup;
pub mod mlp;
