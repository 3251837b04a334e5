//! A latitude–longitude radiance map, importance sampled.
//!
//! Radiance is constant over each texel, and so is the sampling density: `sample`, `pdf` and `radiance` agree
//! exactly, which an interpolated lookup could not offer.
//! Source of the row–column inversion: Pharr, Jakob and Humphreys 2023, *Physically Based Rendering*, §A.5.6.

use glam::Vec3;
use std::f64::consts::{PI, TAU};

/// Radiance from infinity. Row 0 is at +y (the zenith); columns start at azimuth 0 = +z and go through +x.
#[derive(Clone, Debug)]
pub struct Environment {
    width: usize,
    height: usize,
    texels: Vec<Vec3>,
    /// Density of each texel, sr⁻¹.
    pdf: Vec<f32>,
    /// Share of the energy in the rows before, `height + 1` values from 0 to 1.
    rows: Vec<f64>,
    /// The same inside each row, `width + 1` values per row.
    columns: Vec<f64>,
}

/// One direction drawn by [`Environment::sample`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSample {
    /// Unit direction to the light, world space.
    pub direction: Vec3,
    /// Radiance from there, RGB.
    pub radiance: Vec3,
    /// Density of `direction`, sr⁻¹.
    pub pdf: f32,
}

impl Environment {
    /// A map of `width` × `height` texels, row by row from the zenith; each at least 0 and finite.
    ///
    /// # Panics
    /// When `texels` is empty or its length is not `width · height`.
    pub fn new(width: usize, height: usize, texels: Vec<Vec3>) -> Environment {
        assert!(width > 0 && height > 0 && texels.len() == width * height);
        let (mut rows, mut columns) = (vec![0.0], Vec::with_capacity((width + 1) * height));
        for (row, line) in texels.chunks_exact(width).enumerate() {
            let energies = line.iter().map(|t| energy(*t));
            columns.extend(cumulative(energies.clone()));
            rows.push(energies.sum::<f64>() * texel_solid_angle(width, height, row));
        }
        let total: f64 = rows.iter().sum();
        let rows = cumulative(rows.into_iter().skip(1));
        // A black map has nothing to find: density 0 everywhere.
        let density = |t: &Vec3| {
            if total > 0.0 {
                (energy(*t) / total) as f32
            } else {
                0.0
            }
        };
        let pdf = texels.iter().map(density).collect();
        Environment {
            width,
            height,
            texels,
            pdf,
            rows,
            columns,
        }
    }

    /// The same radiance from everywhere.
    pub fn constant(radiance: Vec3) -> Environment {
        Environment::new(1, 1, vec![radiance])
    }

    /// Radiance arriving from the unit vector `direction`, RGB.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        self.texels[self.texel(direction)]
    }

    /// Radiance seen along the unit vector `direction`, RGB, interpolated between texel centres.
    ///
    /// For camera rays only, so that a backdrop shows no texels: it does not match `pdf`.
    pub fn backdrop(&self, direction: Vec3) -> Vec3 {
        let [x, y] = self.position(direction).map(|p| p - 0.5);
        let (column, row) = (x.floor(), y.floor());
        let line = |row: f64| {
            let row = row.clamp(0.0, self.height as f64 - 1.0) as usize * self.width;
            let at = |column: f64| self.texels[row + column.rem_euclid(self.width as f64) as usize];
            at(column).lerp(at(column + 1.0), (x - column) as f32)
        };
        line(row).lerp(line(row + 1.0), (y - row) as f32)
    }

    /// Density with which [`Environment::sample`] draws the unit vector `direction`, sr⁻¹.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        self.pdf[self.texel(direction)]
    }

    /// A direction drawn by radiance; `u` in `[0,1)²`. `None` when the map is black.
    pub fn sample(&self, u: [f32; 2]) -> Option<LightSample> {
        let (row, y) = invert(&self.rows, f64::from(u[1]))?;
        let line = &self.columns[row * (self.width + 1)..(row + 1) * (self.width + 1)];
        let (column, x) = invert(line, f64::from(u[0]))?;
        // Uniform in azimuth and in height, hence per solid angle.
        let edge = |row: usize| (PI * row as f64 / self.height as f64).cos();
        let height = edge(row) + y * (edge(row + 1) - edge(row));
        let radius = (1.0 - height * height).max(0.0).sqrt();
        let (sin, cos) = (TAU * (column as f64 + x) / self.width as f64).sin_cos();
        let direction = Vec3::new((radius * sin) as f32, height as f32, (radius * cos) as f32).normalize();
        // Looked up, not taken from the texel: rounding at an edge must not part this from `pdf`.
        let texel = self.texel(direction);
        let pdf = self.pdf[texel];
        (pdf > 0.0).then_some(LightSample {
            direction,
            radiance: self.texels[texel],
            pdf,
        })
    }

    /// Column and row of `direction`, with fractions, from the top left corner of the map.
    fn position(&self, direction: Vec3) -> [f64; 2] {
        let polar = f64::from(direction.y.clamp(-1.0, 1.0)).acos() / PI;
        let azimuth = f64::from(direction.x)
            .atan2(f64::from(direction.z))
            .rem_euclid(TAU)
            / TAU;
        [azimuth * self.width as f64, polar * self.height as f64]
    }

    fn texel(&self, direction: Vec3) -> usize {
        let [x, y] = self.position(direction);
        (y as usize).min(self.height - 1) * self.width + (x as usize).min(self.width - 1)
    }
}

/// Unit vector at `azimuth` and `elevation` in radians: azimuth 0 is +z, a quarter turn is +x.
pub fn direction_of(azimuth: f64, elevation: f64) -> Vec3 {
    let (sin, cos) = azimuth.sin_cos();
    let radius = elevation.cos();
    Vec3::new(
        (radius * sin) as f32,
        elevation.sin() as f32,
        (radius * cos) as f32,
    )
}

/// What texels are sampled by: the mean of the channels, so that no colour is left to the BSDF alone.
fn energy(radiance: Vec3) -> f64 {
    f64::from(radiance.x + radiance.y + radiance.z) / 3.0
}

fn texel_solid_angle(width: usize, height: usize, row: usize) -> f64 {
    let edge = |row: usize| (PI * row as f64 / height as f64).cos();
    (edge(row) - edge(row + 1)) * TAU / width as f64
}

/// Running sums divided by the total, from 0 to 1; all zeros when the total is.
fn cumulative(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sums = vec![0.0];
    sums.extend(values.scan(0.0, |sum, v| {
        *sum += v;
        Some(*sum)
    }));
    let total = sums[sums.len() - 1];
    if total > 0.0 {
        sums.iter_mut().for_each(|s| *s /= total);
    }
    sums
}

/// Interval of `cumulative` that holds `u` in [0, 1), and the position in it; never an empty interval.
fn invert(cumulative: &[f64], u: f64) -> Option<(usize, f64)> {
    let after = cumulative.partition_point(|&c| c <= u);
    let (before, upper) = (after.checked_sub(1)?, cumulative.get(after)?);
    let lower = cumulative[before];
    Some((before, (u - lower) / (upper - lower)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::Rng;

    fn bumpy() -> Environment {
        let mut rng = Rng::new(&[3]);
        // Cubed, so that texels differ a thousandfold; a few are black.
        let texels = (0..16 * 8).map(|i| match i % 7 {
            0 => Vec3::ZERO,
            _ => Vec3::new(rng.uniform() as f32, rng.uniform() as f32, 0.1).powf(3.0),
        });
        Environment::new(16, 8, texels.collect())
    }

    /// f32 densities of 128 texels: each carries a relative rounding error of 6e-8.
    const NORMALISATION_TOL: f64 = 1e-6;

    #[test]
    fn pdf_integrates_to_one() {
        let environment = bumpy();
        let mass = |i: usize| f64::from(environment.pdf[i]) * texel_solid_angle(16, 8, i / 16);
        assert!(((0..128).map(mass).sum::<f64>() - 1.0).abs() < NORMALISATION_TOL);
        assert!((Environment::constant(Vec3::ONE).pdf(Vec3::X) - (0.25 / PI) as f32).abs() < 1e-8);
    }

    /// χ² of 128 bins stays below its mean plus five standard deviations, √(2·127).
    const CHI2_LIMIT: f64 = 127.0 + 5.0 * 15.94;

    #[test]
    fn samples_follow_the_pdf() {
        let environment = bumpy();
        let n = 400_000;
        let mut counts = [0.0; 128];
        let mut rng = Rng::new(&[11]);
        for _ in 0..n {
            let sample = environment
                .sample(rng.pair().map(|u| (u as f32).min(1.0f32.next_down())))
                .unwrap();
            let texel = environment.texel(sample.direction);
            assert_eq!(sample.pdf, environment.pdf(sample.direction));
            assert_eq!(sample.radiance, environment.radiance(sample.direction));
            counts[texel] += 1.0;
        }
        let chi2: f64 = (0..128)
            .map(|i| {
                let expected =
                    f64::from(n) * f64::from(environment.pdf[i]) * texel_solid_angle(16, 8, i / 16);
                if expected > 0.0 {
                    (counts[i] - expected) * (counts[i] - expected) / expected
                } else {
                    counts[i]
                }
            })
            .sum();
        assert!(chi2 < CHI2_LIMIT, "chi² {chi2}");
    }

    #[test]
    fn lookup_follows_the_documented_axes() {
        let mut texels = vec![Vec3::ZERO; 8];
        texels[1] = Vec3::ONE;
        let environment = Environment::new(4, 2, texels);
        // Column 1 of 4 spans azimuths 90°..180°, row 0 of 2 the upper hemisphere.
        assert_eq!(
            environment.radiance(direction_of(135f64.to_radians(), 0.5)),
            Vec3::ONE
        );
        assert_eq!(
            environment.radiance(direction_of(45f64.to_radians(), 0.5)),
            Vec3::ZERO
        );
        assert_eq!(
            environment.radiance(direction_of(135f64.to_radians(), -0.5)),
            Vec3::ZERO
        );
        assert!((direction_of(90f64.to_radians(), 0.0) - Vec3::X).length() < 1e-7);
    }

    #[test]
    fn black_map_has_no_samples() {
        let environment = Environment::constant(Vec3::ZERO);
        assert_eq!(environment.sample([0.3, 0.6]), None);
        assert_eq!(environment.pdf(Vec3::Y), 0.0);
    }
}
