//! The buffers that queries run in: one set per thread and tier, shared by all materials, so that no call allocates and
//! what one material leaves in the cache serves the next.

use super::columns::TANGENT_COLUMNS;
use super::place::Place;
use super::stack::Buffers;
use super::vector::Vector;
use std::any::Any;
use std::cell::RefCell;

/// Buffers for batches in tiles of `N` vectors.
pub struct Scratch<V, const N: usize> {
    whole: (Buffers<V, N>, Place<V, N>),
    rest: (Buffers<V, 1>, Place<V, 1>),
    slopes: SlopeBuffers<V>,
}

/// Buffers for values with tangents.
pub struct SlopeBuffers<V> {
    /// Features of u.
    pub entry: Buffers<V, TANGENT_COLUMNS>,
    /// What layers make of them.
    pub layers: Buffers<V, TANGENT_COLUMNS>,
}

/// What a tile of `N` vectors runs in.
pub struct Work<'a, V, const N: usize> {
    /// Inputs, and what layers make of them.
    pub values: &'a mut Buffers<V, N>,
    /// The same with tangents, one vector at a time.
    pub slopes: &'a mut SlopeBuffers<V>,
    /// What the networks share before u or wi enters.
    pub place: &'a mut Place<V, N>,
}

impl<V, const N: usize> Work<'_, V, N> {
    /// The same, for a part of the work.
    #[inline(always)]
    pub fn again(&mut self) -> Work<'_, V, N> {
        Work {
            values: self.values,
            slopes: self.slopes,
            place: self.place,
        }
    }
}

impl<V: Vector, const N: usize> Scratch<V, N> {
    /// For whole tiles.
    #[inline(always)]
    pub fn whole(&mut self) -> Work<'_, V, N> {
        Work {
            values: &mut self.whole.0,
            slopes: &mut self.slopes,
            place: &mut self.whole.1,
        }
    }

    /// For single vectors.
    #[inline(always)]
    pub fn rest(&mut self) -> Work<'_, V, 1> {
        Work {
            values: &mut self.rest.0,
            slopes: &mut self.slopes,
            place: &mut self.rest.1,
        }
    }

    fn fit(&mut self, width: usize, zero: V) {
        self.whole.0.fit(width, zero);
        self.rest.0.fit(width, zero);
        self.slopes.entry.fit(width, zero);
        self.slopes.layers.fit(width, zero);
    }
}

thread_local! {
    /// One for each tier that ran on this thread.
    static SCRATCH: RefCell<Vec<Box<dyn Any>>> = const { RefCell::new(Vec::new()) };
}

/// Runs `run` with this thread's buffers, made large enough for layers of `width` rows; `zero` fills what is new. `run` must
/// not come back here.
pub fn with<V: Vector, const N: usize>(width: usize, zero: V, run: impl FnOnce(&mut Scratch<V, N>)) {
    SCRATCH.with_borrow_mut(|all| {
        let known = all.iter().position(|any| any.is::<Scratch<V, N>>());
        let index = known.unwrap_or_else(|| {
            all.push(Box::new(Scratch::<V, N> {
                whole: (Buffers::EMPTY, Place::none(zero)),
                rest: (Buffers::EMPTY, Place::none(zero)),
                slopes: SlopeBuffers {
                    entry: Buffers::EMPTY,
                    layers: Buffers::EMPTY,
                },
            }));
            all.len() - 1
        });
        let scratch: &mut Scratch<V, N> = all[index].downcast_mut().expect("found by its type");
        scratch.fit(width, zero);
        run(scratch);
    });
}
