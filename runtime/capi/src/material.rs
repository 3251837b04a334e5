//! Baked materials: loaded, bound, described, freed.

use crate::array::{array, object, place, text};
use crate::status::{BakeStatus, Failure, answer};
use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::{BakedMaterial, Error};
use std::ffi::{CStr, CString, c_char, c_void};
use std::path::Path;

/// A baked material, ready to be asked. It does not change: any number of threads may ask it at once.
pub struct BakeMaterial {
    /// The packed networks.
    pub(crate) backend: NativeBackend,
    /// The parameters that it leaves free, in order.
    pub(crate) free: Vec<Free>,
    tier: CString,
    charts: usize,
}

/// A free parameter.
#[derive(Clone)]
pub(crate) struct Free {
    name: CString,
    min: f32,
    max: f32,
}

/// The bytes of a file.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct BakeBytes {
    /// The first of them; any alignment.
    pub data: *const c_void,
    /// Their number.
    pub length: usize,
}

/// A parameter that a material leaves free.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct BakeParameter {
    /// Its name, e.g. "alpha[0]"; lives as long as the material.
    pub name: *const c_char,
    /// Smallest value that the networks learned.
    pub min: f32,
    /// Largest value that the networks learned.
    pub max: f32,
}

/// Loads the networks of a baked folder: sample.safetensors, eval.safetensors and pdf.safetensors.
///
/// tier names the instructions to use: "scalar", "portable", "avx2" or "avx512"; null for the environment variable
/// BAKE_TIER, or else the fastest that this processor has. *out becomes the material, to be freed with bake_material_free,
/// or null where the call fails.
///
/// # Errors
/// BAKE_STATUS_NULL_POINTER; BAKE_STATUS_IO for a file that cannot be read; BAKE_STATUS_NETWORK for one that is no network
/// of this format, or not one of the same material as the others; BAKE_STATUS_TIER for a tier that this processor lacks,
/// BAKE_STATUS_INVALID_ARGUMENT for one that there is not.
///
/// # Safety
/// Strings end with NUL, and out may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bake_material_load(
    folder: *const c_char,
    tier: *const c_char,
    out: *mut *mut BakeMaterial,
) -> BakeStatus {
    let load = || {
        // SAFETY: as the caller says.
        let (folder, tier) = unsafe { (text("folder", folder)?, chosen(tier)?) };
        BakeMaterial::new(&BakedMaterial::load(path(folder)?)?, tier)
    };
    // SAFETY: as the caller says.
    unsafe { give(out, load) }
}

/// Loads a material from the bytes of its three files, for programs that have their own file system. The bytes are copied.
///
/// tier and *out are as in bake_material_load.
///
/// # Errors
/// As of bake_material_load, without BAKE_STATUS_IO.
///
/// # Safety
/// There are as many bytes as said, strings end with NUL, and out may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bake_material_from_memory(
    sample: BakeBytes,
    eval: BakeBytes,
    pdf: BakeBytes,
    tier: *const c_char,
    out: *mut *mut BakeMaterial,
) -> BakeStatus {
    let load = || {
        // SAFETY: as the caller says.
        let (sample, eval, pdf, tier) = unsafe {
            (
                sample.read("sample")?,
                eval.read("eval")?,
                pdf.read("pdf")?,
                chosen(tier)?,
            )
        };
        let material = BakedMaterial::from_bytes(sample, eval, pdf, Path::new("memory"))?;
        BakeMaterial::new(&material, tier)
    };
    // SAFETY: as the caller says.
    unsafe { give(out, load) }
}

/// The same material with values for some of its free parameters, which then cost nothing any more; NaN leaves a parameter
/// free. values has one number per free parameter, in their order. They may lie outside of the parameter's range, where
/// the networks guess.
///
/// *out becomes the bound material, to be freed with bake_material_free, or null where the call fails. It shares its
/// weights with the first one; each may be freed before the other.
///
/// # Errors
/// BAKE_STATUS_NULL_POINTER; BAKE_STATUS_WRONG_LENGTH when count is not bake_material_parameter_count;
/// BAKE_STATUS_INVALID_ARGUMENT for an infinite value.
///
/// # Safety
/// The material lives, values has count numbers, and out may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bake_material_bind(
    material: *const BakeMaterial,
    values: *const f32,
    count: usize,
    out: *mut *mut BakeMaterial,
) -> BakeStatus {
    let bind = || {
        // SAFETY: as the caller says.
        let material = unsafe { object("material", material)? };
        let free = material.free.len();
        if count != free {
            let message = format!("`count` is {count}, but the material leaves {free} free");
            return Err(Failure::new(BakeStatus::WrongLength, message));
        }
        // SAFETY: as the caller says.
        material.bound(unsafe { array("values", values, count)? })
    };
    // SAFETY: as the caller says.
    unsafe { give(out, bind) }
}

/// Frees a material. Null is none; no other call may use it any more.
///
/// # Safety
/// The material is null or from this library, was not freed yet, and no other thread is asking it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bake_material_free(material: *mut BakeMaterial) {
    if !material.is_null() {
        // SAFETY: it came from a box, and nobody else has it, as the caller says.
        drop(unsafe { Box::from_raw(material) });
    }
}

/// The number of parameters that a material leaves free; 0 for null.
///
/// # Safety
/// The material is null or lives.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bake_material_parameter_count(material: *const BakeMaterial) -> usize {
    // SAFETY: as the caller says.
    unsafe { material.as_ref() }.map_or(0, |material| material.free.len())
}

/// Describes the free parameter number index, from 0 on: *out becomes its name and range.
///
/// # Errors
/// BAKE_STATUS_NULL_POINTER; BAKE_STATUS_INVALID_ARGUMENT for an index that there is not.
///
/// # Safety
/// The material lives, and out may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bake_material_parameter(
    material: *const BakeMaterial,
    index: usize,
    out: *mut BakeParameter,
) -> BakeStatus {
    answer(|| {
        // SAFETY: as the caller says.
        let material = unsafe { object("material", material)? };
        let out = place("out", out)?;
        let Some(free) = material.free.get(index) else {
            let reason = format!("is {index}, but the material leaves {} free", material.free.len());
            return Err(Failure::argument("index", reason));
        };
        let (name, min, max) = (free.name.as_ptr(), free.min, free.max);
        // SAFETY: neither null nor misaligned, and as the caller says.
        unsafe { out.write(BakeParameter { name, min, max }) };
        Ok(())
    })
}

/// The name of the instructions that a material uses, as in bake_material_load; lives as long as the material. Null for
/// null.
///
/// # Safety
/// The material is null or lives.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bake_material_tier(material: *const BakeMaterial) -> *const c_char {
    // SAFETY: as the caller says.
    unsafe { material.as_ref() }.map_or(std::ptr::null(), |material| material.tier.as_ptr())
}

/// The number of charts that directions are drawn in: 1 or 2, or 0 for networks of the paper's preset, which draw on the
/// disk, and for null.
///
/// # Safety
/// The material is null or lives.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bake_material_chart_count(material: *const BakeMaterial) -> usize {
    // SAFETY: as the caller says.
    unsafe { material.as_ref() }.map_or(0, |material| material.charts)
}

impl BakeMaterial {
    fn new(material: &BakedMaterial, tier: Tier) -> Result<BakeMaterial, Failure> {
        let spec = &material.sample.spec;
        let free = spec.material.free().into_iter().map(|(name, min, max)| Free {
            name: c_string(&name),
            min: min as f32,
            max: max as f32,
        });
        Ok(BakeMaterial {
            backend: NativeBackend::new(material, tier)?,
            free: free.collect(),
            tier: c_string(tier.name()),
            charts: spec.charts().map_or(0, |charts| charts.anchors.len()),
        })
    }

    /// With `values`, one per free parameter, where they are not NaN.
    fn bound(&self, values: &[f32]) -> Result<BakeMaterial, Failure> {
        if let Some(i) = values.iter().position(|value| value.is_infinite()) {
            let reason = "it must be finite, or NaN where the parameter stays free";
            return Err(Failure::argument(format_args!("values[{i}]"), reason));
        }
        let given: Vec<Option<f32>> = values.iter().map(|v| Some(*v).filter(|v| !v.is_nan())).collect();
        let left = self.free.iter().zip(&given).filter(|(_, value)| value.is_none());
        Ok(BakeMaterial {
            backend: self.backend.bind(&given)?,
            free: left.map(|(free, _)| free.clone()).collect(),
            tier: self.tier.clone(),
            charts: self.charts,
        })
    }
}

impl BakeBytes {
    /// # Safety
    /// As of [`array`].
    unsafe fn read<'a>(self, name: &str) -> Result<&'a [u8], Failure> {
        // SAFETY: as the caller says.
        unsafe { array(name, self.data.cast(), self.length) }
    }
}

/// Makes a material and gives it to `out`, or null where that fails.
///
/// # Safety
/// `out` is null or may be written.
unsafe fn give(
    out: *mut *mut BakeMaterial,
    make: impl FnOnce() -> Result<BakeMaterial, Failure>,
) -> BakeStatus {
    answer(|| {
        let out = place("out", out)?;
        // SAFETY: neither null nor misaligned, and as the caller says.
        unsafe { out.write(std::ptr::null_mut()) };
        let material = Box::new(make()?);
        // SAFETY: as above.
        unsafe { out.write(Box::into_raw(material)) };
        Ok(())
    })
}

/// The tier called `name`; where that is null, the one that the environment names, or the fastest.
///
/// # Safety
/// `name` is null or a string.
unsafe fn chosen(name: *const c_char) -> Result<Tier, Failure> {
    if name.is_null() {
        return Ok(Tier::chosen()?);
    }
    // SAFETY: as the caller says.
    let name = unsafe { text("tier", name)? };
    Tier::named(&name.to_string_lossy()).map_err(|error| match error {
        Error::Query { reason, .. } => Failure::argument("tier", reason),
        other => other.into(),
    })
}

/// Any bytes are a path.
#[cfg(unix)]
fn path(folder: &CStr) -> Result<&Path, Failure> {
    use std::os::unix::ffi::OsStrExt;
    Ok(Path::new(std::ffi::OsStr::from_bytes(folder.to_bytes())))
}

/// Paths are UTF-8.
#[cfg(not(unix))]
fn path(folder: &CStr) -> Result<&Path, Failure> {
    let text = folder
        .to_str()
        .map_err(|_| Failure::argument("folder", "it is no UTF-8"))?;
    Ok(Path::new(text))
}

/// Names of parameters and tiers, which have no NULs.
fn c_string(name: &str) -> CString {
    CString::new(name).unwrap_or_default()
}
