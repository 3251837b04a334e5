//! Points of the plane in columns, and the loop that every exact quantity here needs: the smallest of
//! |x − y_j|² − g_j over all j, in double precision and as wide as the processor allows.

use pulp::Arch;

/// Lanes of the accumulators: two AVX-512 registers, four of AVX2.
const LANES: usize = 16;

/// Points in columns, each with a potential.
#[derive(Clone, Debug)]
pub struct Plane {
    /// First coordinates.
    pub x: Vec<f64>,
    /// Second coordinates.
    pub y: Vec<f64>,
    /// Potentials g.
    pub potential: Vec<f64>,
}

/// The two smallest values of |x − y_j|² − g_j, and where the smallest lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smallest {
    /// Index of the smallest; the first of equals within a lane, a fixed one of them in any case.
    pub index: usize,
    /// The smallest.
    pub value: f64,
    /// The second smallest, infinite when there is one point only.
    pub second: f64,
}

impl Plane {
    /// `points` with potentials of the same number.
    pub fn new(points: &[[f64; 2]], potential: &[f64]) -> Plane {
        Plane {
            x: points.iter().map(|p| p[0]).collect(),
            y: points.iter().map(|p| p[1]).collect(),
            potential: potential.to_vec(),
        }
    }

    /// Over all points, from `p`.
    pub fn smallest(&self, p: [f64; 2]) -> Smallest {
        Arch::new().dispatch(|| self.scan(p))
    }

    #[inline(always)]
    fn scan(&self, [px, py]: [f64; 2]) -> Smallest {
        let n = self.x.len();
        let (x, y, g) = (&self.x[..n], &self.y[..n], &self.potential[..n]);
        let (mut first, mut second) = ([f64::INFINITY; LANES], [f64::INFINITY; LANES]);
        // Indices as numbers of the same width, so that they are selected in the same lanes.
        let mut at = [0.0; LANES];
        let whole = n - n % LANES;
        let mut visit = |lane: usize, j: usize| {
            let (a, b) = (px - x[j], py - y[j]);
            let value = a * a + b * b - g[j];
            second[lane] = second[lane].min(first[lane].max(value));
            at[lane] = if value < first[lane] { j as f64 } else { at[lane] };
            first[lane] = first[lane].min(value);
        };
        for block in (0..whole).step_by(LANES) {
            for lane in 0..LANES {
                visit(lane, block + lane);
            }
        }
        for j in whole..n {
            visit(j - whole, j);
        }
        let mut smallest = Smallest {
            index: at[0] as usize,
            value: first[0],
            second: second[0],
        };
        for lane in 1..LANES {
            let (value, index) = (first[lane], at[lane] as usize);
            let rest = smallest.second.min(second[lane]);
            if value < smallest.value {
                smallest = Smallest {
                    index,
                    second: rest.min(smallest.value),
                    value,
                };
            } else {
                smallest.second = rest.min(value);
            }
        }
        smallest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::Rng;

    #[test]
    fn the_two_smallest_are_those_of_a_sort() {
        let mut rng = Rng::new(&[31]);
        for n in [1, 2, 15, 16, 17, 100] {
            let points: Vec<[f64; 2]> = (0..n).map(|_| [rng.uniform(), rng.uniform()]).collect();
            let potential: Vec<f64> = (0..n).map(|_| rng.uniform()).collect();
            let plane = Plane::new(&points, &potential);
            for _ in 0..20 {
                let p = [rng.uniform(), rng.uniform()];
                let value =
                    |j: usize| (p[0] - points[j][0]).powi(2) + (p[1] - points[j][1]).powi(2) - potential[j];
                let mut order: Vec<usize> = (0..n).collect();
                order.sort_by(|a, b| value(*a).total_cmp(&value(*b)));
                let expected = Smallest {
                    index: order[0],
                    value: value(order[0]),
                    second: order.get(1).map_or(f64::INFINITY, |j| value(*j)),
                };
                assert_eq!(plane.smallest(p), expected);
            }
        }
    }
}
