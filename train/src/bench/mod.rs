//! Speed of what others are compared with, beside the error that it buys.

pub mod peak;
pub mod reference;

/// The median of `values`, the upper one of two; NaN where there is none.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}
