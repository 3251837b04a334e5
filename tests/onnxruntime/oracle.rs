//! Exported graphs against the oracle in f64.

use crate::agreement::assert_agree;
use crate::answers::Queries;
use crate::networks::random_material;
use crate::specifications::{Places, random_networks};
use crate::support::python::python;
use bake_runtime::BakedMaterial;
use bake_runtime::onnxruntime::OrtBackend;
use std::collections::HashSet;
use std::hash::Hash;
use std::mem::discriminant;

/// Specifications of each kind.
const SEEDS: u64 = 6;
/// Queries of each.
const QUERIES: usize = 2000;

#[test]
fn graphs_of_random_specifications_are_what_the_oracle_defines() {
    python();
    for places in Places::ALL {
        for free in [false, true] {
            for seed in 0..SEEDS {
                let material = random_networks(places, free, seed);
                agrees_with_the_oracle(&material, seed, &format!("{places:?}, free {free}, seed {seed}"));
            }
        }
    }
}

#[test]
fn graphs_of_usual_networks_are_what_the_oracle_defines() {
    python();
    for (seed, (hidden, frame_hidden)) in [(vec![32; 4], vec![16; 2]), (vec![7], vec![]), (vec![], vec![5])]
        .into_iter()
        .enumerate()
    {
        let material = random_material(&hidden, &frame_hidden, seed as u64);
        agrees_with_the_oracle(&material, seed as u64, &format!("hidden {hidden:?}"));
    }
}

#[test]
fn random_specifications_leave_nothing_out() {
    let mut networks = Vec::new();
    for places in Places::ALL {
        for free in [false, true] {
            let seeds = (0..SEEDS).map(|seed| random_networks(places, free, seed));
            networks.extend(seeds.flat_map(|m| [m.sample.spec, m.eval.spec, m.pdf.spec]));
        }
    }
    let inputs: Vec<_> = networks
        .iter()
        .flat_map(|spec| {
            spec.inputs
                .iter()
                .chain(spec.charts().into_iter().flat_map(|c| &c.inputs))
        })
        .collect();
    fn kinds<T: Eq + Hash>(of: impl Iterator<Item = T>) -> usize {
        of.collect::<HashSet<T>>().len()
    }
    assert_eq!(kinds(inputs.iter().map(|i| discriminant(&i.quantity))), 8);
    assert_eq!(kinds(inputs.iter().map(|i| discriminant(&i.scale))), 4);
    assert_eq!(kinds(inputs.iter().map(|i| discriminant(&i.encoding))), 6);
    let of_u = inputs
        .iter()
        .filter(|i| i.quantity == bake_runtime::encoding::Quantity::U);
    assert_eq!(kinds(of_u.map(|i| discriminant(&i.encoding))), 4);
    assert_eq!(kinds(networks.iter().map(|spec| discriminant(&spec.symmetry))), 2);
    assert_eq!(
        kinds(networks.iter().map(|spec| discriminant(&spec.activation))),
        2
    );
    let alpha = networks
        .iter()
        .filter_map(|spec| spec.charts())
        .flat_map(|c| c.alpha);
    assert_eq!(kinds(alpha.map(|a| discriminant(&a))), 2);
}

fn agrees_with_the_oracle(material: &BakedMaterial, seed: u64, what: &str) {
    let folder = crate::exported(material);
    let ort = OrtBackend::new(folder.path()).unwrap_or_else(|e| panic!("{what}: {e}"));
    let queries = Queries::new(material, QUERIES, seed);
    let (found, expected) = (queries.ask(&ort), queries.ask_oracle(material));
    assert_agree(what, material, &queries, &found, &expected);
}
