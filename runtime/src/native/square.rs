//! The concentric map between the unit square and the hemisphere on vectors, both ways. The same formulas as
//! [`crate::concentric`], which says where they come from.

use super::math::{atan, sin_cos};
use super::vector::Vector;
use std::f32::consts::{FRAC_1_PI, FRAC_PI_4};

/// Smallest distance from an edge that [`hemisphere_to_square`] gives: far below any that a map reaches, and far above
/// the smallest normal number.
pub const EDGE_MIN: f32 = 1.0 / (1u64 << 60) as f32;

/// [`crate::concentric::square_to_hemisphere`].
#[inline(always)]
pub fn square_to_hemisphere<V: Vector>(s: [V; 2], complement: [V; 2]) -> [V; 3] {
    let a = s[0] - complement[0];
    let b = s[1] - complement[1];
    // The nearer edge decides, not the larger coordinate: in a corner both coordinates round to 1.
    let (edge_x, edge_y) = (s[0].min(complement[0]), s[1].min(complement[1]));
    let first = edge_x.less(edge_y);
    let edge = V::select(first, edge_x, edge_y);
    let r = V::select(first, a, b);
    let minor = V::select(first, b, a);
    // At the centre both are 0; a divisor that is 1 there makes the ratio 0.
    let zero = r.splat(0.0);
    let divisor = V::select(zero.less(r.abs()), r, r.splat(1.0));
    let (sin, cos) = sin_cos(minor.over(divisor) * r.splat(FRAC_PI_4));
    let (along, across) = (r * cos, r * sin);
    let z2 = r.splat(4.0) * edge * (r.splat(1.0) - edge);
    [
        V::select(first, along, across),
        V::select(first, across, along),
        z2 * z2.max(r.splat(f32::MIN_POSITIVE)).inverse_sqrt(),
    ]
}

/// The position s of a unit direction with z ≥ 0, and 1 − s: the inverse of [`square_to_hemisphere`]. Both keep their
/// relative precision next to the edges, as far as z does.
#[inline(always)]
pub fn hemisphere_to_square<V: Vector>(w: [V; 3]) -> ([V; 2], [V; 2]) {
    let [x, y, z] = w;
    let (zero, half, one) = (x.splat(0.0), x.splat(0.5), x.splat(1.0));
    let r = x.mul_add(x, y * y).sqrt();
    let (size_x, size_y) = (x.abs(), y.abs());
    let first = size_y.less(size_x);
    let (major, minor) = (V::select(first, size_x, size_y), V::select(first, size_y, size_x));
    // 1 − r = z²/(1 + r): the distance of the larger coordinate from its edge is half of that, and the smaller one is as
    // much farther from its own as its angle is from the diagonal, for which (major − minor)/(major + minor) is the tangent.
    let edge = (half * z * z / (one + r)).max(x.splat(EDGE_MIN));
    let sum = (major + minor).max(x.splat(f32::MIN_POSITIVE));
    let from_diagonal = atan((major - minor) / sum) * x.splat(4.0 * FRAC_1_PI);
    let other = (half * r).mul_add(from_diagonal, edge).min(half);
    let edges = [V::select(first, edge, other), V::select(first, other, edge)];
    let place = |edge: V, coordinate: V| {
        let low = coordinate.less(zero);
        (V::select(low, edge, one - edge), V::select(low, one - edge, edge))
    };
    let ((s_x, c_x), (s_y, c_y)) = (place(edges[0], x), place(edges[1], y));
    ([s_x, s_y], [c_x, c_y])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::native::arch::scalar::Scalar;
    use crate::native::vector::Simd;
    use crate::random::Rng;

    /// Some roundings of the quotients and of the angle, twice.
    const ROUND_TRIP_TOL: f32 = 1e-6;
    /// Next to a diagonal the angle is as precise as x and y, which are rounded.
    const ANGLE_TOL: f32 = 1.5e-7;

    fn number(v: impl Vector) -> f32 {
        let mut out = [0.0];
        v.store(&mut out);
        out[0]
    }

    #[test]
    fn positions_come_back_with_their_distance_from_the_edges() {
        let mut rng = Rng::new(&[0x5cea]);
        for i in 0..20_000 {
            // Evenly, and over decades next to the edges.
            let near = rng.pair().map(|v| match i % 2 {
                0 => v,
                _ => (-30.0 * v).exp2() * 0.5,
            });
            let far = near.map(|v| 1.0 - v);
            let (s, complement) = match i % 6 {
                0 | 1 => (near, far),
                2 | 3 => ([far[0], near[1]], [near[0], far[1]]),
                _ => (far, near),
            };
            let vectors = |w: [f64; 2]| w.map(|v| Scalar.splat(v as f32));
            let w = square_to_hemisphere(vectors(s), vectors(complement));
            let (found, rest) = hemisphere_to_square(w);
            let edges = [0, 1].map(|c: usize| s[c].min(complement[c]));
            for c in 0..2 {
                let nearer = edges[c] + f64::from(ANGLE_TOL) < edges[1 - c];
                let angle = if nearer { 0.0 } else { ANGLE_TOL };
                for (found, expected) in [(found[c], s[c]), (rest[c], complement[c])] {
                    let (found, expected) = (number(found), expected as f32);
                    assert!(
                        (found - expected).abs() <= ROUND_TRIP_TOL * expected + angle,
                        "{found} instead of {expected} at {s:?}"
                    );
                }
            }
        }
    }
}
