//! A batch as tiles: whole ones first, then what is left over by single vectors.

use super::scratch::{Scratch, Work};
use super::tile::queries;
use super::vector::{Simd, Task, Vector};

/// A job that goes over a batch tile by tile.
pub trait Tiles<V: Vector> {
    /// Number of queries.
    fn count(&self) -> usize;

    /// Does the tile of `N` vectors that begins at query `start`, of which the first `live` count.
    fn tile<const N: usize>(&mut self, start: usize, live: usize, work: Work<V, N>);
}

/// Runs `job` with the instructions of `simd`, in tiles of `N` vectors.
pub fn run<S: Simd, const N: usize>(
    simd: S,
    scratch: &mut Scratch<S::Vector, N>,
    job: &mut impl Tiles<S::Vector>,
) {
    simd.enter(Batch { scratch, job });
}

/// [`run`] on its way into the function compiled for its tier.
struct Batch<'a, V, T, const N: usize> {
    scratch: &'a mut Scratch<V, N>,
    job: &'a mut T,
}

impl<V: Vector, T: Tiles<V>, const N: usize> Task for Batch<'_, V, T, N> {
    #[inline(always)]
    fn run(self) {
        let Batch { scratch, job } = self;
        let (count, tile) = (job.count(), queries::<V, N>());
        // A tile whose last vector would be empty costs more than its other vectors alone.
        let left = count % tile;
        let whole = if left > tile - V::LANES {
            count
        } else {
            count - left
        };
        for start in (0..whole).step_by(tile) {
            job.tile::<N>(start, tile.min(count - start), scratch.whole());
        }
        for start in (whole..count).step_by(V::LANES) {
            job.tile::<1>(start, V::LANES.min(count - start), scratch.rest());
        }
    }
}
