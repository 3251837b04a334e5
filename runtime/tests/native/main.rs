//! The native kernels on every tier: the suite of all backends, and what they promise beyond.

mod bound;
mod contract;
mod faults;
mod inversion;
mod inverted;
mod jacobian;
mod linear;
mod suite;
