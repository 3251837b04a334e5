//! From a density on the unit square to the map that carries uniform numbers onto it.

pub mod banded;
pub mod frame_fit;
pub mod marginal;
pub mod monge_ampere;
