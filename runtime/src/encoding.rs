//! Encodings of network inputs. They have no weights: training calls these functions and hands the networks
//! finished features, and every backend computes the same ones.

use serde::{Deserialize, Serialize};

/// What a network input is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// The two uniform numbers in `[0,1)²`.
    U,
    /// The light's direction in the lobe frame: unit, z ≥ 0.
    Local,
    /// The camera's direction, folded by the material's symmetry: unit, z ≥ 0.
    Wo,
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
}

impl Quantity {
    /// Number of scalars.
    pub fn scalars(self) -> usize {
        match self {
            Quantity::U => 2,
            Quantity::Local | Quantity::Wo => 3,
        }
    }
}

impl Encoding {
    /// Number of features that `scalars` scalars become.
    pub fn features(self, scalars: usize) -> usize {
        match self {
            Encoding::Centred | Encoding::Identity => scalars,
            Encoding::Grazing => GRAZING_FEATURES,
        }
    }

    /// Appends the features of `values` to `out`.
    pub fn append(self, values: &[f64], out: &mut Vec<f64>) {
        match self {
            Encoding::Centred => out.extend(values.iter().map(|v| 2.0 * v - 1.0)),
            Encoding::Identity => out.extend_from_slice(values),
            Encoding::Grazing => out.extend(grazing([values[0], values[1], values[2]])),
        }
    }
}

/// Number of features of [`grazing`].
pub const GRAZING_FEATURES: usize = 7;

/// Softening of the logarithm in [`grazing`]: features stop moving 0.6° above the horizon.
pub const GRAZING_LOG_OFFSET: f64 = 0.01;

/// Features of a direction: x, y, z, √z, 1 + ln(z + 0.01)/2, x² − y², 2xy.
///
/// BSDF lobes change per decade of z next to the horizon, which √z and the logarithm resolve; the last two
/// are sin²θ times the second harmonic of the azimuth, smooth at the pole. No trigonometry, so a SIMD lane
/// pays one square root and one logarithm. `w`: unit, z ≥ 0. Every feature lies in [−1.4, 1.1].
pub fn grazing(w: [f64; 3]) -> [f64; GRAZING_FEATURES] {
    let [x, y, z] = w;
    [
        x,
        y,
        z,
        z.sqrt(),
        1.0 + 0.5 * (z + GRAZING_LOG_OFFSET).ln(),
        x * x - y * y,
        2.0 * x * y,
    ]
}
