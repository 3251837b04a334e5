//! What native backends answer beyond the interface of all: exact densities, and samples weighed by them.

use bake_runtime::conformance::queries::{Queries, refs, slices};
use bake_runtime::native::{Inversions, NativeBackend, Tier};
use bake_runtime::{BakedMaterial, Error};

/// A backend for `material`, which must exist on this processor.
pub fn backend(material: &BakedMaterial, tier: Tier) -> NativeBackend {
    NativeBackend::new(material, tier).expect("the tier is available and the material is sound")
}

/// Exact densities, and samples weighed by them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inverted {
    /// Zeros on the disk.
    pub exact_pdf: Vec<f32>,
    pub wi: [Vec<f32>; 3],
    pub mixture: Vec<f32>,
    /// Of the exact pdf and of the mixture; not part of the columns.
    pub inversions: [Inversions; 2],
}

impl Inverted {
    /// All arrays, with their names.
    pub fn columns(&self) -> Vec<(&'static str, &[f32])> {
        let mut all = vec![("exact pdf", self.exact_pdf.as_slice())];
        all.extend(self.wi.iter().map(|column| ("wi of mixture", column.as_slice())));
        all.push(("mixture", &self.mixture));
        all
    }
}

/// Asks both; what stays unwritten is NaN.
pub fn invert(backend: &NativeBackend, queries: &Queries) -> Inverted {
    let one = vec![f32::NAN; queries.len()];
    let mut answers = Inverted {
        exact_pdf: one.clone(),
        wi: [one.clone(), one.clone(), one.clone()],
        mixture: one,
        inversions: Default::default(),
    };
    let params = queries.columns();
    let points = queries.points(&params);
    answers.inversions[0] = match backend.exact_pdf(points, refs(&queries.wi), &mut answers.exact_pdf) {
        Ok(inversions) => inversions,
        Err(Error::Query { .. }) => {
            answers.exact_pdf.fill(0.0);
            Inversions::default()
        }
        Err(other) => panic!("{other}"),
    };
    let (u, wi) = (refs(&queries.u), slices(&mut answers.wi));
    answers.inversions[1] = backend
        .sample_mixture(points, u, wi, &mut answers.mixture)
        .expect("equal lengths");
    answers
}
