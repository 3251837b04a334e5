//! Slices, importance maps, networks and their training, and model cards. The only crate that knows candle.
#![forbid(unsafe_code)]

pub mod bake;
pub mod bench;
pub mod card;
pub mod charts;
pub mod clock;
pub mod comparators;
pub mod compare;
pub mod database;
pub mod error;
pub mod fused;
pub mod lobes;
pub mod maps;
pub mod nn;
pub mod optimiser;
pub mod places;
pub mod presets;
pub mod slice;
pub mod spline;
mod tensors;
pub mod training;
pub mod transport;
pub mod view;

pub use error::{Error, Result};

/// Called with (done, total) as work goes on; breaking stops the work, which then ends with
/// [`Error::Interrupted`] and leaves what it can resume from.
pub type Tick<'a> = &'a (dyn Fn(u64, u64) -> std::ops::ControlFlow<()> + Sync);
