//! Bounds of the transport cost from below, from any potential whatever.
//!
//! Source: Kantorovich's duality; Peyré and Cuturi 2019, *Computational Optimal Transport*, §3.1 and §5.1. The
//! c-transform of a potential on the targets is the largest one on the sources that is feasible with it, so their means
//! add up to no more than the cost of any assignment.

use rayon::prelude::*;

use super::plane::Plane;

/// f_i = min_j |x_i − y_j|² − g_j for every one of `points` over `others` with potential g.
pub fn c_transform(points: &[[f64; 2]], others: &[[f64; 2]], potential: &[f64]) -> Vec<f64> {
    let plane = Plane::new(others, potential);
    points.par_iter().map(|p| plane.smallest(*p).value).collect()
}

/// A lower bound of the mean squared distance of every one-to-one map from `source` onto `target`, as many points.
///
/// `potential` on the targets may be anything finite; the better it is, the tighter the bound. It is transformed to the
/// sources and back, which never loosens the bound.
pub fn lower_bound(source: &[[f64; 2]], target: &[[f64; 2]], potential: &[f64]) -> f64 {
    let f = c_transform(source, target, potential);
    let g = c_transform(target, source, &f);
    (f.iter().sum::<f64>() + g.iter().sum::<f64>()) / source.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::points::source_points;
    use bake_runtime::Rng;

    /// Round-off of sums of a few hundred terms near 1.
    const ROUND_OFF: f64 = 1e-12;

    #[test]
    fn the_affine_potential_of_a_translation_is_tight() {
        let source = source_points(16);
        let t = [0.25, -0.5];
        let target: Vec<[f64; 2]> = source.iter().map(|p| [p[0] + t[0], p[1] + t[1]]).collect();
        // φ(y) = |t|² + 2 t·(y − t) + const touches the cost at every pair.
        let g: Vec<f64> = target.iter().map(|y| 2.0 * (t[0] * y[0] + t[1] * y[1])).collect();
        let bound = lower_bound(&source, &target, &g);
        assert!((bound - (t[0] * t[0] + t[1] * t[1])).abs() < ROUND_OFF, "{bound}");
    }

    #[test]
    fn any_potential_is_a_bound() {
        let mut rng = Rng::new(&[32]);
        let source = source_points(12);
        let target: Vec<[f64; 2]> = source.iter().map(|_| [rng.uniform(), rng.uniform()]).collect();
        let cost = source
            .iter()
            .zip(&target)
            .map(|(a, b)| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2))
            .sum::<f64>()
            / 144.0;
        for scale in [0.0, 0.1, 10.0] {
            let g: Vec<f64> = source.iter().map(|_| scale * rng.uniform()).collect();
            assert!(lower_bound(&source, &target, &g) <= cost);
        }
    }
}
