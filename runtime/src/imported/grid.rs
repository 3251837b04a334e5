//! The grid that the rows of a table form: one axis per parameter, one of θ_o, one of φ_o.

use crate::real::Real;

/// Degrees of a full turn.
pub(super) const TURN: f32 = 360.0;

/// Widest gap between neighbouring azimuths of wo, degrees.
///
/// Three azimuths are the fewest that surround the normal, and half a degree is left to round-off. A wider gap
/// mostly means that only a half or a quarter of the circle was tabulated.
const PHI_GAP_MAX: f32 = 120.5;

/// The distinct values of one coordinate, ascending; at least one.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    /// The values as the file has them.
    pub values: Vec<f32>,
}

/// Where a coordinate lies on its axis: `fraction` of the way from the value `lower` to the value `upper`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bracket {
    lower: usize,
    upper: usize,
    fraction: Real,
}

impl Bracket {
    /// The one or two values with a share in the interpolation, and their weights, which are positive and sum to 1.
    pub fn parts(self) -> impl Iterator<Item = (usize, Real)> {
        [(self.lower, 1.0 - self.fraction), (self.upper, self.fraction)]
            .into_iter()
            .filter(|&(_, weight)| weight > 0.0)
    }
}

impl Axis {
    /// The distinct ones of `values`, which are finite and not none.
    pub fn of(values: impl Iterator<Item = f32>) -> Axis {
        // Adding 0 makes one zero of two.
        let mut values: Vec<f32> = values.map(|v| v + 0.0).collect();
        values.sort_unstable_by(f32::total_cmp);
        values.dedup();
        Axis { values }
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// First and last value.
    pub fn range(&self) -> [f32; 2] {
        [self.values[0], self.values[self.len() - 1]]
    }

    /// Position of a value that is on the axis.
    fn index(&self, value: f32) -> usize {
        self.values.partition_point(|&v| v < value)
    }

    /// Where `at` lies; outside the range, the nearest value.
    pub fn bracket(&self, at: Real) -> Bracket {
        let above = self.values.partition_point(|&v| Real::from(v) <= at);
        if above == 0 || above == self.len() {
            let nearest = above.min(self.len() - 1);
            return Bracket {
                lower: nearest,
                upper: nearest,
                fraction: 0.0,
            };
        }
        let [lower, upper] = [above - 1, above].map(|i| Real::from(self.values[i]));
        Bracket {
            lower: above - 1,
            upper: above,
            fraction: (at - lower) / (upper - lower),
        }
    }

    /// Where the angle `at`, degrees, lies on an axis of at least two angles in [0, 360).
    pub fn bracket_on_circle(&self, at: Real) -> Bracket {
        let turn = Real::from(TURN);
        let at = at.rem_euclid(turn);
        let above = self.values.partition_point(|&v| Real::from(v) <= at);
        let (lower, upper) = ((above + self.len() - 1) % self.len(), above % self.len());
        let [from, to] = [lower, upper].map(|i| Real::from(self.values[i]));
        Bracket {
            lower,
            upper,
            fraction: (at - from).rem_euclid(turn) / (to - from).rem_euclid(turn),
        }
    }

    /// Checks that the angles, degrees in [0, 360), surround the circle; one angle alone needs not.
    ///
    /// # Errors
    /// The widest gap, where it is wider than [`PHI_GAP_MAX`].
    pub fn check_circle(&self) -> Result<(), String> {
        if self.len() == 1 {
            return Ok(());
        }
        let next = self.values[1..].iter().copied().chain([self.values[0] + TURN]);
        let widest = self
            .values
            .iter()
            .zip(next)
            .max_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0)));
        match widest {
            Some((from, to)) if to - from > PHI_GAP_MAX => Err(format!(
                "the azimuths of `wo` leave a gap from {from} to {to} degrees, but they must go round the circle \
                 (or be one alone, where the BSDF is isotropic)"
            )),
            _ => Ok(()),
        }
    }
}

/// The row of every combination of values, in the order of the grid (the last axis fastest).
///
/// `rows` holds the coordinates of each row, all on `axes`; `names` calls the axes in messages.
///
/// # Errors
/// The first combination that no row or more than one row has.
pub(super) fn order(axes: &[Axis], rows: &[Vec<f32>], names: &[&str]) -> Result<Vec<usize>, String> {
    let mut keys: Vec<(Vec<usize>, usize)> = rows
        .iter()
        .enumerate()
        .map(|(row, at)| {
            let key = axes.iter().zip(at).map(|(axis, &v)| axis.index(v)).collect();
            (key, row)
        })
        .collect();
    keys.sort_unstable();
    let tell = |key: &[usize]| -> String {
        let parts = names.iter().zip(axes).zip(key);
        let parts: Vec<String> = parts
            .map(|((name, axis), &i)| format!("{name} = {}", axis.values[i]))
            .collect();
        parts.join(", ")
    };
    if let Some(pair) = keys.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        return Err(format!(
            "rows {} and {} are both for {}",
            pair[0].1,
            pair[1].1,
            tell(&pair[0].0)
        ));
    }
    let counts: Vec<String> = axes.iter().map(|axis| axis.len().to_string()).collect();
    let missing = |key: &[usize]| {
        format!(
            "no row has {}, but the rows must hold all {} combinations of their values",
            tell(key),
            counts.join(" × ")
        )
    };
    // Sorted rows of a full grid count through it like an odometer.
    let mut expected = vec![0; axes.len()];
    for (key, _) in &keys {
        if *key != expected {
            return Err(missing(&expected));
        }
        advance(&mut expected, axes);
    }
    // Back at the start after the last combination.
    match expected.iter().all(|&digit| digit == 0) {
        true => Ok(keys.into_iter().map(|(_, row)| row).collect()),
        false => Err(missing(&expected)),
    }
}

/// The next combination, the last axis fastest; the first one after the last.
fn advance(combination: &mut [usize], axes: &[Axis]) {
    for (digit, axis) in combination.iter_mut().zip(axes).rev() {
        *digit += 1;
        if *digit < axis.len() {
            return;
        }
        *digit = 0;
    }
}
