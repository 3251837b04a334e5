//! The tests that every [`Backend`] must pass (feature `conformance`, for test programs).
//!
//! [`conformance!`](crate::conformance!) makes a module of them for one backend:
//!
//! ```
//! use bake_runtime::conformance::Tolerance;
//! use bake_runtime::native::{NativeBackend, Tier};
//!
//! bake_runtime::conformance! {
//!     best_tier,
//!     |material| NativeBackend::new(material, Tier::best()).expect("the best tier is available"),
//!     tolerance: Tolerance::EXACT,
//! }
//! # fn main() {}
//! ```
//!
//! They ask about materials of the shapes that bakes have, and about random specifications ([`materials`]). What the oracle
//! answers, and how much rounding may change of it, is measured once per process ([`cases`], [`rounding`]) and shared by all
//! backends of a test program.

pub mod answers;
pub mod cases;
pub mod checks;
pub mod materials;
pub mod queries;
pub mod rounding;

use crate::{Backend, BakedMaterial};

/// Makes a backend for a material, and panics where it cannot.
pub type Make<'a> = &'a dyn Fn(&BakedMaterial) -> Box<dyn Backend>;

/// One test of a backend: panics, saying what is wrong, when the backend does not keep what it is about.
pub type Check = fn(Make, Tolerance);

/// What a backend may be off by, in tolerances: the unit is what rounding was measured to change the same answer by, some
/// tens of roundings where nothing is ill-conditioned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Distance from the oracle.
    pub rounding: f64,
    /// Distance between answers to one query that was asked in different ways: in another batch, or by the other way to
    /// sample. 0 where they must be the same bytes, as they are when every query is added up in the same order.
    pub reordering: f64,
    /// Distance of the length of `wi` from 1. Not in the unit of the others.
    pub length: f64,
}

impl Tolerance {
    /// `wi` has unit length within this: some roundings of f32, also where a renderer adds more of its own.
    pub const LENGTH: f64 = 1e-6;

    /// Of backends in f32 that add up every query in the same order, wherever it stands.
    pub const EXACT: Tolerance = Tolerance {
        rounding: 1.0,
        reordering: 0.0,
        length: Tolerance::LENGTH,
    };
}

/// What `make` makes for `material`, as a trait object: says to the compiler what a closure without types takes.
pub fn boxed<B: Backend + 'static>(
    material: &BakedMaterial,
    make: impl FnOnce(&BakedMaterial) -> B,
) -> Box<dyn Backend> {
    Box::new(make(material))
}

/// Makes a module of tests that a backend conforms to what [`Backend`] promises.
///
/// `conformance! { name, make, tolerance: tolerance, available: condition }`: the module's name; a closure from a
/// `&BakedMaterial` to the backend, which panics where it cannot make one; what it may be off by, a
/// [`Tolerance`](crate::conformance::Tolerance); and, if not every machine has the backend, whether this one has. Where it
/// has not, the tests pass and say so.
#[macro_export]
macro_rules! conformance {
    ($name:ident, $make:expr, tolerance: $tolerance:expr $(, available: $available:expr)? $(,)?) => {
        $crate::conformance! {
            @tests $name, $make, $tolerance, [$($available)?],
            agrees_with_the_oracle
            directions_are_unit_and_everything_is_finite
            saturated_networks_stay_finite
            batches_of_any_size_give_the_same_answers
            one_value_of_a_parameter_is_that_of_the_whole_batch
            repeated_calls_give_the_same_bytes
            threads_that_share_a_backend_get_the_same_bytes
            both_ways_to_sample_draw_the_same_direction
            invalid_queries_give_zeros_and_leave_their_neighbours_alone
            odd_numbers_give_finite_answers
            slices_of_wrong_length_are_named_and_nothing_is_written
        }
    };
    (@tests $name:ident, $make:expr, $tolerance:expr, [$($available:expr)?], $($check:ident)*) => {
        mod $name {
            use super::*;

            fn hold(check: $crate::conformance::Check) {
                $(if !$available {
                    eprintln!("{} is not available on this machine", stringify!($name));
                    return;
                })?
                check(&|material| $crate::conformance::boxed(material, $make), $tolerance);
            }

            $(#[test]
            fn $check() {
                hold($crate::conformance::checks::$check);
            })*
        }
    };
}
