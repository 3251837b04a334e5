//! The suite of all backends, on models exported from its materials.

use crate::exported;
use crate::support::python::python;
use bake_runtime::conformance;
use bake_runtime::conformance::Tolerance;
use bake_runtime::onnxruntime::OrtBackend;

/// Batches of other sizes take other kernels of onnxruntime, which add in another order. The graph does not make directions
/// unit again after the boost, whose roundings reach 1.3e-5 of their length at roughness 0.001, and 5.8e-5 with saturated
/// frames.
const TOLERANCE: Tolerance = Tolerance {
    rounding: 1.0,
    reordering: 1.0,
    length: 1e-4,
};

conformance! {
    all,
    |material| {
        python();
        OrtBackend::new(exported(material).path()).expect("exported models load")
    },
    tolerance: TOLERANCE,
}
