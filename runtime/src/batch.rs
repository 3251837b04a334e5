//! Many queries of a reference model at once, averaged where it is stochastic.
//!
//! Every query draws numbers that are keyed by a seed and by the query itself, and sums are taken in a fixed order:
//! an answer depends neither on its neighbours, nor on its place, nor on the number of threads.

use crate::bsdf::{Bsdf, BsdfSample, Estimate, UNIT_TOL};
use crate::error::{Error, Result};
use crate::moments::Moments;
use crate::random::Rng;
use crate::real::{Real, Vec3};

/// Evaluations that one thread averages before it looks for other work.
const BLOCK: u64 = 4096;

/// Keys of the numbers behind evaluations and samples.
const EVAL_KEY: u64 = 0xe7a1;
const SAMPLE_KEY: u64 = 0x5a3b;

/// `f_cos` of every pair, RGB, sr⁻¹, with its standard error: the mean of `samples` evaluations.
///
/// At least two are taken of a stochastic model, so that there is an error; one of a deterministic model, whose errors
/// are zero.
///
/// # Errors
/// [`Error::BatchLength`] when the slices differ in length, [`Error::Query`] naming the first direction that is not a
/// finite unit vector.
pub fn eval(bsdf: &dyn Bsdf, wo: &[Vec3], wi: &[Vec3], samples: u64, seed: u64) -> Result<Vec<Estimate>> {
    check_pairs(wo, wi)?;
    Ok(map(wo.len(), |i| mean_eval(bsdf, wo[i], wi[i], samples, seed)))
}

/// [`Bsdf::pdf`] of every pair, sr⁻¹.
///
/// # Errors
/// As [`eval`].
pub fn pdf(bsdf: &dyn Bsdf, wo: &[Vec3], wi: &[Vec3]) -> Result<Vec<Real>> {
    check_pairs(wo, wi)?;
    Ok(map(wo.len(), |i| bsdf.pdf(wo[i], wi[i])))
}

/// One [`Bsdf::sample`] for every `wo` and its `u` in `[0,1)²`.
///
/// # Errors
/// As [`eval`], and [`Error::Query`] naming the first `u` that is outside its square.
pub fn sample(bsdf: &dyn Bsdf, wo: &[Vec3], u: &[[Real; 2]], seed: u64) -> Result<Vec<Option<BsdfSample>>> {
    check_length("u", wo.len(), u.len())?;
    check_directions("wo", wo)?;
    if let Some(i) = u.iter().position(|u| !u.iter().all(|v| (0.0..1.0).contains(v))) {
        return Err(Error::query(
            format!("u[{i}]"),
            format!("is {:?}, but must lie in [0, 1)²", u[i]),
        ));
    }
    Ok(map(wo.len(), |i| keyed_sample(bsdf, wo[i], u[i], seed)))
}

/// Mean and standard error of `samples` evaluations (see [`eval`]), without a look at the directions.
pub(crate) fn mean_eval(bsdf: &dyn Bsdf, wo: Vec3, wi: Vec3, samples: u64, seed: u64) -> Estimate {
    if !bsdf.is_stochastic() {
        return Estimate {
            mean: bsdf.eval(wo, wi, &mut Rng::new(&[])),
            se: Vec3::ZERO,
        };
    }
    let key = Rng::new(&[EVAL_KEY, seed, key(wo), key(wi)]).bits();
    let samples = samples.max(2);
    let blocks = map(samples.div_ceil(BLOCK) as usize, |block| {
        let first = block as u64 * BLOCK;
        let mut moments = Moments::default();
        let mut rng = Rng::new(&[key, first]);
        for _ in first..(first + BLOCK).min(samples) {
            moments.add(bsdf.eval(wo, wi, &mut rng));
        }
        moments
    });
    let moments = blocks.into_iter().fold(Moments::default(), Moments::merged);
    moments.estimate()
}

/// One sample whose numbers belong to (seed, wo, u), without a look at either.
pub(crate) fn keyed_sample(bsdf: &dyn Bsdf, wo: Vec3, u: [Real; 2], seed: u64) -> Option<BsdfSample> {
    let [a, b] = u.map(Real::to_bits);
    bsdf.sample(wo, u, &mut Rng::new(&[SAMPLE_KEY, seed, key(wo), a, b]))
}

/// A number that belongs to `w`.
fn key(w: Vec3) -> u64 {
    Rng::new(&w.to_array().map(Real::to_bits)).bits()
}

fn check_pairs(wo: &[Vec3], wi: &[Vec3]) -> Result<()> {
    check_length("wi", wo.len(), wi.len())?;
    check_directions("wo", wo)?;
    check_directions("wi", wi)
}

fn check_length(name: &'static str, expected: usize, found: usize) -> Result<()> {
    crate::backend::check_lengths(expected, &[(name, found)])
}

fn check_directions(name: &str, directions: &[Vec3]) -> Result<()> {
    // A NaN fails the comparison.
    let is_unit = |w: &Vec3| (w.length_squared() - 1.0).abs() <= UNIT_TOL;
    match directions.iter().position(|w| !is_unit(w)) {
        Some(i) => Err(Error::query(
            format!("{name}[{i}]"),
            format!("is {}, not a finite unit vector", directions[i]),
        )),
        None => Ok(()),
    }
}

/// `f` of 0..`count`, in order.
#[cfg(feature = "rayon")]
fn map<T: Send>(count: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    use rayon::prelude::*;
    match count {
        1 => vec![f(0)],
        _ => (0..count).into_par_iter().map(f).collect(),
    }
}

/// `f` of 0..`count`, in order.
#[cfg(not(feature = "rayon"))]
fn map<T>(count: usize, f: impl Fn(usize) -> T) -> Vec<T> {
    (0..count).map(f).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::direction;
    use crate::conductor::Conductor;

    /// Standard errors allowed: 24 comparisons exceed 4.5 by chance once in 6000 runs.
    const SIGMAS: Real = 4.5;
    /// Round-off of sums in another order.
    const ROUND_OFF: Real = 1e-12;
    /// Two standard errors from 12 000 skewed values each differ by less than this share of either.
    const SE_TOL: Real = 0.5;

    fn gold() -> Conductor {
        Conductor::new([0.3, 0.1], [1.0, 0.782, 0.344]).expect("valid parameters")
    }

    fn pairs() -> (Vec<Vec3>, Vec<Vec3>) {
        let angles = [(10.0, 0.0), (45.0, 30.0), (80.0, 200.0), (120.0, 0.0)];
        let wo = angles.map(|(theta, phi)| direction(theta, phi)).to_vec();
        let wi = angles
            .map(|(theta, phi)| direction(0.9 * theta, phi + 170.0))
            .to_vec();
        (wo, wi)
    }

    #[test]
    fn means_and_errors_are_those_of_plain_sums() {
        const SAMPLES: u64 = 3 * BLOCK + 17;
        let bsdf = gold();
        let (wo, wi) = pairs();
        let found = eval(&bsdf, &wo, &wi, SAMPLES, 7).expect("unit vectors");
        for i in 0..wo.len() {
            let mut rng = Rng::new(&[99, i as u64]);
            let (mut sum, mut square) = (Vec3::ZERO, Vec3::ZERO);
            for _ in 0..SAMPLES {
                let value = bsdf.eval(wo[i], wi[i], &mut rng);
                sum += value;
                square += value * value;
            }
            let n = SAMPLES as Real;
            let mean = sum / n;
            let se = ((square / n - mean * mean).max(Vec3::ZERO) / n)
                .to_array()
                .map(Real::sqrt);
            for c in 0..3 {
                let allowed = SIGMAS * se[c].hypot(found[i].se[c]) + ROUND_OFF * mean[c];
                assert!(
                    (found[i].mean[c] - mean[c]).abs() <= allowed,
                    "pair {i}: {:?}, {mean}",
                    found[i]
                );
                assert!(
                    (found[i].se[c] - se[c]).abs() <= SE_TOL * se[c],
                    "pair {i}: {:?}, {se:?}",
                    found[i]
                );
            }
        }
        assert_eq!(found[3], Estimate::default(), "below the horizon");
    }

    #[test]
    fn answers_do_not_depend_on_order_or_neighbours() {
        let bsdf = gold();
        let (wo, wi) = pairs();
        let whole = eval(&bsdf, &wo, &wi, 500, 7).expect("unit vectors");
        let reversed = |v: &[Vec3]| v.iter().rev().copied().collect::<Vec<_>>();
        let mut backwards = eval(&bsdf, &reversed(&wo), &reversed(&wi), 500, 7).expect("unit vectors");
        backwards.reverse();
        assert_eq!(whole, backwards);
        assert_eq!(
            eval(&bsdf, &wo[1..2], &wi[1..2], 500, 7).expect("unit vectors"),
            whole[1..2]
        );
        assert_ne!(eval(&bsdf, &wo, &wi, 500, 8).expect("unit vectors")[1], whole[1]);
        let u = [[0.1, 0.2], [0.3, 0.4], [0.5, 0.6], [0.7, 0.8]];
        let drawn = sample(&bsdf, &wo, &u, 7).expect("unit vectors");
        assert_eq!(
            sample(&bsdf, &wo[2..], &u[2..], 7).expect("unit vectors"),
            drawn[2..]
        );
        assert!(drawn[0].is_some() && drawn[3].is_none());
        assert_eq!(
            pdf(&bsdf, &wo, &wi).expect("unit vectors")[1],
            bsdf.pdf(wo[1], wi[1])
        );
    }

    #[test]
    fn bad_batches_are_refused() {
        let bsdf = gold();
        let (wo, wi) = pairs();
        let long = [wo[0], wo[0] * 1.1];
        let nan = [wo[0].with_x(Real::NAN)];
        for (error, part) in [
            (eval(&bsdf, &wo, &wi[1..], 2, 0).err(), "`wi` has 3"),
            (eval(&bsdf, &wo[..2], &long, 2, 0).err(), "`wi[1]`"),
            (pdf(&bsdf, &nan, &wi[..1]).err(), "`wo[0]`"),
            (
                sample(&bsdf, &wo[..1], &[[0.0, 1.0]], 0).map(drop).err(),
                "`u[0]`",
            ),
            (sample(&bsdf, &wo, &[], 0).map(drop).err(), "`u` has 0"),
        ] {
            let error = error.expect("it must be refused").to_string();
            assert!(error.contains(part), "`{part}` is not in: {error}");
        }
    }
}
