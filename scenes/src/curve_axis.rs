//! Axes of plots: what range they show, and where their ticks stand.

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use std::ops::Range;

/// Most ticks with a number on an axis.
const TICKS_MAX: usize = 7;
/// Fewest ticks with a number on a logarithmic axis; where round numbers give fewer, ticks are even.
const TICKS_MIN: usize = 3;
/// Decades up to which a logarithmic axis has light lines at 2, 3, … 9.
const LIGHT_DECADES_MAX: f64 = 6.0;
/// Room above and below the values, as a share of their span.
const ROOM: f64 = 0.06;
/// Least span of an axis: decades, or on a linear axis a share of the largest value, and 1 where all are 0.
const SPAN_MIN: f64 = 0.02;

/// An axis of a plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Whether it is the logarithm that is even.
    logarithmic: bool,
    /// First and last value that are shown, or their decimal logarithms.
    ends: [f64; 2],
    /// Values that have a number.
    ticks: Vec<f64>,
    /// Values of light lines between them.
    light: Vec<f64>,
}

impl Axis {
    /// An axis that shows all `values`, which are finite: logarithmic where all are positive. None is as if it were 1.
    pub fn around(values: impl Iterator<Item = f64> + Clone) -> Axis {
        let logarithmic = values.clone().all(|v| v > 0.0);
        let places = values.map(|v| if logarithmic { v.log10() } else { v });
        let ends = places.fold(None, |ends: Option<[f64; 2]>, v| {
            Some(ends.map_or([v; 2], |[low, high]| [low.min(v), high.max(v)]))
        });
        let [low, high] = ends.unwrap_or([0.0; 2]);
        let largest = low.abs().max(high.abs());
        let least = match logarithmic {
            true => SPAN_MIN,
            false if largest < f64::MIN_POSITIVE => 1.0,
            false => SPAN_MIN * largest,
        };
        let room = (ROOM * (high - low)).max(least / 2.0);
        let ends = [low - room, high + room];
        let (ticks, light) = match logarithmic {
            true => log_ticks(ends),
            false => (even_ticks(ends), Vec::new()),
        };
        Axis {
            logarithmic,
            ends,
            ticks,
            light,
        }
    }

    /// An even axis from 0 to `end` > 0 with numbers at `ticks`.
    pub fn even(end: f64, ticks: Vec<f64>) -> Axis {
        Axis {
            logarithmic: false,
            ends: [0.0, end],
            ticks,
            light: Vec::new(),
        }
    }

    /// Where `value` stands: 0 at the start, 1 at the end.
    fn place(&self, value: f64) -> f64 {
        let [low, high] = self.ends;
        let place = if self.logarithmic { value.log10() } else { value };
        (place - low) / (high - low)
    }
}

impl Ranged for Axis {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (start, end): (i32, i32)) -> i32 {
        start + (self.place(*value) * f64::from(end - start)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        match hint.weight().allow_light_points() {
            true => self.light.clone(),
            false => self.ticks.clone(),
        }
    }

    fn range(&self) -> Range<f64> {
        let [low, high] = self
            .ends
            .map(|end| if self.logarithmic { 10f64.powf(end) } else { end });
        low..high
    }
}

/// Multiples in `range` of 1, 2 or 5 times a power of ten, few of them.
pub fn even_ticks([low, high]: [f64; 2]) -> Vec<f64> {
    let wish = (high - low) / TICKS_MAX as f64;
    if !(wish.is_normal() && wish > 0.0) {
        return Vec::new();
    }
    let decade = 10f64.powf(wish.log10().floor());
    let [rounds @ .., coarsest] = [1.0, 2.0, 5.0, 10.0].map(|m| m * decade);
    let step = rounds.into_iter().find(|s| *s >= wish).unwrap_or(coarsest);
    let first = (low / step).ceil();
    (0..=TICKS_MAX)
        .map(|i| (first + i as f64) * step)
        .take_while(|tick| *tick <= high)
        .collect()
}

/// Values of ticks and of light lines on a logarithmic axis over the decades `low` to `high`.
fn log_ticks([low, high]: [f64; 2]) -> (Vec<f64>, Vec<f64>) {
    let within = |mantissas: &[i32], stride: i32| -> Vec<f64> {
        let exponents = low.floor() as i32..=high.floor() as i32;
        exponents
            .filter(|e| e.rem_euclid(stride) == 0)
            .flat_map(|e| mantissas.iter().map(move |m| f64::from(*m) * 10f64.powi(e)))
            .filter(|tick| (low..=high).contains(&tick.log10()))
            .collect()
    };
    let light = match high - low <= LIGHT_DECADES_MAX {
        true => within(&[2, 3, 4, 5, 6, 7, 8, 9], 1),
        false => Vec::new(),
    };
    let fine = within(&[1, 2, 5], 1);
    let ticks = match fine.len() {
        TICKS_MIN..=TICKS_MAX => fine,
        0..TICKS_MIN => even_ticks([low, high].map(|end| 10f64.powf(end))),
        _ => within(&[1], ((high - low) / TICKS_MAX as f64).ceil() as i32),
    };
    (ticks, light)
}

/// `value` in at most six digits, with an exponent where it is far from 1.
pub fn number(value: f64) -> String {
    // What a sum of steps left behind the sixth digit goes.
    let rounded: f64 = format!("{value:.5e}").parse().unwrap_or(value);
    match rounded == 0.0 || (1e-3..1e6).contains(&rounded.abs()) {
        true => rounded.to_string(),
        false => format!("{rounded:e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(values: &[f64]) -> Vec<String> {
        let axis = Axis::around(values.iter().copied());
        axis.ticks.iter().map(|tick| number(*tick)).collect()
    }

    #[test]
    fn ticks_are_round_numbers() {
        assert_eq!(numbers(&[0.0098, 0.21]), ["0.01", "0.02", "0.05", "0.1", "0.2"]);
        assert_eq!(
            numbers(&[1e-5, 1.0]),
            ["1e-5", "1e-4", "0.001", "0.01", "0.1", "1"]
        );
        assert_eq!(
            numbers(&[1e-20, 1.0]),
            ["1e-20", "1e-16", "1e-12", "1e-8", "1e-4", "1"]
        );
        assert_eq!(numbers(&[0.105, 0.145]), ["0.11", "0.12", "0.13", "0.14"]);
        assert_eq!(numbers(&[0.0, 3.1]), ["0", "0.5", "1", "1.5", "2", "2.5", "3"]);
        assert_eq!(numbers(&[-2.0, 20.0]), ["0", "5", "10", "15", "20"]);
        assert_eq!(even_ticks([0.0, 6000.0]), [0.0, 1e3, 2e3, 3e3, 4e3, 5e3, 6e3]);
    }

    #[test]
    fn every_value_lies_inside_and_ticks_are_few() {
        let huge = f64::from(f32::MAX);
        let ends = [-huge, -1.0, 0.0, 5e-324, 1e-30, 1.0, 1.0 + 1e-15, huge];
        for low in ends {
            for high in ends.into_iter().filter(|high| *high >= low) {
                let axis = Axis::around([low, high].into_iter());
                assert_eq!(axis.logarithmic, low > 0.0);
                for value in [low, high] {
                    let place = axis.place(value);
                    assert!(0.0 < place && place < 1.0, "{low}, {high}: {axis:?}");
                }
                assert!(axis.ticks.len() <= TICKS_MAX + 1, "{low}, {high}: {axis:?}");
                for tick in axis.ticks.iter().chain(&axis.light) {
                    let place = axis.place(*tick);
                    assert!((0.0..=1.0).contains(&place), "{low}, {high}: {axis:?}");
                }
            }
        }
        assert_eq!(Axis::around([].into_iter()), Axis::around([1.0].into_iter()));
    }
}
