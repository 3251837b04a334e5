//! What the fuzz targets share: queries of a material with the checks of their answers, and mutations that keep the
//! parts of a file in agreement.

pub mod mutation;
pub mod queries;
