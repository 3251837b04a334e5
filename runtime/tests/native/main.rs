//! The native kernels against the f64 oracle, and the contract of their interface, on every tier.

mod accuracy;
mod contract;
mod inversion;
mod materials;
mod queries;
mod rounding;
