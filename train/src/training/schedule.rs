//! Learning rates over the steps of a run.

/// TEMP placeholder until the optimisers branch lands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Schedule {
    WarmCosine,
}
impl Schedule {
    /// Rate.
    pub fn rate(self, peak: f64, step: u64, steps: u64) -> f64 {
        let progress = step as f64 / steps as f64;
        let cosine = 0.5 * (1.0 + (std::f64::consts::PI * progress).cos());
        let warm_up = ((step + 1) as f64 / 50.0).min(1.0);
        peak * warm_up * (cosine + 1e-3)
    }
}
