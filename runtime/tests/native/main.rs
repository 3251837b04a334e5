//! The native kernels against the f64 oracle, and the contract of their interface, on every tier.

mod accuracy;
mod materials;
mod queries;
