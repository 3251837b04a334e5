//! What the interface promises besides numbers: batching, bad queries, errors, tiers, repeatability.

use crate::materials::Kind;
use crate::queries::{Answers, Queries, backend, refs, run, slices};
use bake_runtime::encoding::Quantity;
use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::{Backend, BakedMaterial, Error, Points};

/// Some roundings of a direction.
const BOUND_TOL: f32 = 1e-5;
/// Stated in the interface: `wi` has unit length within this.
const UNIT_TOL: f64 = 1e-6;

/// Named kinds and some random specifications, with a seed for each.
fn materials() -> impl Iterator<Item = (u64, Kind, BakedMaterial)> {
    let kinds = Kind::NAMED.into_iter().chain((0..12).map(Kind::Any));
    (0..)
        .zip(kinds)
        .map(|(seed, kind)| (seed, kind, kind.build(seed)))
}

#[test]
fn a_query_does_not_depend_on_its_batch() {
    for (seed, kind, material) in materials() {
        let queries = Queries::random(4, 200).with_params(&material, seed);
        for tier in Tier::available() {
            let backend = backend(&material, tier);
            let whole = run(&backend, &queries);
            for size in [1, 3, 5, 7, 40, 64] {
                for start in (0..queries.len()).step_by(size) {
                    let range = start..(start + size).min(queries.len());
                    let part = run(&backend, &queries.slice(range.clone()));
                    for ((name, found), (_, expected)) in part.columns().iter().zip(whole.columns()) {
                        assert_eq!(
                            bits(found),
                            bits(&expected[range.clone()]),
                            "{name}, {kind:?}, {tier:?}, {range:?}"
                        );
                    }
                }
            }
            assert_eq!(run(&backend, &queries.slice(0..0)), Answers::default());
        }
    }
}

#[test]
fn repeated_calls_give_the_same_bytes_and_both_estimators_the_same_direction() {
    for (seed, kind, material) in materials() {
        let queries = Queries::random(6, 500).with_params(&material, seed);
        for tier in Tier::available() {
            let first = backend(&material, tier);
            let once = run(&first, &queries);
            for again in [run(&first, &queries), run(&backend(&material, tier), &queries)] {
                for ((name, found), (_, expected)) in again.columns().iter().zip(once.columns()) {
                    assert_eq!(bits(found), bits(expected), "{name}, {kind:?}, {tier:?}");
                }
                assert_eq!(again.inversions, once.inversions, "{kind:?}, {tier:?}");
            }
            let wi = once.wi.each_ref().map(|c| bits(c));
            assert_eq!(
                wi,
                once.wi_of_jacobian.each_ref().map(|c| bits(c)),
                "{kind:?}, {tier:?}"
            );
            assert_eq!(
                wi,
                once.wi_of_mixture.each_ref().map(|c| bits(c)),
                "{kind:?}, {tier:?}"
            );
        }
    }
}

#[test]
fn directions_are_unit_and_above_the_horizon_and_everything_is_finite() {
    for (seed, kind, mut material) in materials() {
        // The second time around with weights that saturate every clamp, then with those whose sums overflow.
        for scale in [1.0, 1e4, 1e30] {
            for network in [&mut material.sample, &mut material.eval, &mut material.pdf] {
                let layers = network.net.iter_mut().chain(&mut network.frame);
                layers.for_each(|layer| layer.weight.iter_mut().for_each(|w| *w *= scale));
            }
            for queries in [Queries::hard(), Queries::random(8, 500)] {
                let queries = queries.with_params(&material, seed);
                for tier in Tier::available() {
                    let answers = run(&backend(&material, tier), &queries);
                    for (name, column) in answers.columns() {
                        assert!(column.iter().all(|v| v.is_finite()), "{name}, {kind:?}, {tier:?}");
                    }
                    for i in 0..queries.len() {
                        let wi: [f64; 3] = std::array::from_fn(|c| f64::from(answers.wi[c][i]));
                        let length = (wi[0] * wi[0] + wi[1] * wi[1] + wi[2] * wi[2]).sqrt();
                        assert!(
                            (length - 1.0).abs() < UNIT_TOL && wi[2] > 0.0,
                            "{wi:?}, {kind:?}, {tier:?}, query {i}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn bad_queries_give_zeros_and_leave_their_neighbours_alone() {
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
    let is_bad = |i: usize| i % 20 == 3 && i / 20 < bad.len();
    for (seed, kind, material) in materials() {
        let good = Queries::random(9, 200).with_params(&material, seed);
        let (mut bad_wo, mut bad_wi, mut bad_params) = (good.clone(), good.clone(), good.clone());
        for (k, direction) in bad.iter().enumerate() {
            for (c, &component) in direction.iter().enumerate() {
                bad_wo.wo[c][20 * k + 3] = component;
                bad_wi.wi[c][20 * k + 3] = component;
            }
        }
        // A column of one value belongs to all queries.
        let column = bad_params.params.iter_mut().find(|column| column.len() > 1);
        let has_params = column.is_some();
        if let Some(column) = column {
            (0..bad.len()).for_each(|k| column[20 * k + 3] = if k % 2 == 0 { nan } else { infinity });
        }
        for tier in Tier::available() {
            let backend = backend(&material, tier);
            let [expected, of_wo, of_wi, of_params] =
                [&good, &bad_wo, &bad_wi, &bad_params].map(|queries| run(&backend, queries));
            for (c, (name, expected)) in expected.columns().into_iter().enumerate() {
                let samples = name.starts_with("wi") || ["weight", "jacobian", "mixture"].contains(&name);
                let zero = if name.starts_with("wi") && c % 3 == 2 {
                    1.0
                } else {
                    0.0
                };
                for i in 0..good.len() {
                    let check = |answers: &Answers, fails: bool, what: &str| {
                        let expected = if fails && is_bad(i) { zero } else { expected[i] };
                        let found = answers.columns()[c].1[i];
                        assert_eq!(
                            found, expected,
                            "{name} of query {i}, bad {what}, {kind:?}, {tier:?}"
                        );
                    };
                    check(&of_wo, true, "wo");
                    check(&of_wi, !samples, "wi");
                    check(&of_params, has_params, "parameter");
                }
            }
        }
    }
}

#[test]
fn u_that_is_no_number_and_directions_that_are_not_unit_stay_finite() {
    for (seed, kind, material) in materials() {
        let mut queries = Queries::random(12, 120).with_params(&material, seed);
        for (i, scale) in (0..queries.len()).zip([1e-30f32, 1e-10, 1e10, 1e30].into_iter().cycle()) {
            (0..3).for_each(|c| queries.wo[c][i] *= scale);
            (0..3).for_each(|c| queries.wi[c][i] *= if i % 3 == 0 { scale } else { 1.0 });
            queries.u[i % 2][i] = [f32::NAN, -1.0, 2.0, f32::INFINITY][i / 4 % 4];
            for column in queries.params.iter_mut().filter(|column| column.len() > 1) {
                column[i] = [-1.0, 1e30, 0.0, -1e30][i / 3 % 4];
            }
        }
        for tier in Tier::available() {
            for (name, column) in run(&backend(&material, tier), &queries).columns() {
                assert!(
                    column.iter().all(|v| v.is_finite()),
                    "{name}, {kind:?}, {tier:?}: {column:?}"
                );
            }
        }
    }
}

#[test]
fn slices_of_different_length_are_an_error_that_names_the_argument() {
    let material = Kind::Free.build(14);
    let [queries, short] = [8, 7].map(|count| Queries::random(13, count).with_params(&material, 13));
    let backend = backend(&material, Tier::best());
    let (wi, u) = (refs(&queries.wi), refs(&queries.u));
    let (params, short_params) = (queries.columns(), short.columns());
    let points = Points {
        params: &params,
        wo: refs(&queries.wo),
    };
    let with = |params| Points { params, ..points };
    let short_wo = Points {
        wo: [points.wo[0], points.wo[1], &short.wo[2]],
        ..points
    };
    let mut answers = Answers::new(8);
    fn check<T: std::fmt::Debug>(result: bake_runtime::Result<T>, argument: &str, lengths: [usize; 2]) {
        match result {
            Err(Error::BatchLength {
                name,
                expected,
                found,
            }) => assert_eq!((name, [expected, found]), (argument, lengths)),
            other => panic!("{argument}: {other:?}"),
        }
    }
    let Answers {
        wi: out,
        weight,
        jacobian,
        f_cos,
        pdf,
        ..
    } = &mut answers;
    let of_wo = backend.sample_learned(short_wo, u, slices(out), slices(weight));
    check(of_wo, "wo", [8, 7]);
    let of_params = backend.sample_jacobian(with(&short_params), u, slices(out), jacobian);
    check(of_params, "params", [8, 7]);
    check(backend.pdf(with(&params[1..]), wi, pdf), "params", [3, 2]);
    check(backend.exact_pdf(with(&[]), wi, pdf), "params", [3, 0]);
    let of_u = backend.sample_learned(points, refs(&short.u), slices(out), slices(weight));
    check(of_u, "u", [8, 7]);
    let of_jacobian = backend.sample_mixture(points, u, slices(out), &mut jacobian[..7]);
    check(of_jacobian, "jacobian", [8, 7]);
    let of_wi = backend.eval(points, refs(&short.wi), slices(f_cos));
    check(of_wi, "wi", [8, 7]);
    check(backend.pdf(points, wi, &mut pdf[..7]), "pdf", [8, 7]);
    check(backend.exact_pdf(points, wi, &mut pdf[..7]), "pdf", [8, 7]);
    f_cos[1].pop();
    weight[2].pop();
    out[0].pop();
    check(backend.eval(points, wi, slices(f_cos)), "f_cos", [8, 7]);
    let of_out = backend.sample_jacobian(points, u, slices(out), jacobian);
    check(of_out, "wi", [8, 7]);
    out[0].push(0.0);
    let of_weight = backend.sample_learned(points, u, slices(out), slices(weight));
    check(of_weight, "weight", [8, 7]);
}

#[test]
fn a_material_that_contradicts_itself_is_refused() {
    let sound = Kind::Mixed.build(15);
    let refused = |change: &dyn Fn(&mut BakedMaterial)| {
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
    refused(&|m| m.sample.spec.inputs[0].quantity = Quantity::Local(0));
    refused(&|m| m.eval.spec.material = Kind::Free.build(16).eval.spec.material);
    let fixed = Kind::Fixed.build(18).pdf;
    refused(&|m| {
        // One chart where the sampling network has two, of the same material.
        let material = m.pdf.spec.material.clone();
        m.pdf = fixed.clone();
        m.pdf.spec.material = material;
    });
}

#[test]
fn maps_on_the_disk_are_not_inverted() {
    let material = Kind::Paper.build(19);
    let queries = Queries::random(20, 4).with_params(&material, 20);
    let params = queries.columns();
    let points = Points {
        params: &params,
        wo: refs(&queries.wo),
    };
    let mut pdf = [0.0; 4];
    let error = backend(&material, Tier::best()).exact_pdf(points, refs(&queries.wi), &mut pdf);
    assert!(matches!(error, Err(Error::Query { name, .. }) if name == "exact_pdf"));
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
            false => Tier::Portable,
        };
        assert_eq!(Tier::best(), expected);
        assert_eq!(Tier::available().contains(&Tier::Avx2), avx2);
    }
    let material = Kind::Fixed.build(17);
    for tier in Tier::ALL {
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

#[test]
fn parameters_are_bound_by_finite_values_one_for_each() {
    let material = Kind::Free.build(1);
    let backend = backend(&material, Tier::best());
    assert!(matches!(
        backend.bind(&[Some(0.3)]),
        Err(Error::BatchLength {
            name: "params",
            expected: 3,
            found: 1
        })
    ));
    let error = backend
        .bind(&[Some(0.3), Some(f32::NAN), None])
        .err()
        .expect("not a number")
        .to_string();
    assert!(error.contains("params[1]"), "{error}");
    let bound = backend.bind(&[Some(0.3), None, Some(0.5)]).expect("one is left");
    let again = bound.bind(&[Some(0.1)]).expect("the last one");
    let whole = backend
        .bind(&[Some(0.3), Some(0.1), Some(0.5)])
        .expect("all of them");
    let queries = Queries::random(9, 100);
    // Folded in one go or one after the other: the bias is rounded once or twice.
    for (once, twice) in run(&whole, &queries).wi[0]
        .iter()
        .zip(&run(&again, &queries).wi[0])
    {
        assert!((once - twice).abs() < BOUND_TOL, "{once}, {twice}");
    }
}
