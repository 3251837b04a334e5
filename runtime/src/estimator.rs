//! The exact estimator: the weight of a baked direction from the reference model and the map's Jacobian.

use crate::conductor::Conductor;
use crate::random::Rng;
use glam::DVec3;

/// Walks spent, beyond the first, on a direction that single scattering does not explain at all.
///
/// On the vase at 64 samples per pixel, relmse is 2.41e-3 with four and 2.32e-3 with eight.
const EXTRA_WALKS: f64 = 8.0;

/// `f_cos` of the reference at `wi`, RGB, sr⁻¹, for a sampler whose density there is about `pdf` (sr⁻¹): unbiased,
/// and less noisy than [`crate::Bsdf::eval`] where it matters.
///
/// Under a good sampler f_cos is about the albedo times `pdf`, so what single scattering leaves of that tells how
/// much rests on walks; their number follows from it, before any of them is taken. Any `pdf` is correct.
pub fn exact_f_cos(bsdf: &Conductor, wo: DVec3, wi: DVec3, pdf: f64, rng: &mut Rng) -> DVec3 {
    let single = bsdf.single(wo, wi);
    let explained = single.element_sum() / (pdf * bsdf.fresnel.normal().element_sum());
    // A black surface explains nothing: NaN counts as no extra walks.
    let walks = 1 + (EXTRA_WALKS * (1.0 - explained).clamp(0.0, 1.0)) as u32;
    let multiple: DVec3 = (0..walks).map(|_| bsdf.multiple(wo, wi, rng)).sum();
    single + multiple / f64::from(walks)
}

/// `f_cos · jacobian`, RGB, dimensionless: unbiased whatever the map, signed where it folds.
///
/// `jacobian` is the signed determinant of u ↦ solid angle (sr) from
/// [`crate::Backend::sample_jacobian`].
pub fn exact_weight(bsdf: &Conductor, wo: DVec3, wi: DVec3, jacobian: f64, rng: &mut Rng) -> DVec3 {
    exact_f_cos(bsdf, wo, wi, 1.0 / jacobian.abs(), rng) * jacobian
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::Bsdf;

    /// Standard errors allowed between two means.
    const SIGMAS: f64 = 5.0;

    #[test]
    fn its_mean_is_that_of_eval() {
        let bsdf = Conductor::new([0.3, 0.1], [1.0, 0.782, 0.344]).expect("valid parameters");
        let wo = DVec3::new(0.5, 0.3, 0.81).normalize();
        let wi = DVec3::new(0.2, -0.6, 0.7).normalize();
        let jacobian = -0.7;
        let moments = |draw: &mut dyn FnMut(&mut Rng) -> f64, key: u64| {
            let n = 200_000;
            let mut rng = Rng::new(&[key]);
            let (mut sum, mut square) = (0.0, 0.0);
            for _ in 0..n {
                let x = draw(&mut rng);
                sum += x;
                square += x * x;
            }
            let mean = sum / f64::from(n);
            (mean, (square / f64::from(n) - mean * mean) / f64::from(n))
        };
        let weight = moments(&mut |rng| exact_weight(&bsdf, wo, wi, jacobian, rng).y, 1);
        let eval = moments(&mut |rng| bsdf.eval(wo, wi, rng).y * jacobian, 2);
        assert!((weight.0 - eval.0).abs() < SIGMAS * (weight.1 + eval.1).sqrt());
        assert!(weight.1 < eval.1);
    }
}
