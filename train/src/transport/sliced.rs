//! Sliced optimal transport: moves points onto others by sorting both along many directions.
//!
//! Sources: Bonneel, Rabin, Peyré and Pfister 2015, *Sliced and Radon Wasserstein Barycenters of Measures*; Paulin et al.
//! 2020, *Sliced Optimal Transport Sampling*, for batches of directions with averaged steps. Deviation: directions are of
//! low discrepancy, turned by a random angle.

use bake_runtime::Rng;
use rayon::prelude::*;
use std::f64::consts::PI;

use crate::error::Result;

/// Batches of directions, one step each.
pub const STEPS: usize = 64;
/// Directions of a batch, over half a turn.
const BATCH: usize = 8;
/// Key of the random angles.
const KEY: u64 = 0x51;

/// Moves `points` towards `target`, as many points, along the gradient of their sliced distance.
///
/// Deterministic for a `seed`; `step` is called before each of [`STEPS`] steps.
///
/// # Errors
/// That of `step`.
pub fn advect(
    points: &mut [[f64; 2]],
    target: &[[f64; 2]],
    seed: u64,
    mut step: impl FnMut() -> Result<()>,
) -> Result<()> {
    for batch in 0..STEPS {
        step()?;
        let turn = Rng::new(&[KEY, seed, batch as u64]).uniform();
        let moves: Vec<Vec<[f64; 2]>> = (0..BATCH)
            .into_par_iter()
            .map(|k| {
                let (sin, cos) = (PI * (k as f64 + turn) / BATCH as f64).sin_cos();
                slide(points, target, [cos, sin])
            })
            .collect();
        // Over all directions θ, the mean of (δ·θ) θ is δ/2 in the plane.
        let scale = 2.0 / BATCH as f64;
        points.par_iter_mut().enumerate().for_each(|(i, p)| {
            for m in &moves {
                *p = [p[0] + scale * m[i][0], p[1] + scale * m[i][1]];
            }
        });
    }
    Ok(())
}

/// Step of every point along `direction` to the target of the same rank.
fn slide(points: &[[f64; 2]], target: &[[f64; 2]], direction: [f64; 2]) -> Vec<[f64; 2]> {
    let project = |points: &[[f64; 2]]| {
        let mut list: Vec<(f64, usize)> = points
            .iter()
            .enumerate()
            .map(|(i, p)| (p[0] * direction[0] + p[1] * direction[1], i))
            .collect();
        list.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        list
    };
    let mut moves = vec![[0.0; 2]; points.len()];
    for ((from, i), (to, _)) in project(points).into_iter().zip(project(target)) {
        moves[i] = direction.map(|d| d * (to - from));
    }
    moves
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;

    /// What is left after all steps where a map between the sets is smooth.
    const DISTANCE: f64 = 1e-3;

    fn random(key: u64, n: usize) -> Vec<[f64; 2]> {
        let mut rng = Rng::new(&[key]);
        (0..n).map(|_| [rng.uniform(), rng.uniform()]).collect()
    }

    #[test]
    fn a_slide_sorts_along_its_direction() {
        let moves = slide(&[[0.0, 5.0], [1.0, 6.0]], &[[3.0, 0.0], [2.0, 1.0]], [1.0, 0.0]);
        assert_eq!(moves, [[2.0, 0.0], [2.0, 0.0]]);
    }

    #[test]
    fn points_that_are_there_stay() {
        let target = random(71, 500);
        let mut points = target.clone();
        points.reverse();
        let before = points.clone();
        advect(&mut points, &target, 1, || Ok(())).expect("nothing breaks");
        assert_eq!(points, before);
    }

    #[test]
    fn a_translated_and_stretched_set_is_reached() {
        let target = random(72, 500);
        let mut points: Vec<[f64; 2]> = target
            .iter()
            .map(|[x, y]| [1.2 * x - 0.3, 0.9 * y + 0.5])
            .collect();
        advect(&mut points, &target, 1, || Ok(())).expect("nothing breaks");
        let mean = points
            .iter()
            .zip(&target)
            .map(|(p, t)| (p[0] - t[0]).hypot(p[1] - t[1]))
            .sum::<f64>()
            / 500.0;
        assert!(mean < DISTANCE, "{mean}");
    }

    #[test]
    fn a_break_is_passed_on() {
        let mut points = random(73, 10);
        let stopped = advect(&mut points, &random(74, 10), 1, || Err(Error::Interrupted));
        assert!(matches!(stopped, Err(Error::Interrupted)));
    }
}
