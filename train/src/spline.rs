//! Bicubic B-spline interpolation of a grid over the unit square: twice continuously differentiable, with its
//! exact gradient, which Newton's method and the density loss both need.
//!
//! Source: Unser, Aldroubi and Eden 1993, *B-Spline Signal Processing*. The boundary is mirrored half a cell
//! outside the outermost nodes, so the normal derivative vanishes on the edges of the square.

/// Cells added on each side so that lookups at the edge stay inside the array.
const PAD: usize = 2;

/// Bicubic splines through values at the cell centres of an m × m grid over `[0,1]²`, one for each of `C` channels.
///
/// The channels of a node lie side by side: tables are far larger than any cache, and what a lookup costs is the number of
/// places in memory that it touches.
#[derive(Clone, Debug)]
pub struct Spline<const C: usize = 1> {
    /// Cells per side.
    pub cells: usize,
    /// Padded coefficients, row-major, first coordinate along rows.
    coefficients: Vec<[f32; C]>,
}

/// Solves (c[i−1] + 4 c[i] + c[i+1]) / 6 = f[i] in place with mirrored ends, on a line with a stride.
fn prefilter_line(values: &mut [f64], start: usize, stride: usize, count: usize, upper: &mut [f64]) {
    let at = |i: usize| start + i * stride;
    // The mirror doubles the end's own weight: 4 + 1 on the diagonal of the first and last row.
    let diagonal = |i: usize| match (i == 0, i + 1 == count) {
        (true, true) => 6.0,
        (true, false) | (false, true) => 5.0,
        (false, false) => 4.0,
    };
    upper[0] = 1.0 / diagonal(0);
    values[at(0)] *= 6.0 / diagonal(0);
    for i in 1..count {
        let pivot = diagonal(i) - upper[i - 1];
        upper[i] = 1.0 / pivot;
        values[at(i)] = (6.0 * values[at(i)] - values[at(i - 1)]) / pivot;
    }
    for i in (0..count - 1).rev() {
        values[at(i)] -= upper[i] * values[at(i + 1)];
    }
}

/// Turns values at the nodes of a `cells` × `cells` grid into B-spline coefficients, in place.
pub fn prefilter(values: &mut [f64], cells: usize) {
    let mut scratch = vec![0.0; cells];
    for j in 0..cells {
        prefilter_line(values, j * cells, 1, cells, &mut scratch);
    }
    for i in 0..cells {
        prefilter_line(values, i, cells, cells, &mut scratch);
    }
}

/// Index of node `i` mirrored into `0..m`.
pub fn mirror(i: isize, m: usize) -> usize {
    let m = m as isize;
    let i = i.rem_euclid(2 * m);
    (if i < m { i } else { 2 * m - 1 - i }) as usize
}

/// Weights and slopes of the four cubic B-splines around the fractional position `t` in [0, 1].
pub fn weights(t: f64) -> ([f64; 4], [f64; 4]) {
    let s = 1.0 - t;
    let (t2, s2) = (t * t, s * s);
    let w = [
        s2 * s / 6.0,
        2.0 / 3.0 - t2 * (1.0 - 0.5 * t),
        2.0 / 3.0 - s2 * (1.0 - 0.5 * s),
        t2 * t / 6.0,
    ];
    let d = [-0.5 * s2, t * (1.5 * t - 2.0), -s * (1.5 * s - 2.0), 0.5 * t2];
    (w, d)
}

/// Second derivatives of the four cubic B-splines around the fractional position `t` in [0, 1].
pub fn curvatures(t: f64) -> [f64; 4] {
    [1.0 - t, 3.0 * t - 2.0, 1.0 - 3.0 * t, t]
}

impl<const C: usize> Spline<C> {
    /// Interpolates the `values` of every channel (`cells`², row-major, first coordinate fastest).
    pub fn new(values: [&[f64]; C], cells: usize) -> Spline<C> {
        let side = cells + 2 * PAD;
        let node = |k: usize| mirror(k as isize - PAD as isize, cells);
        let mut coefficients = vec![[0.0; C]; side * side];
        for (channel, values) in values.into_iter().enumerate() {
            assert_eq!(values.len(), cells * cells, "one value per cell");
            let mut c = values.to_vec();
            prefilter(&mut c, cells);
            for (k, out) in coefficients.iter_mut().enumerate() {
                out[channel] = c[node(k / side) * cells + node(k % side)] as f32;
            }
        }
        Spline { cells, coefficients }
    }

    /// Values at a place that was looked up for this number of cells, and their gradients per unit of the square. Inlined,
    /// it leaves out what the caller does not use.
    #[inline(always)]
    fn around(&self, patch: &Patch) -> [(f64, [f64; 2]); C] {
        let Patch {
            weights: [(wx, dx), (wy, dy)],
            ..
        } = patch;
        let (mut value, mut gx, mut gy) = ([0.0; C], [0.0; C], [0.0; C]);
        for r in 0..4 {
            let (mut line, mut slope) = ([0.0; C], [0.0; C]);
            for (k, node) in self.row(patch, r).iter().enumerate() {
                for c in 0..C {
                    line[c] += wx[k] * f64::from(node[c]);
                    slope[c] += dx[k] * f64::from(node[c]);
                }
            }
            for c in 0..C {
                value[c] += wy[r] * line[c];
                gx[c] += wy[r] * slope[c];
                gy[c] += dy[r] * line[c];
            }
        }
        let m = self.cells as f64;
        std::array::from_fn(|c| (value[c], [gx[c] * m, gy[c] * m]))
    }

    /// The four coefficients of row `r` of `patch`.
    #[inline]
    fn row(&self, patch: &Patch, r: usize) -> &[[f32; C]] {
        let [i, j] = patch.start;
        let start = (j + r) * (self.cells + 2 * PAD) + i;
        &self.coefficients[start..start + 4]
    }
}

impl Spline {
    /// Value at `s` (clamped to the square) and its gradient per unit of the square.
    pub fn at(&self, s: [f64; 2]) -> (f64, [f64; 2]) {
        let [found] = self.around(&Patch::new(s, self.cells));
        found
    }
}

/// The coefficients around a place, and their weights with slopes along either side.
struct Patch {
    start: [usize; 2],
    weights: [([f64; 4], [f64; 4]); 2],
}

impl Patch {
    fn new(s: [f64; 2], cells: usize) -> Patch {
        let m = cells as f64;
        let locate = |v: f64| {
            let x = v.clamp(0.0, 1.0) * m - 0.5;
            let i = x.floor().clamp(-1.0, m - 1.0);
            ((i + 1.0) as usize, weights(x - i))
        };
        let ((i, wx), (j, wy)) = (locate(s[0]), locate(s[1]));
        Patch {
            start: [i, j],
            weights: [wx, wy],
        }
    }
}

/// Splines over the unit square whose cells crowd towards the edges: cell centres lie at
/// s = t²(3 − 2t) for t at the centres of an even grid.
///
/// In the square of a lobe frame a distance e from the edge is a height of about 2√e above the local horizon,
/// so densities change there like functions of √e: evenly in t, where e ≈ 3t².
#[derive(Clone, Debug)]
pub struct EdgeSpline<const C: usize = 1> {
    even: Spline<C>,
}

/// Position of the even coordinate `t`: the smoothstep t²(3 − 2t).
pub fn crowd(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

/// Smallest t at which the slope of [`EdgeSpline`] is taken: at the edge itself ds/dt vanishes.
const SLOPE_EDGE: f64 = 1e-4;

/// Centre of cell `k` of the crowded n × n grid.
pub fn edge_cell_centre(k: usize, n: usize) -> [f64; 2] {
    cell_centre(k, n).map(crowd)
}

/// Area of cell `k` of the crowded grid, times n²: the weight of its centre in a mean over the square.
pub fn edge_cell_weight(k: usize, n: usize) -> f64 {
    let width = |i: usize| (crowd((i + 1) as f64 / n as f64) - crowd(i as f64 / n as f64)) * n as f64;
    width(k % n) * width(k / n)
}

impl<const C: usize> EdgeSpline<C> {
    /// Interpolates the `values` of every channel at [`edge_cell_centre`].
    pub fn new(values: [&[f64]; C], cells: usize) -> EdgeSpline<C> {
        EdgeSpline {
            even: Spline::new(values, cells),
        }
    }

    /// Values at a place that was looked up for this number of cells, and their gradients per unit of the square.
    #[inline]
    pub fn around(&self, place: &EdgePlace) -> [(f64, [f64; 2]); C] {
        let [sx, sy] = place.slope;
        self.even
            .around(&place.patch)
            .map(|(value, [gx, gy])| (value, [gx * sx, gy * sy]))
    }

    /// The values alone.
    #[inline]
    pub fn values(&self, place: &EdgePlace) -> [f64; C] {
        self.even.around(&place.patch).map(|(value, _)| value)
    }

    /// The values at `s` (clamped to the square).
    pub fn values_at(&self, s: [f64; 2]) -> [f64; C] {
        self.values(&EdgePlace::new(s, self.even.cells))
    }
}

impl EdgeSpline {
    /// Value at `s` (clamped to the square) and its gradient per unit of the square.
    pub fn at(&self, s: [f64; 2]) -> (f64, [f64; 2]) {
        let [found] = self.around(&EdgePlace::new(s, self.even.cells));
        found
    }
}

/// A place of the square, looked up once for all [`EdgeSpline`]s with as many cells.
pub struct EdgePlace {
    patch: Patch,
    /// dt/ds.
    slope: [f64; 2],
}

impl EdgePlace {
    /// The place `s` (clamped to the square) on `cells`² cells.
    pub fn new(s: [f64; 2], cells: usize) -> EdgePlace {
        // Inverse of the smoothstep: t = 1/2 − sin(asin(1 − 2s)/3).
        let t = s.map(|v| (0.5 - ((1.0 - 2.0 * v.clamp(0.0, 1.0)).asin() / 3.0).sin()).clamp(0.0, 1.0));
        let slope = |t: f64| {
            let t = t.clamp(SLOPE_EDGE, 1.0 - SLOPE_EDGE);
            1.0 / (6.0 * t * (1.0 - t))
        };
        EdgePlace {
            patch: Patch::new(t, cells),
            slope: t.map(slope),
        }
    }
}

/// Centre of cell `k` of an n × n grid over the unit square.
pub fn cell_centre(k: usize, n: usize) -> [f64; 2] {
    [
        ((k % n) as f64 + 0.5) / n as f64,
        ((k / n) as f64 + 0.5) / n as f64,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Coefficients are stored in f32.
    const NODE_TOL: f64 = 1e-6;
    /// Fourth-order interpolation error of cos(πx)cos(2πy) on 32 cells, with room for f32 coefficients.
    const SMOOTH_TOL: f64 = 2e-5;
    /// The same for its gradient (third order).
    const GRADIENT_TOL: f64 = 3e-3;

    /// Largest error of a boundary layer in √e of width 0.03 on 64 crowded cells, outermost half cell included.
    const EDGE_TOL: f64 = 0.2;
    /// Even cells do worse by at least this factor: what the crowding is for.
    const EDGE_GAIN: f64 = 4.0;

    #[test]
    fn crowded_cells_resolve_a_square_root_at_the_edge() {
        let n = 64;
        let f = |s: [f64; 2]| (0.03 / (s[0].sqrt() + 0.03)).ln() + s[1];
        let crowded: Vec<f64> = (0..n * n).map(|k| f(edge_cell_centre(k, n))).collect();
        let even: Vec<f64> = (0..n * n).map(|k| f(cell_centre(k, n))).collect();
        let (crowded, even) = (EdgeSpline::new([&crowded], n), Spline::new([&even], n));
        let positions = || (0..200).map(|i| [10f64.powf(-5.0 + 0.02 * f64::from(i)) * 0.9, 0.4]);
        let ours = positions()
            .map(|s| (crowded.at(s).0 - f(s)).abs())
            .fold(0.0, f64::max);
        let theirs = positions()
            .map(|s| (even.at(s).0 - f(s)).abs())
            .fold(0.0, f64::max);
        assert!(ours < EDGE_TOL && EDGE_GAIN * ours < theirs, "{ours} {theirs}");
        let area: f64 = (0..n * n).map(|k| edge_cell_weight(k, n)).sum();
        assert!((area / (n * n) as f64 - 1.0).abs() < NODE_TOL);
    }

    #[test]
    fn interpolates_nodes_and_a_smooth_function() {
        use std::f64::consts::PI;
        let n = 32;
        let f = |s: [f64; 2]| (PI * s[0]).cos() * (2.0 * PI * s[1]).cos();
        let values: Vec<f64> = (0..n * n).map(|k| f(cell_centre(k, n))).collect();
        let spline = Spline::new([&values], n);
        for (k, v) in values.iter().enumerate() {
            assert!((spline.at(cell_centre(k, n)).0 - v).abs() < NODE_TOL);
        }
        for k in 0..97 * 97 {
            let s = [(k % 97) as f64 / 96.0, (k / 97) as f64 / 96.0];
            let (v, g) = spline.at(s);
            assert!((v - f(s)).abs() < SMOOTH_TOL, "{v} {} at {s:?}", f(s));
            let gx = -PI * (PI * s[0]).sin() * (2.0 * PI * s[1]).cos();
            let gy = -2.0 * PI * (PI * s[0]).cos() * (2.0 * PI * s[1]).sin();
            assert!((g[0] - gx).abs() < GRADIENT_TOL && (g[1] - gy).abs() < GRADIENT_TOL);
        }
    }
}
