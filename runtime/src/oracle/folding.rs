//! Queries folded by the symmetry of their material, and answers unfolded.

use crate::spec::Symmetry;

/// `wo` folded by `symmetry`, and the columns of the orthogonal matrix M with x, y of `wi` = M·(x, y of folded `wi`).
pub fn fold(symmetry: Symmetry, wo: [f64; 3]) -> ([f64; 3], [[f64; 2]; 2]) {
    let [x, y, z] = wo;
    match symmetry {
        Symmetry::Quadrant => {
            let sign = |v: f64| if v < 0.0 { -1.0 } else { 1.0 };
            ([x.abs(), y.abs(), z], [[sign(x), 0.0], [0.0, sign(y)]])
        }
        Symmetry::Rotation => {
            let sin = x.hypot(y);
            let [c, s] = if sin > 0.0 { [x / sin, y / sin] } else { [1.0, 0.0] };
            ([sin, 0.0, z], [[c, s], [-s, c]])
        }
    }
}

/// The direction whose fold is `w`.
pub fn unfold([first, second]: [[f64; 2]; 2], w: [f64; 3]) -> [f64; 3] {
    [
        first[0] * w[0] + second[0] * w[1],
        first[1] * w[0] + second[1] * w[1],
        w[2],
    ]
}

/// `w` folded with the matrix of [`fold`].
pub fn folded([first, second]: [[f64; 2]; 2], w: [f64; 3]) -> [f64; 3] {
    [
        first[0] * w[0] + first[1] * w[1],
        second[0] * w[0] + second[1] * w[1],
        w[2],
    ]
}
