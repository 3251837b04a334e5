//! The concentric map between the unit square and the hemisphere over the unit disk.
//!
//! Source: Shirley and Chiu 1997, *A Low Distortion Map Between Disk and Square*.
//! Deviation: the height z is computed from the distance to the nearest edge of the square, not from x and y,
//! so that directions next to the horizon keep their relative precision.

use crate::real::Real;
use crate::real::consts::{FRAC_PI_4, PI};

/// Density of the disk position per unit area of the square: the map has constant Jacobian π.
pub const DISK_AREA: Real = PI;

/// Direction over the disk position of `s`: `[x, y, z]`, unit, z ≥ 0.
///
/// `s` in `[0,1]²`, and `complement` = 1 − `s`, given apart because the caller knows it more precisely
/// than a subtraction would. The square's edges go to the horizon.
pub fn square_to_hemisphere(s: [Real; 2], complement: [Real; 2]) -> [Real; 3] {
    let a = s[0] - complement[0];
    let b = s[1] - complement[1];
    let first = a.abs() > b.abs();
    let (r, ratio, edge) = if first {
        (a, b / a, s[0].min(complement[0]))
    } else {
        (b, if b == 0.0 { 0.0 } else { a / b }, s[1].min(complement[1]))
    };
    let (sin, cos) = (FRAC_PI_4 * ratio).sin_cos();
    let (x, y) = if first {
        (r * cos, r * sin)
    } else {
        (r * sin, r * cos)
    };
    // |r| = 1 − 2·edge, so 1 − r² = 4·edge·(1 − edge).
    [x, y, (4.0 * edge * (1.0 - edge)).max(0.0).sqrt()]
}

/// Position in the square of the disk point `(x, y)`: the inverse of [`square_to_hemisphere`].
pub fn disk_to_square(x: Real, y: Real) -> [Real; 2] {
    let r = x.hypot(y);
    let (a, b) = if x.abs() > y.abs() {
        let a = r.copysign(x);
        (a, a * (y / x).atan() / FRAC_PI_4)
    } else {
        let b = r.copysign(y);
        (
            if y == 0.0 {
                0.0
            } else {
                b * (x / y).atan() / FRAC_PI_4
            },
            b,
        )
    };
    [
        (0.5 * (a + 1.0)).clamp(0.0, 1.0),
        (0.5 * (b + 1.0)).clamp(0.0, 1.0),
    ]
}

/// The position s of the unit direction `w`, z ≥ 0, and 1 − s: the inverse of [`square_to_hemisphere`]. Both keep their
/// relative precision next to the edges.
pub fn hemisphere_to_square(w: [Real; 3]) -> ([Real; 2], [Real; 2]) {
    let r = w[0].hypot(w[1]);
    let size = [w[0].abs(), w[1].abs()];
    let (major, minor) = if size[0] > size[1] { (0, 1) } else { (1, 0) };
    // 1 − r = z²/(1 + r): the larger coordinate is half of that from its edge, and the smaller one is as much farther
    // from its own as its angle is from the diagonal, for which (major − minor)/(major + minor) is the tangent.
    let mut edges = [0.5 * w[2] * w[2] / (1.0 + r); 2];
    if r > 0.0 {
        let from_diagonal = ((size[major] - size[minor]) / (size[major] + size[minor])).atan() / FRAC_PI_4;
        edges[minor] += 0.5 * r * from_diagonal;
    }
    let low = w.map(|c| c < 0.0);
    (
        [0, 1].map(|c| if low[c] { edges[c] } else { 1.0 - edges[c] }),
        [0, 1].map(|c| if low[c] { 1.0 - edges[c] } else { edges[c] }),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Rng;

    /// Real round-off of a handful of operations on numbers below 1.
    const ROUND_TRIP_TOL: Real = 1e-13;
    /// Central differences with step 1e-6 on a function with third derivatives of order 1.
    const JACOBIAN_TOL: Real = 1e-7;

    #[test]
    fn round_trip_and_constant_jacobian() {
        let mut rng = Rng::new(&[7]);
        let at = |s: [Real; 2]| square_to_hemisphere(s, [1.0 - s[0], 1.0 - s[1]]);
        for _ in 0..10_000 {
            let s = rng.pair();
            let d = at(s);
            let (place, complement) = hemisphere_to_square(d);
            for c in 0..2 {
                assert!((place[c] - s[c]).abs() < ROUND_TRIP_TOL);
                assert!((complement[c] - 1.0 + s[c]).abs() < ROUND_TRIP_TOL);
            }
            let back = disk_to_square(d[0], d[1]);
            assert!((back[0] - s[0]).abs() < ROUND_TRIP_TOL && (back[1] - s[1]).abs() < ROUND_TRIP_TOL);
            assert!((d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - 1.0).abs() < ROUND_TRIP_TOL);
            let h = 1e-6;
            let inside = s.iter().all(|c| (0.01..0.99).contains(c));
            let off_diagonal = ((s[0] - 0.5).abs() - (s[1] - 0.5).abs()).abs() > 1e-3;
            if inside && off_diagonal {
                let (l, r) = (at([s[0] - h, s[1]]), at([s[0] + h, s[1]]));
                let (b, t) = (at([s[0], s[1] - h]), at([s[0], s[1] + h]));
                let det = ((r[0] - l[0]) * (t[1] - b[1]) - (r[1] - l[1]) * (t[0] - b[0])) / (4.0 * h * h);
                assert!((det / DISK_AREA - 1.0).abs() < JACOBIAN_TOL, "{det} at {s:?}");
            }
        }
        assert_eq!(at([0.5, 0.5]), [0.0, 0.0, 1.0]);
        assert_eq!(hemisphere_to_square([0.0, 0.0, 1.0]), ([0.5; 2], [0.5; 2]));
        let (_, [edge, _]) = hemisphere_to_square(square_to_hemisphere([1.0, 0.3], [1e-30, 0.7]));
        assert!((edge / 1e-30 - 1.0).abs() < ROUND_TRIP_TOL);
    }
}
