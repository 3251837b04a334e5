//! The reference models against independent values, against their own integrals, and on hard and forbidden input.

mod conductor;
mod imported;
mod layered;
mod principled;
mod support;
