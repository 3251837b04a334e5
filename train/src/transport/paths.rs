//! The search of [`super::assignment`] for its shortest path from one row to the columns: Dijkstra's algorithm (1959, *A
//! Note on Two Problems in Connexion with Graphs*) over a complete graph, a row at a time and as wide as the processor
//! allows.

use super::plane::Plane;

/// Lanes of the accumulators: one AVX-512 register, two of AVX2.
const LANES: usize = 8;

/// What the search for one path needs, reused by the next.
pub struct Paths {
    /// Shortest distance found so far; infinite for columns of the tree.
    pub distance: Vec<f64>,
    /// Infinite for columns of the tree, 0 for the others.
    pub closed: Vec<f64>,
    /// Row before every column on its path, as wide as a distance.
    pub before: Vec<u64>,
    /// Columns of the tree and their final distances.
    pub tree: Vec<(usize, f64)>,
}

impl Paths {
    /// For `n` columns.
    pub fn new(n: usize) -> Paths {
        Paths {
            distance: vec![0.0; n],
            closed: vec![0.0; n],
            before: vec![0; n],
            tree: Vec::new(),
        }
    }

    /// Shortens distances by way of `row` at `p`, and finds the nearest column outside the tree.
    #[inline(always)]
    pub fn relax(&mut self, plane: &Plane, p: [f64; 2], row: usize, base: f64) -> (usize, f64) {
        let n = self.distance.len();
        let (x, y, g) = (&plane.x[..n], &plane.y[..n], &plane.potential[..n]);
        let (distance, closed, before) = (&mut self.distance[..n], &self.closed[..n], &mut self.before[..n]);
        let mut nearest = [f64::INFINITY; LANES];
        let mut visit = |lane: usize, j: usize| {
            let (a, b) = (p[0] - x[j], p[1] - y[j]);
            let value = base + (a * a + b * b - g[j]) + closed[j];
            let shorter = value < distance[j];
            before[j] = if shorter { row as u64 } else { before[j] };
            distance[j] = if shorter { value } else { distance[j] };
            nearest[lane] = nearest[lane].min(distance[j]);
        };
        let whole = n - n % LANES;
        for block in (0..whole).step_by(LANES) {
            for lane in 0..LANES {
                visit(lane, block + lane);
            }
        }
        for j in whole..n {
            visit(j - whole, j);
        }
        let length = nearest.iter().copied().fold(f64::INFINITY, f64::min);
        let column = distance.iter().position(|d| *d == length).unwrap_or(0);
        (column, length)
    }
}
