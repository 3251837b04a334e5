//! The suite of all backends, on models exported from its materials.

use crate::exported;
use crate::support::python::python;
use bake_runtime::conformance;
use bake_runtime::conformance::Tolerance;
use bake_runtime::onnxruntime::OrtBackend;

/// Batches of other sizes take other kernels of onnxruntime, which add in another order.
const TOLERANCE: Tolerance = Tolerance {
    rounding: 1.0,
    reordering: 1.0,
    length: Tolerance::LENGTH,
};

conformance! {
    all,
    |material| {
        python();
        OrtBackend::new(exported(material).path()).expect("exported models load")
    },
    tolerance: TOLERANCE,
}
