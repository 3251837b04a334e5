//! Materials, queries and calls that the tests share. Functions here pass on whatever pointers they get: tests give null,
//! or arrays that are as long as they say.

use bake::*;
use bake_runtime::random::Rng;
use std::ffi::{CStr, CString};
use std::path::{Path, PathBuf};

/// A networks' folder that ships.
pub fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../scenes/materials")
        .join(name)
}

/// What a call said.
pub type Said = Result<(), (BakeStatus, String)>;

/// `status` with the message behind it.
pub fn said(status: BakeStatus) -> Said {
    match status {
        BakeStatus::Ok => Ok(()),
        failed => Err((failed, last_error())),
    }
}

/// This thread's last message.
pub fn last_error() -> String {
    // SAFETY: it is never null, and nothing fails on this thread meanwhile.
    let message = unsafe { CStr::from_ptr(bake_last_error()) };
    message.to_str().expect("messages are UTF-8").to_string()
}

/// Checks that a call was refused with `status` and a message that has `part`.
pub fn refused(said: Said, status: BakeStatus, part: &str) {
    let (found, message) = said.expect_err("it must be refused");
    assert_eq!(found, status, "{message}");
    assert!(message.contains(part), "`{part}` is not in: {message}");
    assert!(!message.contains('\n'), "{message}");
}

/// A material of the library, freed in the end.
pub struct Material(*mut BakeMaterial);

// SAFETY: the library says that any thread may ask and free a material.
unsafe impl Send for Material {}
// SAFETY: the library says that any number of threads may ask it at once.
unsafe impl Sync for Material {}

impl Drop for Material {
    fn drop(&mut self) {
        // SAFETY: null or of the library, and nobody has it any more.
        unsafe { bake_material_free(self.0) };
    }
}

impl Material {
    /// Takes what a call gives: a material where it succeeds, else null.
    fn taken(
        call: impl FnOnce(*mut *mut BakeMaterial) -> BakeStatus,
    ) -> Result<Material, (BakeStatus, String)> {
        let mut material = std::ptr::dangling_mut();
        let said = said(call(&mut material));
        assert_eq!(material.is_null(), said.is_err(), "null exactly where it fails");
        let material = Material(material);
        said.map(|()| material)
    }

    /// Loads `folder`, with the best tier where none is named.
    pub fn load(folder: &Path, tier: Option<&str>) -> Result<Material, (BakeStatus, String)> {
        let folder = CString::new(folder.as_os_str().as_encoded_bytes()).expect("paths have no NUL");
        let tier = tier.map(|name| CString::new(name).expect("tiers have no NUL"));
        let tier = tier.as_ref().map_or(std::ptr::null(), |name| name.as_ptr());
        // SAFETY: strings and the place for the result live.
        Material::taken(|out| unsafe { bake_material_load(folder.as_ptr(), tier, out) })
    }

    /// One that ships.
    pub fn shipped(name: &str) -> Material {
        Material::load(&shipped(name), None).expect("shipped networks load")
    }

    /// Loads the bytes of three files.
    pub fn from_memory(files: [&[u8]; 3]) -> Result<Material, (BakeStatus, String)> {
        let [sample, eval, pdf] = files.map(|bytes| BakeBytes {
            data: bytes.as_ptr().cast(),
            length: bytes.len(),
        });
        // SAFETY: bytes and the place for the result live.
        Material::taken(|out| unsafe { bake_material_from_memory(sample, eval, pdf, std::ptr::null(), out) })
    }

    /// Binds `values`.
    pub fn bind(&self, values: &[f32]) -> Result<Material, (BakeStatus, String)> {
        // SAFETY: material, values and the place for the result live.
        Material::taken(|out| unsafe { bake_material_bind(self.0, values.as_ptr(), values.len(), out) })
    }

    /// For calls.
    pub fn pointer(&self) -> *const BakeMaterial {
        self.0
    }

    /// Number of free parameters.
    pub fn free(&self) -> usize {
        // SAFETY: the material lives.
        unsafe { bake_material_parameter_count(self.0) }
    }
}

/// A batch: what is asked, and room for answers.
pub struct Batch {
    /// One per free parameter.
    pub params: Vec<Vec<f32>>,
    pub wo: [Vec<f32>; 3],
    pub u: [Vec<f32>; 2],
    pub wi: [Vec<f32>; 3],
    pub color: [Vec<f32>; 3],
    pub scalar: Vec<f32>,
}

/// What answers hold before they are written.
pub const UNTOUCHED: f32 = -7.25;

impl Batch {
    /// `count` random queries, all of them valid; the values of parameters lie in 0..1.
    pub fn random(count: usize, params: usize, seed: u64) -> Batch {
        let mut rng = Rng::new(&[seed]);
        let mut batch = Batch {
            params: vec![Vec::new(); params],
            wo: Default::default(),
            u: Default::default(),
            wi: std::array::from_fn(|_| vec![UNTOUCHED; count]),
            color: std::array::from_fn(|_| vec![UNTOUCHED; count]),
            scalar: vec![UNTOUCHED; count],
        };
        for _ in 0..count {
            let (z, phi) = (0.02 + 0.98 * rng.uniform(), std::f64::consts::TAU * rng.uniform());
            let r = (1.0 - z * z).sqrt();
            for (column, value) in batch.wo.iter_mut().zip([r * phi.cos(), r * phi.sin(), z]) {
                column.push(value as f32);
            }
            for column in batch.params.iter_mut().chain(&mut batch.u) {
                column.push(rng.uniform() as f32);
            }
        }
        batch
    }

    /// Columns of the parameters, whole.
    pub fn columns(&self) -> Vec<BakeColumn> {
        let column = |values: &Vec<f32>| BakeColumn {
            data: values.as_ptr(),
            length: values.len(),
        };
        self.params.iter().map(column).collect()
    }

    /// The points with these columns.
    pub fn points(&self, columns: &[BakeColumn]) -> BakePoints {
        BakePoints {
            params: columns.as_ptr(),
            param_count: columns.len(),
            wo: directions(&self.wo),
            count: self.wo[0].len(),
        }
    }

    fn u(&self) -> BakeUniforms {
        let [u0, u1] = self.u.each_ref().map(|column| column.as_ptr());
        BakeUniforms { u0, u1 }
    }

    fn wi_out(&mut self) -> BakeDirectionsOut {
        let [x, y, z] = self.wi.each_mut().map(|column| column.as_mut_ptr());
        BakeDirectionsOut { x, y, z }
    }

    pub fn color_out(&mut self) -> BakeColorsOut {
        let [r, g, b] = self.color.each_mut().map(|column| column.as_mut_ptr());
        BakeColorsOut { r, g, b }
    }

    /// Whether no answer was written.
    pub fn untouched(&self) -> bool {
        let mut answers = self.wi.iter().chain(&self.color).chain([&self.scalar]).flatten();
        answers.all(|value| *value == UNTOUCHED)
    }

    /// The arguments of [`bake_sample`].
    pub fn call(&mut self, columns: &[BakeColumn]) -> Call {
        Call {
            points: self.points(columns),
            u: self.u(),
            wi: self.wi_out(),
            weight: self.color_out(),
        }
    }

    /// Draws with the learned weight.
    pub fn sample(&mut self, material: &Material) -> Said {
        let columns = self.columns();
        self.call(&columns).sample(material.pointer())
    }
}

/// The arguments of [`bake_sample`].
pub struct Call {
    pub points: BakePoints,
    pub u: BakeUniforms,
    pub wi: BakeDirectionsOut,
    pub weight: BakeColorsOut,
}

impl Call {
    /// [`bake_sample`] with what a test gives.
    pub fn sample(&self, material: *const BakeMaterial) -> Said {
        // SAFETY: tests give null or what lives, or what is refused unread.
        said(unsafe { bake_sample(material, &self.points, self.u, self.wi, self.weight) })
    }
}

/// Directions to read.
pub fn directions([x, y, z]: &[Vec<f32>; 3]) -> BakeDirections {
    let [x, y, z] = [x, y, z].map(|column| column.as_ptr());
    BakeDirections { x, y, z }
}

/// [`bake_eval`] with what a test gives.
pub fn eval(
    material: *const BakeMaterial,
    points: *const BakePoints,
    wi: BakeDirections,
    f_cos: BakeColorsOut,
) -> Said {
    // SAFETY: tests give null or what lives, or what is refused unread.
    said(unsafe { bake_eval(material, points, wi, f_cos) })
}

/// [`bake_exact_pdf`] with what a test gives, and without counts where `inversions` is null.
pub fn exact_pdf(
    material: *const BakeMaterial,
    points: *const BakePoints,
    wi: BakeDirections,
    pdf: *mut f32,
    inversions: *mut BakeInversions,
) -> Said {
    // SAFETY: tests give null or what lives, or what is refused unread.
    said(unsafe { bake_exact_pdf(material, points, wi, pdf, inversions) })
}
