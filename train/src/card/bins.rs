//! Histograms of directions in 64 × 64 bins: on the disk, or in the square of a lobe frame where the lobe is
//! too narrow for the disk.

use bake_runtime::chart::Chart;
use glam::DVec3;

/// Bins per side.
pub const SIDE: usize = 64;

/// A lobe whose 90 % fill fewer disk bins than this is binned in its frame's square.
pub const NARROW_BINS: usize = 400;

/// Where bins lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bins {
    /// The orthographic disk, [−1, 1]².
    Disk,
    /// The square of a chart.
    Square(Chart),
}

impl Bins {
    /// Bin of a direction above the horizon.
    pub fn index(&self, w: DVec3) -> usize {
        let [a, b] = match self {
            Bins::Disk => [0.5 * (w.x + 1.0), 0.5 * (w.y + 1.0)],
            Bins::Square(chart) => chart.direction_to_square(w.to_array()),
        };
        let cell = |v: f64| ((v * SIDE as f64) as usize).min(SIDE - 1);
        cell(b) * SIDE + cell(a)
    }

    /// Quadrature nodes of one bin, `sub`² midpoints: (direction, solid angle).
    pub fn nodes(&self, bin: usize, sub: usize) -> impl Iterator<Item = (DVec3, f64)> {
        let bins = *self;
        let fine = (SIDE * sub) as f64;
        let corner = [bin % SIDE * sub, bin / SIDE * sub].map(|v| v as f64);
        (0..sub * sub).filter_map(move |k| {
            let at = [(k % sub) as f64 + 0.5, (k / sub) as f64 + 0.5];
            let s = [0, 1].map(|c: usize| (corner[c] + at[c]) / fine);
            let (w, measure) = match bins {
                Bins::Disk => {
                    let (x, y) = (2.0 * s[0] - 1.0, 2.0 * s[1] - 1.0);
                    let z2 = 1.0 - x * x - y * y;
                    if z2 <= 0.0 {
                        return None;
                    }
                    // dω = dx dy / z, and the square [−1, 1]² has area 4.
                    (DVec3::new(x, y, z2.sqrt()), 4.0 / z2.sqrt())
                }
                Bins::Square(chart) => {
                    let (w, area) = chart.square_to_direction(s);
                    (DVec3::from_array(w), area)
                }
            };
            Some((w, measure / (fine * fine)))
        })
    }

    /// Integral of a density (sr⁻¹) over every bin, by `sub`² midpoints per bin.
    pub fn integrate(&self, sub: usize, density: impl Fn(DVec3) -> f64) -> Vec<f64> {
        let mass = |bin: usize| -> f64 {
            self.nodes(bin, sub)
                .map(|(w, solid_angle)| density(w) * solid_angle)
                .sum()
        };
        (0..SIDE * SIDE).map(mass).collect()
    }
}

/// Number of the fullest bins that together hold 90 % of `mass`.
pub fn bins_of_90_percent(mass: &[f64]) -> usize {
    let mut sorted = mass.to_vec();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let goal = 0.9 * mass.iter().sum::<f64>();
    let mut sum = 0.0;
    sorted
        .iter()
        .take_while(|m| {
            sum += *m;
            sum < goal
        })
        .count()
        + 1
}

/// Σ |counts/N − mass/total|.
pub fn l1(counts: &[u64], mass: &[f64]) -> f64 {
    let (n, total) = (counts.iter().sum::<u64>() as f64, mass.iter().sum::<f64>());
    counts
        .iter()
        .zip(mass)
        .map(|(c, m)| (*c as f64 / n - m / total).abs())
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 8² midpoints per bin along the rim of the disk.
    const DISK_TOL: f64 = 2e-3;
    /// Midpoints in the frame's own square, where its density is constant.
    const SQUARE_TOL: f64 = 1e-9;

    #[test]
    fn a_cosine_lobe_integrates_to_one_in_both_kinds_of_bins() {
        let cosine = |w: DVec3| w.z / std::f64::consts::PI;
        assert!((Bins::Disk.integrate(8, cosine).iter().sum::<f64>() - 1.0).abs() < DISK_TOL);
        let mass = Bins::Square(Chart::IDENTITY).integrate(4, cosine);
        assert!((mass.iter().sum::<f64>() - 1.0).abs() < SQUARE_TOL);
        assert_eq!(Bins::Square(Chart::IDENTITY).index(DVec3::Z) % SIDE, SIDE / 2);
        assert!((bins_of_90_percent(&mass) as f64 / (SIDE * SIDE) as f64 - 0.9).abs() < DISK_TOL);
    }
}
