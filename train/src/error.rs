//! The error type of this crate.

use std::path::PathBuf;

/// What can stop slices, maps, training or checking.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A material, a network file or a query that `bake-runtime` refuses.
    #[error(transparent)]
    Runtime(#[from] bake_runtime::Error),
    /// candle failed, which plain data of the right shapes does not make it do.
    #[error("candle: {0}")]
    Candle(#[from] candle_core::Error),
    /// The run was cancelled; what was finished lies in the checkpoint.
    #[error("interrupted: go on with --resume")]
    Interrupted,
    /// Training diverged; nothing of it was saved.
    #[error("{stage}: {what} not finite at step {step}, where the loss is {loss}; {}", kept(*checkpoint))]
    Diverged {
        /// The network being trained.
        stage: String,
        /// What is not finite: "the loss is", "the gradient is" or the like.
        what: &'static str,
        /// The step, counted from 0.
        step: u64,
        /// The loss found.
        loss: f64,
        /// Steps that the checkpoint on disk has behind it, if there is one.
        checkpoint: Option<u64>,
    },
    /// A slice has no energy, or has values that are not numbers.
    #[error("slice at θ = {theta_deg:.2}°, φ = {phi_deg:.2}°: {reason}")]
    Slice {
        /// Polar angle of `wo`.
        theta_deg: f64,
        /// Azimuth of `wo`.
        phi_deg: f64,
        /// What is wrong.
        reason: String,
    },
    /// A density that nothing can be sampled from.
    #[error("density: {reason}")]
    Density {
        /// What is wrong.
        reason: String,
    },
    /// A checkpoint or a map shard that cannot be used.
    #[error("{path}: {reason}; delete it to start over")]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}

/// What is left of a run that diverged.
fn kept(checkpoint: Option<u64>) -> String {
    match checkpoint {
        Some(step) => format!("the last good checkpoint, of {step} steps, is kept"),
        None => "no checkpoint had been written yet".into(),
    }
}

/// `Result` with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;
