//! What `bake bench` found: the rows of its table.

use super::queries::Estimator;
use super::subjects::Subject;
use bake_runtime::native::Tier;
use serde::Serialize;
use std::collections::BTreeMap;

/// One row of the table.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// What was measured.
    pub subject: String,
    /// `native` or `ort`.
    pub backend: &'static str,
    /// SIMD tier of `native`.
    pub tier: Option<&'static str>,
    /// Always `f32`.
    pub precision: &'static str,
    /// What was asked.
    pub estimator: Estimator,
    /// Width of the sampling network's hidden layers.
    pub width: usize,
    /// Number of them.
    pub depth: usize,
    /// Queries per call.
    pub batch: usize,
    /// Whether free parameters were bound.
    pub bound: bool,
    /// Whether encodings and heads belong to what ran.
    pub encoding_in_graph: bool,
    /// Median, nanoseconds; of `load` those of all of it.
    pub ns_per_query: f64,
    /// 10⁹ operations a second of the layers' multiply-adds, two for each.
    pub gflops: Option<f64>,
    /// Share of the tier's peak, or of the best tier's for onnxruntime.
    pub percent_of_fma_peak: Option<f64>,
    /// Largest |a − b| / max(1, |b|) against f64.
    pub max_abs_error: Option<f64>,
    /// Binning error of the sampling network, θ_o ≤ 75°, from its card.
    pub binning_l1: Option<f64>,
}

/// Everything that was measured.
pub struct Results {
    /// Rows, by subject, batch and backend.
    pub rows: Vec<Row>,
    /// Peak of every tier, and multiply-adds of whole vectors a cycle.
    pub peaks: BTreeMap<&'static str, (f64, f64)>,
}

impl Row {
    /// A row without numbers.
    pub fn new(
        subject: &Subject,
        backend: &'static str,
        tier: Option<Tier>,
        estimator: Estimator,
        batch: usize,
    ) -> Row {
        let [depth, width] = subject.shape;
        Row {
            subject: subject.name.clone(),
            backend,
            tier: tier.map(Tier::name),
            precision: "f32",
            estimator,
            width,
            depth,
            batch,
            bound: false,
            encoding_in_graph: true,
            ns_per_query: f64::NAN,
            gflops: None,
            percent_of_fma_peak: None,
            max_abs_error: None,
            binning_l1: None,
        }
    }

    /// Whether `other` is the same but for its numbers.
    pub fn is_like(&self, other: &Row) -> bool {
        (self.backend, self.tier, self.bound, self.estimator)
            == (other.backend, other.tier, other.bound, other.estimator)
    }
}
