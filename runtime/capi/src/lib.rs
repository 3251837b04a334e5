#![doc = include_str!("../README.md")]

mod array;
mod batch;
mod material;
mod query;
mod status;

pub use batch::{
    BakeColorsOut, BakeColumn, BakeDirections, BakeDirectionsOut, BakeInversions, BakePoints, BakeUniforms,
};
pub use material::{
    BakeBytes, BakeMaterial, BakeParameter, bake_material_bind, bake_material_chart_count,
    bake_material_free, bake_material_from_memory, bake_material_load, bake_material_parameter,
    bake_material_parameter_count, bake_material_tier,
};
pub use query::{
    bake_eval, bake_exact_pdf, bake_pdf, bake_sample, bake_sample_jacobian, bake_sample_mixture,
};
pub use status::{BAKE_ABI_VERSION, BakeStatus, bake_abi_version, bake_last_error, bake_status_name};
