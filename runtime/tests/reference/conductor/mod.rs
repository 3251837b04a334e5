//! The reference conductor against tables of an independent implementation, against its own integrals, and at
//! the inputs where microfacet code usually breaks.

mod edges;
mod integrals;
mod tables;
