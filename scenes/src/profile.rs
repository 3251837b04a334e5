//! Profiles of turned objects: control points joined by a smooth curve.
//!
//! Source: Yuksel, Schaefer and Keyser 2011, *Parameterization and Applications of Catmull–Rom Curves*: with
//! centripetal knots the curve has no cusps or loops between its points.

use glam::Vec2;

/// A point of the curve: (radius, height), and the unit tangent there.
pub type ProfilePoint = (Vec2, Vec2);

/// Smooth pieces of the curve through `points` = (radius, height), each as a list of sampled points.
///
/// A point that stands twice in a row is a crease: one piece ends there and the next begins.
/// An end on the axis (radius 0) gets a horizontal tangent, so that the turned surface is smooth there.
/// Every span between two control points is cut into `steps` parts. Radii never go below 0.
pub fn smooth_pieces(points: &[Vec2], steps: usize) -> Vec<Vec<ProfilePoint>> {
    points
        .chunk_by(|a, b| a != b)
        .filter(|piece| piece.len() > 1)
        .map(|piece| smooth_piece(piece, steps))
        .collect()
}

fn smooth_piece(points: &[Vec2], steps: usize) -> Vec<ProfilePoint> {
    let last = points.len() - 1;
    let extended: Vec<Vec2> = std::iter::once(beyond_end(points[0], points[1]))
        .chain(points.iter().copied())
        .chain([beyond_end(points[last], points[last - 1])])
        .collect();
    let mut curve = Vec::with_capacity(last * steps + 1);
    for (span, window) in extended.windows(4).enumerate() {
        let first = usize::from(span > 0);
        curve.extend((first..=steps).map(|i| catmull_rom(window, i as f32 / steps as f32)));
    }
    curve
}

/// The point that continues the curve past its `end`: the mirror image in the axis, or of the neighbour.
fn beyond_end(end: Vec2, neighbour: Vec2) -> Vec2 {
    match end.x == 0.0 {
        true => Vec2::new(-neighbour.x, neighbour.y),
        false => 2.0 * end - neighbour,
    }
}

/// Position and unit tangent at `t` in `[0,1]` between the middle two of four points.
fn catmull_rom(p: &[Vec2], t: f32) -> ProfilePoint {
    // Knot distances: square roots of the chords.
    let [before, span, after] = [0, 1, 2].map(|i| (p[i + 1] - p[i]).length().sqrt());
    // Tangents of the parabolas through three neighbours, in units of this span.
    let slope = |a: Vec2, b: Vec2, c: Vec2, left: f32, right: f32| {
        ((b - a) / left * right + (c - b) / right * left) / (left + right) * span
    };
    let (m0, m1) = (
        slope(p[0], p[1], p[2], before, span),
        slope(p[1], p[2], p[3], span, after),
    );
    // Cubic Hermite form.
    let (d, s) = (p[2] - p[1], t * t);
    let position = p[1] + m0 * t + (3.0 * d - 2.0 * m0 - m1) * s + (m0 + m1 - 2.0 * d) * s * t;
    let derivative = m0 + (3.0 * d - 2.0 * m0 - m1) * (2.0 * t) + (m0 + m1 - 2.0 * d) * (3.0 * s);
    (
        Vec2::new(position.x.max(0.0), position.y),
        derivative.normalize_or(Vec2::X),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A few roundings of f32 numbers of order 1.
    const TOL: f32 = 1e-6;

    #[test]
    fn curve_passes_its_points_with_matching_tangents() {
        let points = [
            Vec2::new(0.0, 0.0),
            Vec2::new(1.0, 0.2),
            Vec2::new(0.7, 1.0),
            Vec2::new(0.9, 1.4),
        ];
        let pieces = smooth_pieces(&points, 8);
        assert_eq!((pieces.len(), pieces[0].len()), (1, 3 * 8 + 1));
        for (i, p) in points.iter().enumerate() {
            assert!((pieces[0][i * 8].0 - p).length() < TOL);
        }
        assert!((pieces[0][0].1 - Vec2::X).length() < TOL, "level on the axis");
        let turns = pieces[0].windows(2).map(|w| w[0].1.dot(w[1].1));
        // 24 steps around about 300° of turning: no step turns by more than 60°.
        assert!(turns.fold(1.0, f32::min) > 0.5);
    }

    #[test]
    fn doubled_point_is_a_crease() {
        let corner = Vec2::new(1.0, 0.0);
        let pieces = smooth_pieces(&[Vec2::ZERO, corner, corner, Vec2::new(1.0, 2.0)], 2);
        assert_eq!(pieces.len(), 2);
        assert!((pieces[0][2].1 - Vec2::X).length() < TOL && (pieces[1][0].1 - Vec2::Y).length() < TOL);
    }
}
