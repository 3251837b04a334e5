//! Batches that are larger than what onnxruntime gets at once; the suite has smaller ones.

use crate::specifications::{Places, random_networks};
use crate::support::python::python;
use crate::{exported, small};
use bake_runtime::onnxruntime::OrtBackend;
use bake_runtime::{Backend, BakedMaterial, Points};

/// Sizes of a batch: around one and around every power of two that a chunk may have.
const SIZES: [usize; 6] = [1, 255, 257, 1024, 1025, 4097];

/// Sums of a dozen f32 terms of size 1, in another order.
const ROUNDING_TOL: f32 = 1e-6;

fn backend(material: &BakedMaterial) -> OrtBackend {
    OrtBackend::new(exported(material).path()).expect("exported models load")
}

#[test]
fn chunks_of_any_size_give_the_same_answers() {
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
fn one_value_of_a_parameter_is_that_of_every_chunk() {
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
