//! The suite of all backends, on every tier.

use bake_runtime::conformance::Tolerance;
use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::{BakedMaterial, conformance};

fn of(tier: Tier, material: &BakedMaterial) -> NativeBackend {
    NativeBackend::new(material, tier).expect("the tier is available and the material is sound")
}

conformance! { scalar, |material| of(Tier::Scalar, material), tolerance: Tolerance::EXACT }
conformance! { portable, |material| of(Tier::Portable, material), tolerance: Tolerance::EXACT }
conformance! {
    avx2,
    |material| of(Tier::Avx2, material),
    tolerance: Tolerance::EXACT,
    available: Tier::available().contains(&Tier::Avx2),
}
conformance! {
    avx512,
    |material| of(Tier::Avx512, material),
    tolerance: Tolerance::EXACT,
    available: Tier::available().contains(&Tier::Avx512),
}
