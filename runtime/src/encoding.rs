//! Encodings of network inputs. They have no weights: training calls these functions and hands the networks
//! finished features, and every backend computes the same ones.

use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Most scalars that a quantity has.
pub const SCALARS_MAX: usize = 6;

/// What a network input is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// The two uniform numbers in `[0,1)²`; with two charts, those of the chart that was drawn.
    U,
    /// The camera's direction, folded by the material's symmetry: unit, z ≥ 0.
    Wo,
    /// Its x and y.
    WoDisk,
    /// x and y of the light's direction, folded like the camera's.
    WiDisk,
    /// The light's direction in the frame of this chart: unit, z ≥ 0.
    Local(usize),
    /// The analytic chart that the mirror chart starts from, [`crate::anchor::anchor_scalars`].
    Anchor,
    /// The free parameter of this number, in the order of [`crate::Material::free`].
    Parameter(usize),
    /// +1 for the first chart, −1 for the second.
    Chart,
}

/// What is done to every scalar before its encoding: t(x) carried from `[t(min), t(max)]` onto `[0, 1]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scale {
    /// Nothing.
    #[default]
    None,
    /// t(x) = x.
    Linear([f64; 2]),
    /// t(x) = √x.
    Sqrt([f64; 2]),
    /// t(x) = 1 − e⁻ˣ.
    Decay([f64; 2]),
}

/// How a quantity enters a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Encoding {
    /// x ↦ 2x − 1.
    Centred,
    /// x ↦ x.
    Identity,
    /// [`grazing`]: a direction with its distance from the horizon resolved.
    Grazing,
    /// [`slant`]: the same for a direction whose y is 0.
    Slant,
    /// x ↦ sin(2⁰πx), cos(2⁰πx), …, sin(2^(k−1)πx), cos(2^(k−1)πx) (Mildenhall et al. 2020, Eq. 4) for this k.
    Frequency(usize),
    /// x ↦ exp(−½(l·x − i − ½)²), i = 0…l − 1: Gaussians of width 1/l at the centres of l bins of `[0, 1]`
    /// (Müller et al. 2019, §4.3, who leave the kernel open) for this l.
    OneBlob(usize),
}

impl Quantity {
    /// Number of scalars.
    pub fn scalars(self) -> usize {
        match self {
            Quantity::Parameter(_) | Quantity::Chart => 1,
            Quantity::U | Quantity::WoDisk | Quantity::WiDisk => 2,
            Quantity::Local(_) | Quantity::Wo => 3,
            Quantity::Anchor => crate::anchor::ANCHOR_SCALARS,
        }
    }
}

impl Scale {
    /// (offset, factor) with the scaled value = factor·(t(x) − offset).
    pub fn affine(self) -> (f64, f64) {
        match self {
            Scale::None => (0.0, 1.0),
            Scale::Linear([min, max]) | Scale::Sqrt([min, max]) | Scale::Decay([min, max]) => {
                let (low, high) = (self.transform(min), self.transform(max));
                (low, 1.0 / (high - low))
            }
        }
    }

    /// t(x).
    pub fn transform(self, x: f64) -> f64 {
        match self {
            Scale::None | Scale::Linear(_) => x,
            Scale::Sqrt(_) => x.max(0.0).sqrt(),
            Scale::Decay(_) => -(-x).exp_m1(),
        }
    }

    /// The scaled value.
    pub fn apply(self, x: f64) -> f64 {
        let (offset, factor) = self.affine();
        factor * (self.transform(x) - offset)
    }

    /// Whether its range is one: where t is defined, and its ends so far apart that single precision can carry them onto
    /// `[0, 1]`.
    pub fn is_sound(self) -> bool {
        let defined = match self {
            Scale::None | Scale::Linear(_) | Scale::Decay(_) => true,
            Scale::Sqrt([min, _]) => min >= 0.0,
        };
        let (offset, factor) = self.affine();
        let is_single = |x: f64| (x as f32).is_finite();
        defined && factor > 0.0 && is_single(offset) && is_single(factor)
    }
}

impl Encoding {
    /// Number of features that `scalars` scalars become.
    pub fn features(self, scalars: usize) -> usize {
        match self {
            Encoding::Centred | Encoding::Identity => scalars,
            Encoding::Grazing => GRAZING_FEATURES,
            Encoding::Slant => SLANT_FEATURES,
            Encoding::Frequency(k) => 2 * k * scalars,
            Encoding::OneBlob(l) => l * scalars,
        }
    }

    /// Appends the features of `values`, scalar by scalar, to `out`.
    pub fn append(self, values: &[f64], out: &mut Vec<f64>) {
        match self {
            Encoding::Centred => out.extend(values.iter().map(|v| 2.0 * v - 1.0)),
            Encoding::Identity => out.extend_from_slice(values),
            Encoding::Grazing => out.extend(grazing([values[0], values[1], values[2]])),
            Encoding::Slant => out.extend(slant([values[0], values[1], values[2]])),
            Encoding::Frequency(k) => {
                for v in values {
                    out.extend((0..k).flat_map(|i| {
                        let (sin, cos) = half_turns(v * (1u64 << i) as f64);
                        [sin, cos]
                    }));
                }
            }
            Encoding::OneBlob(l) => {
                for v in values {
                    out.extend((0..l).map(|i| blob(v, i, l).0));
                }
            }
        }
    }

    /// Appends the derivative of every feature by the scalar that it belongs to, for the encodings that u may have;
    /// features of other scalars do not depend on it.
    pub fn append_slopes(self, values: &[f64], out: &mut Vec<f64>) {
        match self {
            Encoding::Centred => out.extend(values.iter().map(|_| 2.0)),
            Encoding::Identity => out.extend(values.iter().map(|_| 1.0)),
            Encoding::Grazing | Encoding::Slant => unreachable!("directions do not depend on u"),
            Encoding::Frequency(k) => {
                for v in values {
                    out.extend((0..k).flat_map(|i| {
                        let scale = (1u64 << i) as f64;
                        let (sin, cos) = half_turns(v * scale);
                        [PI * scale * cos, -PI * scale * sin]
                    }));
                }
            }
            Encoding::OneBlob(l) => {
                for v in values {
                    out.extend((0..l).map(|i| blob(v, i, l).1));
                }
            }
        }
    }

    /// Whether it may encode a quantity of `scalars` scalars; directions have three.
    pub fn suits(self, scalars: usize) -> bool {
        match self {
            Encoding::Centred | Encoding::Identity => true,
            Encoding::Grazing | Encoding::Slant => scalars == 3,
            Encoding::Frequency(k) => (1..=FREQUENCIES_MAX).contains(&k),
            Encoding::OneBlob(l) => (1..=BINS_MAX).contains(&l),
        }
    }
}

/// Most frequencies of a frequency encoding: the highest still has some 2⁸ f32 values per period.
pub const FREQUENCIES_MAX: usize = 16;
/// Most bins of a one-blob encoding.
pub const BINS_MAX: usize = 64;

/// (sin πx, cos πx), the argument reduced exactly before it is multiplied by π.
fn half_turns(x: f64) -> (f64, f64) {
    (PI * (x - 2.0 * (0.5 * x).round())).sin_cos()
}

/// Value and derivative of Gaussian `i` of `l` at `x`.
fn blob(x: &f64, i: usize, l: usize) -> (f64, f64) {
    let t = x * l as f64 - i as f64 - 0.5;
    let value = (-0.5 * t * t).exp();
    (value, -t * l as f64 * value)
}

/// Number of features of [`grazing`].
pub const GRAZING_FEATURES: usize = 7;

/// Number of features of [`slant`].
pub const SLANT_FEATURES: usize = 4;

/// Softening of the logarithm in [`grazing`]: features stop moving 0.6° above the horizon.
pub const GRAZING_LOG_OFFSET: f64 = 0.01;

/// Features of a direction: x, y, z, √z, 1 + ln(z + 0.01)/2, x² − y², 2xy.
///
/// BSDF lobes change per decade of z next to the horizon, which √z and the logarithm resolve; the last two
/// are sin²θ times the second harmonic of the azimuth, smooth at the pole. No trigonometry, so a SIMD lane
/// pays one square root and one logarithm. `w`: unit, z ≥ 0. Every feature lies in [−1.4, 1.1].
pub fn grazing(w: [f64; 3]) -> [f64; GRAZING_FEATURES] {
    let [x, y, z] = w;
    let [_, _, root, log] = slant(w);
    [x, y, z, root, log, x * x - y * y, 2.0 * x * y]
}

/// Features of a direction whose y is 0: x, z, √z, 1 + ln(z + 0.01)/2. `w`: unit, z ≥ 0.
pub fn slant(w: [f64; 3]) -> [f64; SLANT_FEATURES] {
    let [x, _, z] = w;
    [x, z, z.sqrt(), 1.0 + 0.5 * (z + GRAZING_LOG_OFFSET).ln()]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Central differences with step 1e-6 of features that turn up to 2¹¹ times.
    const DIFFERENCE_TOL: f64 = 1e-2;
    /// Round-off of a few operations.
    const TOL: f64 = 1e-12;

    #[test]
    fn slopes_are_those_of_the_features() {
        let h = 1e-6;
        for encoding in [
            Encoding::Centred,
            Encoding::Identity,
            Encoding::Frequency(12),
            Encoding::OneBlob(12),
        ] {
            for x in [0.0, 0.1234, 0.5, 0.93] {
                let at = |x: f64| {
                    let mut out = Vec::new();
                    encoding.append(&[x], &mut out);
                    out
                };
                let mut slopes = Vec::new();
                encoding.append_slopes(&[x], &mut slopes);
                assert_eq!(slopes.len(), encoding.features(1));
                let (up, down) = (at(x + h), at(x - h));
                for ((a, b), slope) in up.iter().zip(&down).zip(&slopes) {
                    let found = (a - b) / (2.0 * h);
                    assert!(
                        (found - slope).abs() <= DIFFERENCE_TOL * (1.0 + slope.abs()),
                        "{encoding:?} at {x}"
                    );
                }
            }
        }
    }

    #[test]
    fn frequencies_are_exact_however_high() {
        let mut out = Vec::new();
        Encoding::Frequency(12).append(&[0.5 + 1.0 / 4096.0], &mut out);
        // 2¹¹·(½ + 2⁻¹²)·π = 1024π + π/2.
        assert!((out[22] - 1.0).abs() < TOL && out[23].abs() < TOL);
    }

    #[test]
    fn scales_reach_from_zero_to_one() {
        for scale in [
            Scale::Linear([0.5, 3.0]),
            Scale::Sqrt([0.5, 3.0]),
            Scale::Decay([0.5, 3.0]),
        ] {
            assert!(scale.apply(0.5).abs() < TOL && (scale.apply(3.0) - 1.0).abs() < TOL && scale.is_sound());
        }
        assert_eq!(Scale::None.apply(0.3), 0.3);
        assert!(!Scale::Linear([1.0, 1.0]).is_sound() && !Scale::Sqrt([-1.0, 1.0]).is_sound());
        for range in [
            [f64::NAN, 1.0],
            [0.0, f64::INFINITY],
            [-1e308, 1e308],
            [1e39, 2e39],
            [0.0, 1e-39],
        ] {
            assert!(!Scale::Linear(range).is_sound(), "{range:?}");
        }
        // The first is 1 to the last bit, the second −∞.
        for range in [[800.0, 900.0], [-800.0, 0.0]] {
            assert!(!Scale::Decay(range).is_sound(), "{range:?}");
        }
    }
}
