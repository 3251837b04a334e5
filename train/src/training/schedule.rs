//! How the learning rate changes over a run.

use std::f64::consts::PI;

/// Steps over which [`Schedule::WarmUpCosine`] rises from 0.
const WARM_UP_STEPS: f64 = 50.0;
/// Share of the rate that [`Schedule::WarmUpCosine`] keeps at its end.
const FINAL_SHARE: f64 = 1e-3;
/// Share of the steps that [`Schedule::FlatCosine`] stays at the full rate, as Ranger's author trains with it
/// (Wright 2019).
const FLAT_SHARE: f64 = 0.72;

/// A learning rate that depends on the step alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Schedule {
    /// Half a cosine from the peak down to zero (Loshchilov and Hutter 2017, one period): the paper's for Adam.
    Cosine,
    /// A linear rise over the first steps, then [`Schedule::Cosine`]'s course to nearly zero: the warp preset's.
    WarmUpCosine,
    /// The peak for most of the run, then half a cosine down to zero: what Ranger is used with.
    FlatCosine,
}

impl Schedule {
    /// Learning rate of step number `step`, from 0 on, of `steps`; within `[0, peak]`, and that of the end from
    /// `steps` on.
    pub fn rate(self, peak: f64, step: u64, steps: u64) -> f64 {
        let progress = (step as f64 / steps.max(1) as f64).min(1.0);
        let share = match self {
            Schedule::Cosine => half_cosine(progress),
            Schedule::WarmUpCosine => {
                let warm_up = ((step + 1) as f64 / WARM_UP_STEPS).min(1.0);
                warm_up * (FINAL_SHARE + (1.0 - FINAL_SHARE) * half_cosine(progress))
            }
            Schedule::FlatCosine => half_cosine(((progress - FLAT_SHARE) / (1.0 - FLAT_SHARE)).max(0.0)),
        };
        peak * share
    }
}

/// From 1 at 0 to 0 at 1.
fn half_cosine(progress: f64) -> f64 {
    0.5 * (1.0 + (PI * progress).cos())
}

#[cfg(test)]
mod tests {
    use super::*;
    use Schedule::{Cosine, FlatCosine, WarmUpCosine};

    const PEAK: f64 = 0.004;
    const STEPS: u64 = 1000;
    /// Round-off of a few operations on numbers up to 1.
    const SHARE_TOL: f64 = 1e-12;

    fn share(schedule: Schedule, step: u64) -> f64 {
        schedule.rate(PEAK, step, STEPS) / PEAK
    }

    #[test]
    fn each_goes_through_its_known_points() {
        let known = [
            (Cosine, 0, 1.0),
            (Cosine, 250, 0.5 + 0.125f64.sqrt()),
            (Cosine, 500, 0.5),
            (Cosine, 1000, 0.0),
            (WarmUpCosine, 500, 0.5005),
            (WarmUpCosine, 1000, 0.001),
            (FlatCosine, 0, 1.0),
            (FlatCosine, 720, 1.0),
            (FlatCosine, 860, 0.5),
            (FlatCosine, 1000, 0.0),
        ];
        for (schedule, step, expected) in known {
            let found = share(schedule, step);
            assert!(
                (found - expected).abs() < SHARE_TOL,
                "{schedule:?} {step}: {found}"
            );
        }
        // A fiftieth of the rate, next to the top of the cosine.
        assert!((share(WarmUpCosine, 0) - 0.02).abs() < SHARE_TOL);
        assert!((share(WarmUpCosine, 24) - 0.5).abs() < 1e-3);
    }

    #[test]
    fn rates_stay_between_zero_and_the_peak_and_fall_after_the_warm_up() {
        for schedule in [Cosine, WarmUpCosine, FlatCosine] {
            let shares: Vec<f64> = (0..STEPS + 10).map(|step| share(schedule, step)).collect();
            assert!(shares.iter().all(|s| (0.0..=1.0).contains(s)), "{schedule:?}");
            assert!(
                shares[50..].windows(2).all(|pair| pair[1] <= pair[0]),
                "{schedule:?}"
            );
            assert_eq!(shares[STEPS as usize], shares[STEPS as usize + 9]);
            assert!(schedule.rate(PEAK, 0, 0).is_finite());
        }
    }
}
