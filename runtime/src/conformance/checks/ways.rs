//! However a query is asked, the answer is the same: in any batch, with parameters once or for each query, again, on any
//! thread, by either way to sample.

use crate::conformance::answers::{Answers, ask, assert_same, assert_same_bytes};
use crate::conformance::cases::Case;
use crate::conformance::{Make, Tolerance};

/// Sizes of a batch: none, one, and those around the lanes of vectors and the tiles that are made of them.
const SIZES: [usize; 9] = [0, 1, 3, 7, 16, 17, 40, 64, 1000];
/// The largest of these, which every other is held against.
const WHOLE: usize = 1000;
/// Queries that are asked in batches of all sizes: enough that parts begin and end everywhere in a tile.
const PARTED: usize = 200;
/// Queries of checks that ask the same ones again.
const AGAIN: usize = 300;
/// Queries that are asked alone with all parameters once, in a batch of copies of them, and copies.
const SHARING: usize = 20;
const SHARED: usize = 17;
/// Threads that ask at once, and how often each does.
const THREADS: [usize; 2] = [4, 3];

/// A query's answer does not depend on its batch: same bytes, or within [`Tolerance::reordering`].
///
/// # Panics
/// With the first that differs.
pub fn batches_of_any_size_give_the_same_answers(make: Make, tolerance: Tolerance) {
    for case in Case::some() {
        let backend = make(&case.material);
        let number = |i: usize| i % case.queries.len();
        let whole = ask(&*backend, &case.queries.select((0..WHOLE).map(number)));
        for size in SIZES {
            let parted = if size == WHOLE { WHOLE } else { PARTED };
            // An empty batch is asked once.
            for start in (0..parted)
                .step_by(size.max(1))
                .take(if size == 0 { 1 } else { parted })
            {
                let range = start..(start + size).min(parted);
                let numbers = range.clone().map(number);
                let part = ask(&*backend, &case.queries.select(numbers.clone()));
                let what = format!("{:?}, {range:?} of a batch of {size} and of {WHOLE}", case.kind);
                assert_same(
                    case,
                    numbers,
                    [&part, &gather(&whole, range)],
                    tolerance.reordering,
                    &what,
                );
            }
        }
    }
}

/// The answers to the queries with these numbers.
fn gather(answers: &Answers, numbers: impl Iterator<Item = usize> + Clone) -> Answers {
    let pick = |column: &Vec<f32>| -> Vec<f32> { numbers.clone().map(|i| column[i]).collect() };
    Answers {
        wi: answers.wi.each_ref().map(pick),
        weight: answers.weight.each_ref().map(pick),
        wi_of_jacobian: answers.wi_of_jacobian.each_ref().map(pick),
        jacobian: pick(&answers.jacobian),
        f_cos: answers.f_cos.each_ref().map(pick),
        pdf: pick(&answers.pdf),
    }
}

/// A parameter of which there is one value for the batch gives what a column of that value gives, within
/// [`Tolerance::rounding`]: a backend may fold it into a bias.
///
/// # Panics
/// With the first answer that differs.
pub fn one_value_of_a_parameter_is_that_of_the_whole_batch(make: Make, tolerance: Tolerance) {
    for case in Case::some().filter(|case| !case.queries.params.is_empty()) {
        let backend = make(&case.material);
        let count = AGAIN.min(case.queries.len());
        // What all of these queries share stands there once.
        let queries = case.queries.select(0..count);
        let answers = ask(&*backend, &queries);
        let mut each = queries.clone();
        for column in &mut each.params {
            column.resize(count, column[0]);
        }
        let of_each = ask(&*backend, &each);
        let what = format!("{:?}, parameters once or for each query", case.kind);
        assert_same(case, 0..count, [&of_each, &answers], tolerance.rounding, &what);
        for i in 0..SHARING {
            let copies = std::iter::repeat_n(i, SHARED);
            let mut once = each.select(copies.clone());
            once.params.iter_mut().for_each(|column| column.truncate(1));
            let found = ask(&*backend, &once);
            let expected = gather(&answers, copies.clone());
            let what = format!("{:?}, all parameters once", case.kind);
            assert_same(case, copies, [&found, &expected], tolerance.rounding, &what);
        }
    }
}

/// Asking again gives the same bytes, also of another backend for the same material.
///
/// # Panics
/// With the first that differs.
pub fn repeated_calls_give_the_same_bytes(make: Make, _: Tolerance) {
    for case in Case::some() {
        let backend = make(&case.material);
        let queries = case.queries.select(0..AGAIN.min(case.queries.len()));
        let once = ask(&*backend, &queries);
        for again in [&*backend, &*make(&case.material)] {
            let what = format!("{:?}, again", case.kind);
            assert_same_bytes(&ask(again, &queries), &once, &what);
        }
    }
}

/// Threads that ask one backend at once get the bytes that one gets alone.
///
/// # Panics
/// With the first that differs.
pub fn threads_that_share_a_backend_get_the_same_bytes(make: Make, _: Tolerance) {
    let [threads, times] = THREADS;
    for case in Case::some() {
        let backend = &*make(&case.material);
        let count = AGAIN.min(case.queries.len());
        // Each thread asks about others, so that what belongs to one and leaks into another shows.
        let of_thread = |t: usize| case.queries.select((0..count).map(move |i| (i + 17 * t) % count));
        let alone: Vec<Answers> = (0..threads).map(|t| ask(backend, &of_thread(t))).collect();
        std::thread::scope(|scope| {
            for (t, alone) in alone.iter().enumerate() {
                let queries = of_thread(t);
                scope.spawn(move || {
                    for _ in 0..times {
                        let what = format!("{:?}, on one of {threads} threads", case.kind);
                        assert_same_bytes(&ask(backend, &queries), alone, &what);
                    }
                });
            }
        });
    }
}

/// `sample_learned` and `sample_jacobian` draw the same `wi`: same bytes, or within [`Tolerance::reordering`].
///
/// # Panics
/// With the first that differs.
pub fn both_ways_to_sample_draw_the_same_direction(make: Make, tolerance: Tolerance) {
    for case in Case::some() {
        let answers = ask(&*make(&case.material), &case.queries);
        let other = Answers {
            wi: answers.wi_of_jacobian.clone(),
            ..answers.clone()
        };
        let what = format!("{:?}, both ways to sample", case.kind);
        assert_same(
            case,
            0..case.queries.len(),
            [&answers, &other],
            tolerance.reordering,
            &what,
        );
    }
}
