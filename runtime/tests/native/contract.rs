//! What the interface promises besides numbers: batching, bad queries, errors, tiers, repeatability.

use crate::random::{Answers, ODD, Queries, TYPICAL, Widths, backend, material, refs, run, slices};
use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::{Backend, Error};

/// Stated in the interface: `wi` has unit length within this.
const UNIT_TOL: f64 = 1e-6;

#[test]
fn a_query_does_not_depend_on_its_batch() {
    for widths in ODD.iter().chain([&TYPICAL]) {
        let material = material(3, widths);
        let queries = Queries::random(4, 1000);
        for tier in Tier::available() {
            let mut backend = backend(&material, tier);
            let whole = run(&mut backend, &queries);
            for size in [1, 7, 64] {
                for start in (0..queries.len()).step_by(size) {
                    let range = start..(start + size).min(queries.len());
                    let part = run(&mut backend, &queries.slice(range.clone()));
                    for ((name, found), (_, expected)) in part.columns().iter().zip(whole.columns()) {
                        assert_eq!(
                            bits(found),
                            bits(&expected[range.clone()]),
                            "{name}, {tier:?}, {range:?}"
                        );
                    }
                }
            }
            assert_eq!(run(&mut backend, &queries.slice(0..0)), Answers::default());
        }
    }
}

#[test]
fn repeated_calls_give_the_same_bytes_and_both_estimators_the_same_direction() {
    let (material, queries) = (material(5, &TYPICAL), Queries::random(6, 5000));
    for tier in Tier::available() {
        let mut first = backend(&material, tier);
        let once = run(&mut first, &queries);
        for again in [
            run(&mut first, &queries),
            run(&mut backend(&material, tier), &queries),
        ] {
            for ((name, found), (_, expected)) in again.columns().iter().zip(once.columns()) {
                assert_eq!(bits(found), bits(expected), "{name}, {tier:?}");
            }
        }
        assert_eq!(
            once.wi.each_ref().map(|c| bits(c)),
            once.wi_of_jacobian.each_ref().map(|c| bits(c)),
            "{tier:?}"
        );
    }
}

#[test]
fn directions_are_unit_and_above_the_horizon_and_everything_is_finite() {
    for widths in ODD.iter().chain([&TYPICAL]) {
        let mut material = material(7, widths);
        // The second time around with weights that saturate every clamp.
        for scale in [1.0, 1e4] {
            for network in [&mut material.sample, &mut material.eval, &mut material.pdf] {
                let layers = network.net.iter_mut().chain(&mut network.frame);
                layers.for_each(|layer| layer.weight.iter_mut().for_each(|w| *w *= scale));
            }
            for queries in [Queries::hard(), Queries::random(8, 2000)] {
                for tier in Tier::available() {
                    let answers = run(&mut backend(&material, tier), &queries);
                    for (name, column) in answers.columns() {
                        assert!(column.iter().all(|v| v.is_finite()), "{name}, {tier:?}");
                    }
                    for i in 0..queries.len() {
                        let wi: [f64; 3] = std::array::from_fn(|c| f64::from(answers.wi[c][i]));
                        let length = (wi[0] * wi[0] + wi[1] * wi[1] + wi[2] * wi[2]).sqrt();
                        assert!(
                            (length - 1.0).abs() < UNIT_TOL && wi[2] > 0.0,
                            "{wi:?}, {tier:?}, query {i}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn bad_queries_give_zeros_and_leave_their_neighbours_alone() {
    let good = Queries::random(9, 200);
    let material = material(10, &TYPICAL);
    let (nan, infinity) = (f32::NAN, f32::INFINITY);
    let bad = [
        [0.0, 0.6, -0.8],
        [1.0, 0.0, 0.0],
        [0.0, 0.0, -0.0],
        [nan, 0.0, 1.0],
        [0.0, nan, 1.0],
        [0.0, 0.0, nan],
        [infinity, 0.0, 1.0],
        [0.0, -infinity, 1.0],
        [0.0, 0.0, infinity],
    ];
    for tier in Tier::available() {
        let mut backend = backend(&material, tier);
        let expected = run(&mut backend, &good);
        let (mut bad_wo, mut bad_wi) = (good.clone(), good.clone());
        for (k, direction) in bad.iter().enumerate() {
            for (c, &component) in direction.iter().enumerate() {
                bad_wo.wo[c][20 * k + 3] = component;
                bad_wi.wi[c][20 * k + 3] = component;
            }
        }
        let (of_wo, of_wi) = (run(&mut backend, &bad_wo), run(&mut backend, &bad_wi));
        let is_bad = |i: usize| i % 20 == 3 && i / 20 < bad.len();
        for i in 0..good.len() {
            let columns = of_wo
                .columns()
                .into_iter()
                .zip(of_wi.columns())
                .zip(expected.columns());
            for (c, (((name, of_wo), (_, of_wi)), (_, expected))) in columns.enumerate() {
                let samples = name.starts_with("wi") || name == "weight" || name == "jacobian";
                let zero = if name.starts_with("wi") && c % 3 == 2 {
                    1.0
                } else {
                    0.0
                };
                let of_bad_wo = if is_bad(i) { zero } else { expected[i] };
                let of_bad_wi = if is_bad(i) && !samples { 0.0 } else { expected[i] };
                assert_eq!(of_wo[i], of_bad_wo, "{name} of query {i}, bad wo, {tier:?}");
                assert_eq!(of_wi[i], of_bad_wi, "{name} of query {i}, bad wi, {tier:?}");
            }
        }
    }
}

#[test]
fn u_that_is_no_number_and_directions_that_are_not_unit_stay_finite() {
    let material = material(11, &TYPICAL);
    let mut queries = Queries::random(12, 120);
    for (i, scale) in [1e-30f32, 1e-10, 1e10, 1e30]
        .into_iter()
        .cycle()
        .take(queries.len())
        .enumerate()
    {
        (0..3).for_each(|c| queries.wo[c][i] *= scale);
        (0..3).for_each(|c| queries.wi[c][i] *= if i % 3 == 0 { scale } else { 1.0 });
        queries.u[i % 2][i] = [f32::NAN, -1.0, 2.0, f32::INFINITY][i / 4 % 4];
    }
    for tier in Tier::available() {
        for (name, column) in run(&mut backend(&material, tier), &queries).columns() {
            assert!(
                column.iter().all(|v| v.is_finite()),
                "{name}, {tier:?}: {column:?}"
            );
        }
    }
}

#[test]
fn slices_of_different_length_are_an_error_that_names_the_argument() {
    let queries = Queries::random(13, 8);
    let mut backend = backend(&material(14, &TYPICAL), Tier::best());
    let short = Queries::random(13, 7);
    let (wo, wi, u) = (refs(&queries.wo), refs(&queries.wi), refs(&queries.u));
    let mut answers = Answers::new(8);
    let check = |result: bake_runtime::Result<()>, argument: &str| match result {
        Err(Error::BatchLength {
            name,
            expected: 8,
            found: 7,
        }) => assert_eq!(name, argument),
        other => panic!("{argument}: {other:?}"),
    };
    let Answers {
        wi: out,
        weight,
        jacobian,
        f_cos,
        pdf,
        ..
    } = &mut answers;
    check(
        backend.sample_learned(wo, refs(&short.u), slices(out), slices(weight)),
        "u",
    );
    check(
        backend.sample_learned([wo[0], wo[1], &short.wo[2]], u, slices(out), slices(weight)),
        "wo",
    );
    check(
        backend.sample_jacobian(wo, u, slices(out), &mut jacobian[..7]),
        "jacobian",
    );
    check(backend.eval(wo, refs(&short.wi), slices(f_cos)), "wi");
    check(backend.pdf(wo, wi, &mut pdf[..7]), "pdf");
    f_cos[1].pop();
    weight[2].pop();
    out[0].pop();
    check(backend.eval(wo, wi, slices(f_cos)), "f_cos");
    check(backend.sample_jacobian(wo, u, slices(out), jacobian), "wi");
    out[0].push(0.0);
    check(
        backend.sample_learned(wo, u, slices(out), slices(weight)),
        "weight",
    );
}

#[test]
fn a_material_that_contradicts_itself_is_refused() {
    let sound = material(15, &TYPICAL);
    let refused = |change: &dyn Fn(&mut bake_runtime::BakedMaterial)| {
        let mut material = sound.clone();
        change(&mut material);
        assert!(matches!(
            NativeBackend::new(&material, Tier::Scalar),
            Err(Error::Network { .. })
        ));
    };
    refused(&|m| std::mem::swap(&mut m.eval, &mut m.pdf));
    refused(&|m| m.sample.net[1].weight.truncate(5));
    refused(&|m| m.pdf.spec.hidden.push(3));
    refused(&|m| m.eval.frame.truncate(1));
    refused(&|m| m.sample.spec.inputs[0].quantity = bake_runtime::encoding::Quantity::Local);
    let empty = Widths {
        sample: &[0],
        ..TYPICAL
    };
    assert!(matches!(
        NativeBackend::new(&material(16, &empty), Tier::Scalar),
        Err(Error::Network { .. })
    ));
}

#[test]
fn the_best_tier_is_the_processors_best() {
    assert_eq!(Tier::available()[0], Tier::Scalar);
    assert_eq!(Tier::available().last(), Some(&Tier::best()));
    #[cfg(target_arch = "x86_64")]
    {
        let avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
        let expected = match is_x86_feature_detected!("avx512f") {
            true => Tier::Avx512,
            false if avx2 => Tier::Avx2,
            false => Tier::Scalar,
        };
        assert_eq!(Tier::best(), expected);
        assert_eq!(Tier::available().contains(&Tier::Avx2), avx2);
    }
    let material = material(17, &TYPICAL);
    for tier in [Tier::Scalar, Tier::Avx2, Tier::Avx512] {
        match NativeBackend::new(&material, tier) {
            Ok(_) => assert!(Tier::available().contains(&tier)),
            Err(Error::Tier(name)) => assert!(name == tier.name() && !Tier::available().contains(&tier)),
            Err(other) => panic!("{other}"),
        }
    }
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}
