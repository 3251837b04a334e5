//! Direct solver for the sparse systems of Newton's method on a square grid: nested dissection.
//!
//! Source: George 1973, *Nested Dissection of a Regular Finite Element Mesh*, with one dense front per part of the grid
//! (Duff and Reid 1983, *The Multifrontal Solution of Indefinite Sparse Symmetric Linear Equations*). Every unknown is
//! coupled to its eight neighbours at most. No pivoting: the linearised Monge–Ampère operator is elliptic with its
//! advection well resolved; the caller's line search rejects the step should a system ever be worse than that.
//! The work grows with the cube of the side, that of a band solver with its fourth power.

use pulp::Arch;

/// Regions of at most this many unknowns are not divided further.
const LEAF: usize = 24;

/// Coefficients of one row: those of the neighbours at (dj, di) in row-major order, the unknown itself in the middle.
pub type Row = [f64; 9];

/// A part of the grid: what it eliminates, and what is left of the neighbourhood when it has.
#[derive(Clone, Debug)]
struct Front {
    /// Unknowns that are eliminated here, then those around the part, which are eliminated later.
    unknowns: Vec<u32>,
    /// Number of the former.
    own: usize,
    /// (row of the front, column of the front, unknown, neighbour) of every coefficient that enters here.
    entries: Vec<[u32; 4]>,
    /// Parts whose remainder enters here, with the position of each of their remaining unknowns.
    children: Vec<(usize, Vec<u32>)>,
}

/// The order of elimination for one grid; the same for every system on it.
#[derive(Clone, Debug)]
pub struct Dissection {
    side: usize,
    fronts: Vec<Front>,
}

/// A rectangle of the grid, ends excluded.
#[derive(Clone, Copy)]
struct Rectangle {
    x: [usize; 2],
    y: [usize; 2],
}

impl Rectangle {
    fn unknowns(&self, side: usize) -> Vec<u32> {
        let columns = self.x[0]..self.x[1];
        (self.y[0]..self.y[1])
            .flat_map(|j| columns.clone().map(move |i| (j * side + i) as u32))
            .collect()
    }

    /// The unknowns that touch it from outside.
    fn around(&self, side: usize) -> Vec<u32> {
        let grown = |[a, b]: [usize; 2]| [a.saturating_sub(1), (b + 1).min(side)];
        let outer = Rectangle {
            x: grown(self.x),
            y: grown(self.y),
        };
        let inside = |k: u32| {
            let (i, j) = (k as usize % side, k as usize / side);
            (self.x[0]..self.x[1]).contains(&i) && (self.y[0]..self.y[1]).contains(&j)
        };
        outer.unknowns(side).into_iter().filter(|k| !inside(*k)).collect()
    }
}

impl Dissection {
    /// The order for `side` × `side` unknowns.
    pub fn new(side: usize) -> Dissection {
        let mut dissection = Dissection {
            side,
            fronts: Vec::new(),
        };
        let all = Rectangle {
            x: [0, side],
            y: [0, side],
        };
        // Rank of every unknown in the elimination, by the front that takes it.
        let mut front_of = vec![u32::MAX; side * side];
        dissection.divide(all, &mut front_of);
        for f in 0..dissection.fronts.len() {
            dissection.collect_entries(f, &front_of);
        }
        dissection
    }

    /// Appends the fronts of `part`, its own last; returns the number of that.
    fn divide(&mut self, part: Rectangle, front_of: &mut [u32]) -> usize {
        let (width, height) = (part.x[1] - part.x[0], part.y[1] - part.y[0]);
        let (children, separator) = if width * height <= LEAF || width.max(height) < 3 {
            (Vec::new(), part)
        } else {
            let halves = |[a, b]: [usize; 2]| {
                let middle = a + (b - a) / 2;
                ([a, middle], [middle, middle + 1], [middle + 1, b])
            };
            let parts = if width >= height {
                let (l, m, r) = halves(part.x);
                [l, m, r].map(|x| Rectangle { x, ..part })
            } else {
                let (l, m, r) = halves(part.y);
                [l, m, r].map(|y| Rectangle { y, ..part })
            };
            let children = vec![self.divide(parts[0], front_of), self.divide(parts[2], front_of)];
            (children, parts[1])
        };
        let own = separator.unknowns(self.side);
        let number = self.fronts.len();
        own.iter().for_each(|k| front_of[*k as usize] = number as u32);
        let count = own.len();
        let mut unknowns = own;
        unknowns.extend(part.around(self.side));
        let mut position = std::collections::HashMap::with_capacity(unknowns.len());
        unknowns.iter().enumerate().for_each(|(p, k)| {
            position.insert(*k, p as u32);
        });
        let children = children
            .into_iter()
            .map(|c| {
                let child: &Front = &self.fronts[c];
                (
                    c,
                    child.unknowns[child.own..].iter().map(|k| position[k]).collect(),
                )
            })
            .collect();
        self.fronts.push(Front {
            unknowns,
            own: count,
            entries: Vec::new(),
            children,
        });
        number
    }

    /// Lists the coefficients between what front `f` eliminates and what is eliminated with it or later.
    fn collect_entries(&mut self, f: usize, front_of: &[u32]) {
        let side = self.side as isize;
        let front = &self.fronts[f];
        let position: std::collections::HashMap<u32, u32> =
            (0..).zip(&front.unknowns).map(|(p, k)| (*k, p)).collect();
        let mut entries = Vec::new();
        for (p, &k) in (0u32..).zip(&front.unknowns[..front.own]) {
            let (i, j) = (k as isize % side, k as isize / side);
            for slot in 0..9u32 {
                let (x, y) = (i + slot as isize % 3 - 1, j + slot as isize / 3 - 1);
                if !(0..side).contains(&x) || !(0..side).contains(&y) {
                    continue;
                }
                let neighbour = (y * side + x) as u32;
                let later = front_of[neighbour as usize];
                if (later as usize) < f {
                    continue;
                }
                let q = position[&neighbour];
                entries.push([p, q, k, slot]);
                if later as usize > f {
                    entries.push([q, p, neighbour, 8 - slot]);
                }
            }
        }
        self.fronts[f].entries = entries;
    }

    /// Solves the system of `rows` (one per unknown, coefficients beyond the grid ignored) for every right-hand side in
    /// place. `false` on a vanishing pivot.
    #[must_use]
    pub fn solve<const R: usize>(&self, rows: &[Row], right: &mut [Vec<f64>; R]) -> bool {
        // Factors of every front: its own rows in full, then the own columns of the others.
        let mut factors: Vec<Vec<f64>> = Vec::with_capacity(self.fronts.len());
        let mut remainders: Vec<Vec<f64>> = Vec::with_capacity(self.fronts.len());
        for front in &self.fronts {
            let m = front.unknowns.len();
            let mut dense = vec![0.0; m * m];
            for &[p, q, k, slot] in &front.entries {
                dense[p as usize * m + q as usize] += rows[k as usize][slot as usize];
            }
            for (child, positions) in &front.children {
                let remainder = std::mem::take(&mut remainders[*child]);
                for (line, &p) in remainder.chunks_exact(positions.len().max(1)).zip(positions) {
                    let target = &mut dense[p as usize * m..(p as usize + 1) * m];
                    line.iter()
                        .zip(positions)
                        .for_each(|(v, &q)| target[q as usize] += v);
                }
            }
            // The widest vectors that the machine has.
            if !Arch::new().dispatch(|| eliminate(&mut dense, m, front.own)) {
                return false;
            }
            let others = m - front.own;
            let mut remainder = Vec::with_capacity(others * others);
            for p in front.own..m {
                remainder.extend_from_slice(&dense[p * m + front.own..(p + 1) * m]);
            }
            remainders.push(remainder);
            let mut kept = Vec::with_capacity(front.own * (m + others));
            kept.extend_from_slice(&dense[..front.own * m]);
            for p in front.own..m {
                kept.extend_from_slice(&dense[p * m..p * m + front.own]);
            }
            factors.push(kept);
        }
        for column in right.iter_mut() {
            Arch::new().dispatch(|| self.substitute(&factors, column));
        }
        true
    }

    /// Forward and backward substitution of one right-hand side.
    #[inline(always)]
    fn substitute(&self, factors: &[Vec<f64>], column: &mut [f64]) {
        let mut local = Vec::new();
        for (front, kept) in self.fronts.iter().zip(factors) {
            let (m, own) = (front.unknowns.len(), front.own);
            front.gather(column, &mut local);
            for r in 1..own {
                let (known, rest) = local.split_at_mut(r);
                rest[0] -= dot(&kept[r * m..r * m + r], known);
            }
            let (known, others) = local.split_at_mut(own);
            let below = kept[own * m..].chunks_exact(own);
            others
                .iter_mut()
                .zip(below)
                .for_each(|(x, row)| *x -= dot(row, known));
            let places = front.unknowns.iter().zip(&local);
            places.for_each(|(k, x)| column[*k as usize] = *x);
        }
        for (front, kept) in self.fronts.iter().zip(factors).rev() {
            let m = front.unknowns.len();
            front.gather(column, &mut local);
            for p in (0..front.own).rev() {
                let row = &kept[p * m..(p + 1) * m];
                let known = dot(&row[p + 1..], &local[p + 1..]);
                local[p] = (local[p] - known) / row[p];
            }
            let places = front.unknowns[..front.own].iter().zip(&local);
            places.for_each(|(k, x)| column[*k as usize] = *x);
        }
    }
}

/// Partial sums of a dot product.
const SUMS: usize = 8;

/// Σ a·b over the shorter one, in [`SUMS`] partial sums that need not wait for each other.
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len().min(b.len());
    let ((a, a_rest), (b, b_rest)) = (a[..n].as_chunks::<SUMS>(), b[..n].as_chunks::<SUMS>());
    let mut sums = [0.0; SUMS];
    for (a, b) in a.iter().zip(b) {
        sums.iter_mut()
            .zip(a.iter().zip(b))
            .for_each(|(s, (a, b))| *s += a * b);
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

impl Front {
    /// The values of its unknowns.
    fn gather(&self, column: &[f64], local: &mut Vec<f64>) {
        local.clear();
        local.extend(self.unknowns.iter().map(|k| column[*k as usize]));
    }
}

/// Pivots that are applied to a row at once.
const BLOCK: usize = 4;

/// Eliminates the first `own` unknowns of a dense m × m system in place: L below the diagonal (unit diagonal), U on and
/// above it, and what is left for the others in the lower right.
#[inline(always)]
fn eliminate(dense: &mut [f64], m: usize, own: usize) -> bool {
    let mut first = 0;
    while first < own {
        let last = (first + BLOCK).min(own);
        // The block's own columns and rows.
        for k in first..last {
            let pivot = dense[k * m + k];
            if !pivot.is_finite() || pivot == 0.0 {
                return false;
            }
            let (head, tail) = dense.split_at_mut((k + 1) * m);
            let pivot_row = &head[k * m..];
            for (i, row) in (k + 1..).zip(tail.chunks_exact_mut(m)) {
                let factor = row[k] / pivot;
                row[k] = factor;
                // Rows of the block are finished at once, others only within the block's columns.
                let end = if i < last { m } else { last };
                for (a, p) in row[k + 1..end].iter_mut().zip(&pivot_row[k + 1..end]) {
                    *a -= factor * p;
                }
            }
        }
        let (head, tail) = dense.split_at_mut(last * m);
        let pivots = &head[first * m..];
        for row in tail.chunks_exact_mut(m) {
            let (factors, rest) = row[first..].split_at_mut(last - first);
            if let [a, b, c, d] = *factors {
                let [p, q, r, s] = [0, 1, 2, 3].map(|k| &pivots[k * m + last..(k + 1) * m]);
                for ((((v, p), q), r), s) in rest.iter_mut().zip(p).zip(q).zip(r).zip(s) {
                    *v -= a * p + b * q + (c * r + d * s);
                }
            } else {
                for (k, factor) in factors.iter().enumerate() {
                    let pivot_row = &pivots[k * m + last..(k + 1) * m];
                    rest.iter_mut().zip(pivot_row).for_each(|(v, p)| *v -= factor * p);
                }
            }
        }
        first = last;
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::Rng;

    /// Round-off of diagonally dominant systems of up to a thousand unknowns.
    const RESIDUAL_TOL: f64 = 1e-12;

    /// The product of the matrix and `x`.
    fn apply(side: usize, rows: &[Row], x: &[f64]) -> Vec<f64> {
        let n = side as isize;
        let at = |i: isize, j: isize| match (0..n).contains(&i) && (0..n).contains(&j) {
            true => x[(j * n + i) as usize],
            false => 0.0,
        };
        (0..n * n)
            .map(|k| {
                let slots =
                    (0..9).map(|s| rows[k as usize][s as usize] * at(k % n + s % 3 - 1, k / n + s / 3 - 1));
                slots.sum()
            })
            .collect()
    }

    #[test]
    fn solves_random_dominant_systems_of_many_sizes() {
        for side in [1, 2, 3, 5, 8, 13, 16, 31] {
            let mut rng = Rng::new(&[side as u64]);
            let rows: Vec<Row> = (0..side * side)
                .map(|_| std::array::from_fn(|s| rng.uniform() - 0.5 + if s == 4 { 8.0 } else { 0.0 }))
                .collect();
            let x: Vec<f64> = (0..side * side).map(|_| rng.uniform()).collect();
            let mut right = [apply(side, &rows, &x)];
            assert!(Dissection::new(side).solve(&rows, &mut right));
            let error = right[0]
                .iter()
                .zip(&x)
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max);
            assert!(error < RESIDUAL_TOL, "side {side}: {error}");
        }
        assert!(!Dissection::new(4).solve(&[[0.0; 9]; 16], &mut [vec![1.0; 16]]));
    }
}
