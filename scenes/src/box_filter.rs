//! Pictures made larger or smaller by the mean over what a pixel covers.

/// Mean over every cell of a square part of `values` (`size` = width, height; x fastest), as `side`² values.
///
/// The part has its first corner at `corner` and edges of `length`, in pixels, and must lie inside. A cell takes every
/// pixel by the area that it covers of it, so the mean of the part is kept, whatever the sizes.
pub fn box_filter(values: &[f64], size: [usize; 2], corner: [f64; 2], length: f64, side: usize) -> Vec<f64> {
    let columns: Vec<Overlap> = (0..side)
        .map(|i| Overlap::new(size[0], corner[0], length, side, i))
        .collect();
    let rows = (0..side).map(|j| Overlap::new(size[1], corner[1], length, side, j));
    let mut out = Vec::with_capacity(side * side);
    for row in rows {
        let mut line = vec![0.0; size[0]];
        for (y, share) in row.shares() {
            let pixels = &values[y * size[0]..(y + 1) * size[0]];
            line.iter_mut().zip(pixels).for_each(|(sum, v)| *sum += share * v);
        }
        let mean = |column: &Overlap| column.shares().map(|(x, share)| share * line[x]).sum::<f64>();
        out.extend(columns.iter().map(mean));
    }
    out
}

/// What a cell covers of one axis, pixels.
struct Overlap {
    start: f64,
    end: f64,
    extent: usize,
}

impl Overlap {
    fn new(extent: usize, corner: f64, length: f64, side: usize, cell: usize) -> Overlap {
        let at = |edge: usize| corner + length * edge as f64 / side as f64;
        Overlap {
            start: at(cell),
            end: at(cell + 1),
            extent,
        }
    }

    /// Pixels that are covered, and their shares of the cell.
    fn shares(&self) -> impl Iterator<Item = (usize, f64)> {
        let last = (self.end.ceil() as usize).min(self.extent);
        (self.start as usize..last).map(|pixel| {
            let covered = self.end.min((pixel + 1) as f64) - self.start.max(pixel as f64);
            (pixel, covered.max(0.0) / (self.end - self.start))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative rounding of sums of a few thousand numbers of one sign.
    const ROUNDING: f64 = 1e-13;

    #[test]
    fn cells_take_pixels_by_their_area() {
        // Three columns into two: each cell has one whole pixel and half of the middle one.
        let values = [3.0, 6.0, 12.0, 3.0, 6.0, 12.0, 3.0, 6.0, 12.0];
        let halves = box_filter(&values, [3, 3], [0.0, 0.0], 3.0, 2);
        for (got, expected) in halves.iter().zip([4.0, 10.0, 4.0, 10.0]) {
            assert!((got - expected).abs() < ROUNDING, "{halves:?}");
        }
        // A whole multiple repeats pixels; a part starts at its corner.
        let twice = box_filter(&[1.0, 2.0, 3.0, 4.0], [2, 2], [0.0, 0.0], 2.0, 4);
        assert_eq!(twice[..8], [1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 2.0, 2.0]);
        let part = box_filter(&[1.0, 2.0, 4.0], [3, 1], [1.5, 0.0], 1.0, 1);
        assert_eq!(part, [3.0]);
    }

    #[test]
    fn the_mean_is_kept() {
        for (extent, side) in [(7, 3), (5, 16), (64, 48), (1, 9)] {
            let values: Vec<f64> = (0..extent * extent).map(|k| (k * k % 17 + 1) as f64).collect();
            let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
            let scaled = box_filter(&values, [extent; 2], [0.0; 2], extent as f64, side);
            let error = (mean(&scaled) - mean(&values)).abs();
            assert!(error <= ROUNDING * mean(&values), "{extent} to {side}: {error}");
        }
    }
}
