//! Means with their standard errors, one value at a time or set by set.

use crate::bsdf::Estimate;
use crate::real::{Real, Vec3};

/// Running mean and squared deviations of RGB values, such as of many [`crate::bsdf::Bsdf::eval`], without cancellation.
#[derive(Clone, Copy, Debug, Default)]
pub struct Moments {
    count: Real,
    mean: Vec3,
    squares: Vec3,
}

impl Moments {
    /// Takes `value` in: Welford 1962, *Note on a Method for Calculating Corrected Sums of Squares and Products*.
    pub fn add(&mut self, value: Vec3) {
        self.count += 1.0;
        let before = value - self.mean;
        self.mean += before / self.count;
        self.squares += before * (value - self.mean);
    }

    /// Both sets together: Chan, Golub and LeVeque 1983.
    pub fn merged(self, other: Moments) -> Moments {
        let count = self.count + other.count;
        let difference = other.mean - self.mean;
        let share = other.count / count;
        Moments {
            count,
            mean: self.mean + difference * share,
            squares: self.squares + other.squares + difference * difference * (self.count * share),
        }
    }

    /// The mean and its standard error; at least two values.
    pub fn estimate(&self) -> Estimate {
        let variance = self.squares / (self.count * (self.count - 1.0));
        Estimate {
            mean: self.mean,
            se: Vec3::from_array(variance.to_array().map(Real::sqrt)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Rng;

    /// Round-off of sums in another order.
    const ROUND_OFF: Real = 1e-12;
    /// Deviations of a thousandth of the values lose three digits of them.
    const SE_ROUND_OFF: Real = 1e-9;

    #[test]
    fn moments_merge_exactly() {
        let mut rng = Rng::new(&[5]);
        let values: Vec<Vec3> = (0..100).map(|_| Vec3::splat(1e3) + rng.uniform()).collect();
        let of = |values: &[Vec3]| {
            let mut moments = Moments::default();
            values.iter().for_each(|v| moments.add(*v));
            moments
        };
        let (whole, merged) = (of(&values), of(&values[..30]).merged(of(&values[30..])));
        let (whole, merged) = (whole.estimate(), merged.estimate());
        assert!((whole.mean / merged.mean - 1.0).abs().max_element() < ROUND_OFF);
        assert!((whole.se / merged.se - 1.0).abs().max_element() < SE_ROUND_OFF);
    }
}
