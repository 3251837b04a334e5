//! What native backends promise beyond the interface of all: exact densities however they are asked for, sound materials,
//! tiers.

use crate::inverted::{Inverted, backend, invert};
use bake_runtime::conformance::answers::ask;
use bake_runtime::conformance::materials::Kind;
use bake_runtime::conformance::queries::{Queries, refs, slices};
use bake_runtime::encoding::Quantity;
use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::{BakedMaterial, Error};

/// Named kinds and some random specifications, with a seed for each.
fn materials() -> impl Iterator<Item = (u64, Kind, BakedMaterial)> {
    let kinds = Kind::NAMED.into_iter().chain((0..12).map(Kind::Any));
    (0..)
        .zip(kinds)
        .map(|(seed, kind)| (seed, kind, kind.build(seed)))
}

#[test]
fn exact_densities_do_not_depend_on_the_batch() {
    for (seed, kind, material) in materials() {
        let queries = Queries::random(4, 200).with_params(&material, seed);
        for tier in Tier::available() {
            let backend = backend(&material, tier);
            let whole = invert(&backend, &queries);
            for size in [1, 3, 5, 7, 40, 64] {
                for start in (0..queries.len()).step_by(size) {
                    let range = start..(start + size).min(queries.len());
                    let part = invert(&backend, &queries.select(range.clone()));
                    for ((name, found), (_, expected)) in part.columns().iter().zip(whole.columns()) {
                        assert_eq!(
                            bits(found),
                            bits(&expected[range.clone()]),
                            "{name}, {kind:?}, {tier:?}, {range:?}"
                        );
                    }
                }
            }
            assert_eq!(invert(&backend, &queries.select(0..0)), Inverted::default());
        }
    }
}

#[test]
fn mixtures_draw_what_the_other_estimators_draw_and_repeat_themselves() {
    for (seed, kind, material) in materials() {
        let queries = Queries::random(6, 500).with_params(&material, seed);
        for tier in Tier::available() {
            let first = backend(&material, tier);
            let once = invert(&first, &queries);
            for again in [
                invert(&first, &queries),
                invert(&backend(&material, tier), &queries),
            ] {
                for ((name, found), (_, expected)) in again.columns().iter().zip(once.columns()) {
                    assert_eq!(bits(found), bits(expected), "{name}, {kind:?}, {tier:?}");
                }
                assert_eq!(again.inversions, once.inversions, "{kind:?}, {tier:?}");
            }
            assert_eq!(
                once.wi.each_ref().map(|c| bits(c)),
                ask(&first, &queries).wi.each_ref().map(|c| bits(c)),
                "{kind:?}, {tier:?}"
            );
        }
    }
}

#[test]
fn exact_densities_are_finite_whatever_the_network_and_the_query() {
    for (seed, kind, mut material) in materials() {
        // The second time around with weights that saturate every clamp, then with those whose sums overflow.
        for scale in [1.0, 1e4, 1e30] {
            for network in [&mut material.sample, &mut material.eval, &mut material.pdf] {
                let layers = network.net.iter_mut().chain(&mut network.frame);
                layers.for_each(|layer| layer.weight.iter_mut().for_each(|w| *w *= scale));
            }
            let mut odd = Queries::random(12, 120).with_params(&material, seed);
            for (i, scale) in (0..odd.len()).zip([1e-30f32, 1e-10, 1e10, 1e30].into_iter().cycle()) {
                (0..3).for_each(|c| odd.wo[c][i] *= scale);
                (0..3).for_each(|c| odd.wi[c][i] *= if i % 3 == 0 { scale } else { 1.0 });
                odd.u[i % 2][i] = [f32::NAN, -1.0, 2.0, f32::INFINITY][i / 4 % 4];
                for column in odd.params.iter_mut().filter(|column| column.len() > 1) {
                    column[i] = [-1.0, 1e30, 0.0, -1e30][i / 3 % 4];
                }
            }
            let [hard, random] = [Queries::hard(), Queries::random(8, 500)]
                .map(|queries| queries.with_params(&material, seed));
            for queries in [&hard, &random, &odd] {
                for tier in Tier::available() {
                    for (name, column) in invert(&backend(&material, tier), queries).columns() {
                        assert!(column.iter().all(|v| v.is_finite()), "{name}, {kind:?}, {tier:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn bad_queries_have_no_exact_density_and_leave_their_neighbours_alone() {
    let (nan, infinity) = (f32::NAN, f32::INFINITY);
    let bad = [
        [0.0, 0.6, -0.8],
        [1.0, 0.0, 0.0],
        [0.0, 0.0, 0.0],
        [nan, 0.0, 1.0],
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
                [&good, &bad_wo, &bad_wi, &bad_params].map(|queries| invert(&backend, queries));
            for (c, (name, expected)) in expected.columns().into_iter().enumerate() {
                let zero = if c == 3 { 1.0 } else { 0.0 };
                for i in 0..good.len() {
                    let check = |answers: &Inverted, fails: bool, what: &str| {
                        let expected = if fails && is_bad(i) { zero } else { expected[i] };
                        let found = answers.columns()[c].1[i];
                        assert_eq!(
                            found, expected,
                            "{name} of query {i}, bad {what}, {kind:?}, {tier:?}"
                        );
                    };
                    check(&of_wo, true, "wo");
                    check(&of_wi, c == 0, "wi");
                    check(&of_params, has_params, "parameter");
                }
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
    let params = queries.columns();
    let (points, without) = (queries.points(&params), queries.points(&[]));
    let mut out = queries.wi.clone();
    let (mut jacobian, mut pdf) = ([0.0; 8], [0.0; 8]);
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
    check(backend.exact_pdf(without, wi, &mut pdf), "params", [3, 0]);
    check(backend.exact_pdf(points, refs(&short.wi), &mut pdf), "wi", [8, 7]);
    check(backend.exact_pdf(points, wi, &mut pdf[..7]), "pdf", [8, 7]);
    let of_u = backend.sample_mixture(points, refs(&short.u), slices(&mut out), &mut jacobian);
    check(of_u, "u", [8, 7]);
    let of_jacobian = backend.sample_mixture(points, u, slices(&mut out), &mut jacobian[..7]);
    check(of_jacobian, "jacobian", [8, 7]);
    out[0].pop();
    let of_out = backend.sample_mixture(points, u, slices(&mut out), &mut jacobian);
    check(of_out, "wi", [8, 7]);
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
    let mut pdf = [0.0; 4];
    let error =
        backend(&material, Tier::best()).exact_pdf(queries.points(&params), refs(&queries.wi), &mut pdf);
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
