//! The tests themselves: each makes backends and panics, saying what is wrong, when one does not keep its promise.

mod numbers;
mod refusals;
mod ways;

pub use numbers::{
    agrees_with_the_oracle, assert_expected, directions_are_unit_and_everything_is_finite,
    saturated_networks_stay_finite,
};
pub use refusals::{
    invalid_queries_give_zeros_and_leave_their_neighbours_alone, odd_numbers_give_finite_answers,
    slices_of_wrong_length_are_named_and_nothing_is_written,
};
pub use ways::{
    batches_of_any_size_give_the_same_answers, both_ways_to_sample_draw_the_same_direction,
    one_value_of_a_parameter_is_that_of_the_whole_batch, repeated_calls_give_the_same_bytes,
    threads_that_share_a_backend_get_the_same_bytes,
};
