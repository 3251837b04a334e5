//! Odd batches and invalid queries.

use crate::specifications::{Places, random_networks};
use crate::support::python::python;
use crate::{exported, small};
use bake_runtime::onnxruntime::OrtBackend;
use bake_runtime::{Backend, BakedMaterial, Error, Points};

/// Sizes of a batch: around one and around every power of two that a chunk may have.
const SIZES: [usize; 8] = [0, 1, 2, 255, 257, 1024, 1025, 4097];

/// Sums of a dozen f32 terms of size 1, in another order.
const ROUNDING_TOL: f32 = 1e-6;

fn backend(material: &BakedMaterial) -> OrtBackend {
    OrtBackend::new(exported(material).path()).expect("exported models load")
}

#[test]
fn batches_of_any_size_give_the_same_answers() {
    python();
    let ort = backend(&small());
    let largest = SIZES.into_iter().max().expect("there are sizes");
    let column = |step: f32| -> Vec<f32> { (0..largest).map(|i| (i as f32 * step).fract()).collect() };
    let (u, v, z) = (column(0.618_034), column(0.754_877_7), vec![1.0; largest]);
    let zero = vec![0.0; largest];
    let draw = |n: usize| {
        let mut wi = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
        let mut jacobian = vec![0.0; n];
        let out = wi.each_mut().map(Vec::as_mut_slice);
        let points = Points::fixed([&zero[..n], &zero[..n], &z[..n]]);
        ort.sample_jacobian(points, [&u[..n], &v[..n]], out, &mut jacobian)
            .unwrap_or_else(|e| panic!("{n} queries: {e}"));
        (wi, jacobian)
    };
    let (all, _) = draw(largest);
    for n in SIZES {
        let (wi, jacobian) = draw(n);
        assert_eq!(jacobian.len(), n);
        for c in 0..3 {
            // Sizes take different kernels of onnxruntime, which round differently.
            let apart = wi[c]
                .iter()
                .zip(&all[c])
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f32::max);
            assert!(
                apart <= ROUNDING_TOL,
                "{n} queries: component {c} of wi differs by {apart:e}"
            );
        }
    }
}

#[test]
fn one_value_of_a_parameter_is_that_of_the_whole_batch() {
    python();
    for places in Places::ALL {
        let material = random_networks(places, true, 0);
        let ort = backend(&material);
        let free = material.sample.spec.material.free();
        let n = 1500;
        let (slant, height) = (vec![0.6; n], vec![0.8; n]);
        let zero = vec![0.0; n];
        let wo = [&slant[..], &zero, &height];
        let pdf = |params: &[&[f32]]| {
            let mut pdf = vec![0.0; n];
            ort.pdf(Points { params, wo }, [&zero, &slant, &height], &mut pdf)
                .expect("parameters are of the length of the batch or 1");
            pdf
        };
        let middle: Vec<f32> = free
            .iter()
            .map(|(_, min, max)| (0.5 * (min + max)) as f32)
            .collect();
        let repeated: Vec<Vec<f32>> = middle.iter().map(|&value| vec![value; n]).collect();
        let once: Vec<&[f32]> = middle.iter().map(std::slice::from_ref).collect();
        let mixed: Vec<&[f32]> = once
            .iter()
            .zip(&repeated)
            .enumerate()
            .map(|(i, (one, all))| if i % 2 == 0 { *one } else { &all[..] })
            .collect();
        let all: Vec<&[f32]> = repeated.iter().map(Vec::as_slice).collect();
        let expected = pdf(&all);
        assert!(expected[0] > 0.0);
        assert_eq!(pdf(&once), expected);
        assert_eq!(pdf(&mixed), expected);
    }
}

#[test]
fn slices_of_different_length_are_an_error() {
    python();
    let ort = backend(&small());
    let (two, three) = ([0.5; 2], [0.5; 3]);
    let mut pdf = [0.0; 3];
    let error = ort
        .pdf(Points::fixed([&three; 3]), [&three, &two, &three], &mut pdf)
        .expect_err("lengths differ");
    assert!(
        matches!(
            error,
            Error::BatchLength {
                name: "wi",
                expected: 3,
                found: 2
            }
        ),
        "{error}"
    );
    let ort = backend(&random_networks(Places::Disk, true, 0));
    for params in [&[&three[..]; 2][..], &[&three, &two, &three]] {
        let points = Points {
            params,
            wo: [&three; 3],
        };
        let error = ort
            .pdf(points, [&three; 3], &mut pdf)
            .expect_err("three parameters are free");
        assert!(
            matches!(
                error,
                Error::BatchLength {
                    name: "params",
                    expected: 3,
                    found: 2
                }
            ),
            "{error}"
        );
    }
}

#[test]
fn invalid_queries_give_zeros_and_the_normal() {
    python();
    let nan = f32::NAN;
    let slanted = [0.6, 0.0, 0.8];
    let directions = [
        [0.0, 0.0, -1.0],
        [1.0, 0.0, 0.0],
        [nan, 0.0, 1.0],
        [0.0, f32::INFINITY, 1.0],
        [0.0, 0.0, nan],
        slanted,
        slanted,
        slanted,
    ];
    let n = directions.len();
    let soa: [Vec<f32>; 3] = std::array::from_fn(|c| directions.iter().map(|d| d[c]).collect());
    let w = soa.each_ref().map(Vec::as_slice);
    for (places, free) in Places::ALL.into_iter().flat_map(|p| [(p, false), (p, true)]) {
        let material = random_networks(places, free, 0);
        let ort = backend(&material);
        let ranges = material.sample.spec.material.free();
        let mut params: Vec<Vec<f32>> = ranges.iter().map(|(_, min, _)| vec![*min as f32; n]).collect();
        let mut invalid = 5;
        if let Some(first) = params.first_mut() {
            first[5..7].copy_from_slice(&[nan, f32::INFINITY]);
            invalid = 7;
        }
        let params: Vec<&[f32]> = params.iter().map(Vec::as_slice).collect();
        let points = Points {
            params: &params,
            wo: w,
        };
        let u = vec![0.25; n];
        let mut out = [(); 11].map(|()| vec![nan; n]);
        let [x, y, z, r, g, b, jx, jy, jz, jacobian, pdf] = out.each_mut().map(Vec::as_mut_slice);
        ort.sample_learned(points, [&u, &u], [x, y, z], [r, g, b])
            .expect("invalid queries are answered");
        ort.sample_jacobian(points, [&u, &u], [jx, jy, jz], jacobian)
            .expect("invalid queries are answered");
        ort.pdf(points, w, pdf).expect("invalid queries are answered");
        for i in 0..invalid {
            let row = out.each_ref().map(|column| column[i]);
            let (zero, normal) = ([0.0; 3], [0.0, 0.0, 1.0]);
            assert_eq!(
                [&row[..3], &row[3..6], &row[6..9], &row[9..11]],
                [&normal[..], &zero, &normal, &zero[..2]],
                "{places:?}, query {i}, {:?}",
                directions[i]
            );
        }
        let mut answered = out[3].iter().chain(&out[10]).enumerate();
        assert!(
            answered.all(|(i, value)| i % n < invalid || *value > 0.0),
            "{places:?}: the valid queries among them are answered"
        );
    }
}

#[test]
fn u_outside_its_range_gives_finite_answers() {
    python();
    for places in Places::ALL {
        let ort = backend(&random_networks(places, false, 0));
        let u = [0.0, 1.0, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
        let v = [0.5; 6];
        let (zero, one) = ([0.0; 6], [1.0; 6]);
        let mut out = [[f32::NAN; 6]; 4];
        let [x, y, z, jacobian] = out.each_mut().map(|a| &mut a[..]);
        ort.sample_jacobian(Points::fixed([&zero, &zero, &one]), [&u, &v], [x, y, z], jacobian)
            .expect("every u is answered");
        assert!(
            out.iter().flatten().all(|value| value.is_finite()),
            "{places:?}: {out:?}"
        );
    }
}
