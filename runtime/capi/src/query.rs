//! The queries: batches through the networks of one material.

use crate::array::{inputs, object, outputs, place};
use crate::batch::{
    BakeColorsOut, BakeDirections, BakeDirectionsOut, BakeInversions, BakePoints, BakeUniforms, Batch,
};
use crate::material::BakeMaterial;
use crate::status::{BakeStatus, Failure, answer};
use bake_runtime::native::Inversions;
use bake_runtime::{Backend, Error};

/// Names of arrays in messages.
const WI: [&str; 3] = ["wi.x", "wi.y", "wi.z"];
const U: [&str; 2] = ["u.u0", "u.u1"];

/// Draws directions with the weight that the sampling network learned: the cheapest estimator, biased by what the model
/// card says.
///
/// Reads u. Writes wi, and weight = f_cos / pdf (RGB, dimensionless, not negative). A query whose wo is not finite or not
/// above the horizon, or one of whose parameters is not finite, gets wi = (0, 0, 1) and zeros; everything written is finite.
/// A thread's first queries allocate, and its first on wider networks; no others do.
///
/// # Errors
/// BAKE_STATUS_NULL_POINTER, BAKE_STATUS_WRONG_LENGTH for the parameters' columns or a count beyond all memory, and
/// BAKE_STATUS_INVALID_ARGUMENT for arrays that are misaligned or overlap; bake_last_error names the array.
///
/// # Safety
/// The material lives, and all arrays have as many elements as points say.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bake_sample(
    material: *const BakeMaterial,
    points: *const BakePoints,
    u: BakeUniforms,
    wi: BakeDirectionsOut,
    weight: BakeColorsOut,
) -> BakeStatus {
    answer(|| {
        // SAFETY: as the caller says.
        let (material, batch) = unsafe { read(material, points)? };
        // SAFETY: as the caller says.
        let u = unsafe { inputs(U, [u.u0, u.u1], batch.count)? };
        let names = ["wi.x", "wi.y", "wi.z", "weight.r", "weight.g", "weight.b"];
        let pointers = [wi.x, wi.y, wi.z, weight.r, weight.g, weight.b];
        // SAFETY: as the caller says.
        let [x, y, z, r, g, b] = unsafe { outputs(names, pointers, batch.count, batch.taken(U, u))? };
        material
            .backend
            .sample_learned(batch.points(), u, [x, y, z], [r, g, b])?;
        Ok(())
    })
}

/// Draws the same directions as bake_sample, with the number that makes any f_cos an unbiased weight: f_cos * jacobian,
/// where f_cos is the reference's own, or bake_eval's.
///
/// Reads u. Writes wi, and jacobian (sr, signed). With one chart it is the determinant of u -> wi, and 1 / |jacobian| is the
/// density of wi where the map does not fold; with two it is that of the drawn chart times its share in the density that
/// the pdf network learned. About three passes of the sampling network. Invalid queries and allocation as in bake_sample.
///
/// # Errors
/// As of bake_sample.
///
/// # Safety
/// As of bake_sample.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bake_sample_jacobian(
    material: *const BakeMaterial,
    points: *const BakePoints,
    u: BakeUniforms,
    wi: BakeDirectionsOut,
    jacobian: *mut f32,
) -> BakeStatus {
    answer(|| {
        // SAFETY: as the caller says.
        let (material, batch) = unsafe { read(material, points)? };
        // SAFETY: as the caller says.
        let (u, wi, jacobian) = unsafe { drawn(&batch, u, wi, jacobian)? };
        material
            .backend
            .sample_jacobian(batch.points(), u, wi, jacobian)?;
        Ok(())
    })
}

/// Like bake_sample_jacobian, with exact densities in the place of the learned ones: less variance with two charts, whose
/// maps are inverted at every direction; with fewer nothing is inverted and both give the same.
///
/// Reads u. Writes wi, jacobian (sr, signed) and, unless it is null, inversions. Invalid queries and allocation as in
/// bake_sample.
///
/// # Errors
/// As of bake_sample.
///
/// # Safety
/// As of bake_sample.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bake_sample_mixture(
    material: *const BakeMaterial,
    points: *const BakePoints,
    u: BakeUniforms,
    wi: BakeDirectionsOut,
    jacobian: *mut f32,
    inversions: *mut BakeInversions,
) -> BakeStatus {
    answer(|| {
        // SAFETY: as the caller says.
        let (material, batch) = unsafe { read(material, points)? };
        // SAFETY: as the caller says.
        let (u, wi, jacobian) = unsafe { drawn(&batch, u, wi, jacobian)? };
        let query = || material.backend.sample_mixture(batch.points(), u, wi, jacobian);
        // SAFETY: as the caller says.
        unsafe { counted(inversions, query) }
    })
}

/// Evaluates the material: f_cos, RGB in 1/sr, as the evaluation network learned it.
///
/// Reads wi. Writes f_cos. A query whose wo or wi is not finite or not above the horizon, or one of whose parameters is not
/// finite, gets zeros; everything written is finite. Allocation as in bake_sample.
///
/// # Errors
/// As of bake_sample.
///
/// # Safety
/// As of bake_sample.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bake_eval(
    material: *const BakeMaterial,
    points: *const BakePoints,
    wi: BakeDirections,
    f_cos: BakeColorsOut,
) -> BakeStatus {
    answer(|| {
        // SAFETY: as the caller says.
        let (material, batch) = unsafe { read(material, points)? };
        // SAFETY: as the caller says.
        let wi = unsafe { inputs(WI, wi.columns(), batch.count)? };
        let names = ["f_cos.r", "f_cos.g", "f_cos.b"];
        let pointers = [f_cos.r, f_cos.g, f_cos.b];
        // SAFETY: as the caller says.
        let f_cos = unsafe { outputs(names, pointers, batch.count, batch.taken(WI, wi))? };
        material.backend.eval(batch.points(), wi, f_cos)?;
        Ok(())
    })
}

/// The density of wi among what bake_sample draws, 1/sr, as the pdf network learned it: cheap, and made for weights of
/// multiple importance sampling. It is only near the density, so never divide by it.
///
/// Reads wi. Writes pdf. Invalid queries and allocation as in bake_eval.
///
/// # Errors
/// As of bake_sample.
///
/// # Safety
/// As of bake_sample.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bake_pdf(
    material: *const BakeMaterial,
    points: *const BakePoints,
    wi: BakeDirections,
    pdf: *mut f32,
) -> BakeStatus {
    answer(|| {
        // SAFETY: as the caller says.
        let (material, batch) = unsafe { read(material, points)? };
        // SAFETY: as the caller says.
        let (wi, pdf) = unsafe { looked_up(&batch, wi, pdf)? };
        material.backend.pdf(batch.points(), wi, pdf)?;
        Ok(())
    })
}

/// The density of wi among what bake_sample draws, 1/sr, by inverting the map, which costs several passes of the sampling
/// network; with two charts the mixture of both by their shares.
///
/// Reads wi. Writes pdf and, unless it is null, inversions. Where the map folds it is the density of one of its branches,
/// where an inversion does not converge that of the chart's frame alone. Invalid queries and allocation as in bake_eval.
///
/// # Errors
/// As of bake_sample; also BAKE_STATUS_INVALID_ARGUMENT where bake_material_chart_count is 0, for only maps of charts are
/// sure to have an inverse.
///
/// # Safety
/// As of bake_sample.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bake_exact_pdf(
    material: *const BakeMaterial,
    points: *const BakePoints,
    wi: BakeDirections,
    pdf: *mut f32,
    inversions: *mut BakeInversions,
) -> BakeStatus {
    answer(|| {
        // SAFETY: as the caller says.
        let (material, batch) = unsafe { read(material, points)? };
        // SAFETY: as the caller says.
        let (wi, pdf) = unsafe { looked_up(&batch, wi, pdf)? };
        let query = || material.backend.exact_pdf(batch.points(), wi, pdf);
        // SAFETY: as the caller says.
        unsafe { counted(inversions, query) }
    })
}

/// Material and batch of a call.
///
/// # Safety
/// As of [`object`] and [`Batch::read`].
unsafe fn read<'a>(
    material: *const BakeMaterial,
    points: *const BakePoints,
) -> Result<(&'a BakeMaterial, Batch<'a>), Failure> {
    // SAFETY: as the caller says.
    unsafe {
        let material = object("material", material)?;
        Ok((material, Batch::read(points, material.free.len())?))
    }
}

/// Numbers to read and three columns and one to write, of a call that draws directions with their jacobian.
type Drawn<'a> = ([&'a [f32]; 2], [&'a mut [f32]; 3], &'a mut [f32]);

/// The arrays of a call that draws directions with their jacobian.
///
/// # Safety
/// As of [`inputs`] and [`outputs`].
unsafe fn drawn<'a>(
    batch: &Batch<'a>,
    u: BakeUniforms,
    wi: BakeDirectionsOut,
    jacobian: *mut f32,
) -> Result<Drawn<'a>, Failure> {
    let names = ["wi.x", "wi.y", "wi.z", "jacobian"];
    let pointers = [wi.x, wi.y, wi.z, jacobian];
    // SAFETY: as the caller says.
    unsafe {
        let u = inputs(U, [u.u0, u.u1], batch.count)?;
        let [x, y, z, jacobian] = outputs(names, pointers, batch.count, batch.taken(U, u))?;
        Ok((u, [x, y, z], jacobian))
    }
}

/// The arrays of a call that gives a density.
///
/// # Safety
/// As of [`inputs`] and [`outputs`].
unsafe fn looked_up<'a>(
    batch: &Batch<'a>,
    wi: BakeDirections,
    pdf: *mut f32,
) -> Result<([&'a [f32]; 3], &'a mut [f32]), Failure> {
    // SAFETY: as the caller says.
    unsafe {
        let wi = inputs(WI, wi.columns(), batch.count)?;
        let [pdf] = outputs(["pdf"], [pdf], batch.count, batch.taken(WI, wi))?;
        Ok((wi, pdf))
    }
}

/// Asks `query`, and writes its inversions to `out` unless that is null.
///
/// # Safety
/// `out` is null or may be written.
unsafe fn counted(
    out: *mut BakeInversions,
    query: impl FnOnce() -> Result<Inversions, Error>,
) -> Result<(), Failure> {
    let out = match out.is_null() {
        true => None,
        false => Some(place("inversions", out)?),
    };
    let inversions = query()?.into();
    if let Some(out) = out {
        // SAFETY: aligned, and as the caller says.
        unsafe { out.write(inversions) };
    }
    Ok(())
}
