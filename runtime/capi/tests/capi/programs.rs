//! Programs in C and C++: the example, and one that asks every query.

use crate::compiler::{C, CPP, Program};
use crate::support::{Batch, shipped};
use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::{Backend, BakedMaterial, Points};

const EXAMPLE: &str = "examples/sample.c";
/// Queries of the example.
const EXAMPLE_COUNT: u32 = 4096;
/// Queries of each program that asks every one: some whole tiles, and some left over.
const COUNT: usize = 1013;

#[test]
fn the_header_is_valid_cpp() {
    Program::new(&CPP, "tests/capi/version.cpp").run(&[]);
}

#[test]
fn the_example_prints_what_the_library_answers() {
    let program = Program::new(&C, EXAMPLE);
    for name in ["vase", "conductor"] {
        let folder = shipped(name);
        let folder = folder.to_str().expect("a path in UTF-8");
        for tier in [None, Some(Tier::Portable)] {
            let arguments = [Some(folder), tier.map(Tier::name)];
            let arguments: Vec<&str> = arguments.into_iter().flatten().collect();
            let tier = tier.unwrap_or_else(|| Tier::chosen().expect("BAKE_TIER names a tier or none"));
            assert_eq!(
                words(&program.run(&arguments)),
                words(&example(name, tier)),
                "{name}"
            );
        }
    }
}

/// What the example has to print.
fn example(name: &str, tier: Tier) -> String {
    let material = BakedMaterial::load(&shipped(name)).expect("shipped networks load");
    let backend = NativeBackend::new(&material, tier).expect("the tier is available");
    let free = material.sample.spec.material.free();
    let ranges: Vec<(String, f32, f32)> = free
        .into_iter()
        .map(|(name, min, max)| (name, min as f32, max as f32))
        .collect();
    let middle: Vec<Option<f32>> = ranges
        .iter()
        .map(|(_, min, max)| Some(0.5 * (min + max)))
        .collect();
    let bound = backend.bind(&middle).expect("one value per parameter");
    let n = EXAMPLE_COUNT as usize;
    let wo = [0.866_025_4, 0.0, 0.5].map(|component| vec![component; n]);
    let u0: Vec<f32> = (0..EXAMPLE_COUNT).map(|i| (i as f32 + 0.5) / n as f32).collect();
    let u1: Vec<f32> = (0..EXAMPLE_COUNT)
        .map(|i| i.reverse_bits() as f32 / 2f32.powi(32))
        .collect();
    let [mut wi, mut color] = [n; 2].map(columns);
    let mut pdf = vec![0.0; n];
    let points = Points::fixed(slices(&wo));
    let drawn = bound.sample_learned(points, [&u0, &u1], slices_mut(&mut wi), slices_mut(&mut color));
    drawn.expect("columns are of one length");

    let mut text = format!("tier {}\n", tier.name());
    for (name, min, max) in &ranges {
        text += &format!("parameter {name} {min} {max}\n");
    }
    let albedo = color
        .each_ref()
        .map(|channel| channel.iter().map(|w| f64::from(w / n as f32)).sum::<f64>());
    text += &format!("albedo {:.6} {:.6} {:.6}\n", albedo[0], albedo[1], albedo[2]);
    let valid = (0..n)
        .filter(|i| color.iter().any(|channel| channel[*i] > 0.0))
        .count();
    text += &format!("valid {:.6}\n", valid as f64 / n as f64);
    assert!(valid > n / 2, "{name}: {valid} of {n}");

    let evaluated = bound.eval(points, slices(&wi), slices_mut(&mut color));
    evaluated.expect("columns are of one length");
    bound
        .pdf(points, slices(&wi), &mut pdf)
        .expect("columns are of one length");
    for i in (0..n).step_by(n / 4) {
        let [x, y, z, r, g, b] = [&wi[0], &wi[1], &wi[2], &color[0], &color[1], &color[2]].map(|c| c[i]);
        text += &format!("wi {x} {y} {z} f_cos {r} {g} {b} pdf {}\n", pdf[i]);
    }
    text
}

/// Words of a text; numbers in one spelling, which keeps every bit of a float.
fn words(text: &str) -> Vec<String> {
    let number = |word: &str| word.parse().map(|value: f32| format!("{value:?}"));
    text.split_whitespace()
        .map(|word| number(word).unwrap_or(word.to_string()))
        .collect()
}

#[test]
fn answers_in_c_are_the_librarys_bit_for_bit() {
    let program = Program::new(&C, "tests/capi/answers.c");
    for name in ["vase", "conductor", "layered", "conductor-paper"] {
        let material = BakedMaterial::load(&shipped(name)).expect("shipped networks load");
        let batch = queries(&material);
        let asked: Vec<&Vec<f32>> = batch.params.iter().chain(&batch.wo).chain(&batch.u).collect();
        let bytes: Vec<u8> = asked
            .into_iter()
            .flatten()
            .flat_map(|v| v.to_ne_bytes())
            .collect();
        let [input, output] = ["queries", "answers"].map(|file| program.file(file));
        std::fs::write(&input, bytes).expect("a temporary folder can be written");
        for tier in Tier::available() {
            let paths = [&shipped(name), &input, &output].map(|path| path.display().to_string());
            let [folder, input, output] = &paths;
            let counts = program.run(&[folder, tier.name(), &COUNT.to_string(), input, output]);
            let answers = std::fs::read(output).expect("the program writes its answers");
            let (expected, expected_counts) = answers_of(&material, tier, &batch);
            assert_eq!(counts.trim(), expected_counts, "{name}, {tier:?}");
            let expected: Vec<u8> = expected.iter().flat_map(|v| v.to_ne_bytes()).collect();
            assert!(answers == expected, "{name}, {tier:?}: answers differ");
        }
    }
}

/// Queries over the whole ranges of `material`, some of them invalid.
fn queries(material: &BakedMaterial) -> Batch {
    let free = material.sample.spec.material.free();
    let mut batch = Batch::random(COUNT, free.len(), 5);
    for (column, (_, min, max)) in batch.params.iter_mut().zip(free) {
        for value in column {
            *value = min as f32 + *value * (max - min) as f32;
        }
    }
    batch.wo[0][3] = f32::NAN;
    batch.wo[2][500] = -0.5;
    if let Some(column) = batch.params.last_mut() {
        column[70] = f32::INFINITY;
    }
    batch
}

/// What the program `answers.c` has to write, and the counts that it has to print.
fn answers_of(material: &BakedMaterial, tier: Tier, batch: &Batch) -> (Vec<f32>, String) {
    const FITS: &str = "columns are of one length";
    let backend = NativeBackend::new(material, tier).expect("the tier is available");
    let mut params: Vec<&[f32]> = batch.params.iter().map(Vec::as_slice).collect();
    if let Some(column) = params.first_mut() {
        *column = &column[..1];
    }
    let wo = slices(&batch.wo);
    let points = Points { params: &params, wo };
    let u = batch.u.each_ref().map(Vec::as_slice);
    let [mut drawn, mut wi, mut color] = [COUNT; 3].map(columns);
    let mut scalar = vec![0.0; COUNT];
    let mut answers: Vec<f32> = Vec::new();
    backend
        .sample_learned(points, u, slices_mut(&mut drawn), slices_mut(&mut color))
        .expect(FITS);
    answers.extend(drawn.iter().chain(&color).flatten());
    backend
        .sample_jacobian(points, u, slices_mut(&mut wi), &mut scalar)
        .expect(FITS);
    answers.extend(wi.iter().chain([&scalar]).flatten());
    let mixture = backend
        .sample_mixture(points, u, slices_mut(&mut wi), &mut scalar)
        .expect(FITS);
    answers.extend(wi.iter().chain([&scalar]).flatten());
    let drawn = slices(&drawn);
    backend.eval(points, drawn, slices_mut(&mut color)).expect(FITS);
    answers.extend(color.iter().flatten());
    backend.pdf(points, drawn, &mut scalar).expect(FITS);
    answers.extend(&scalar);
    // The paper's networks have no inverse.
    let exact = backend.exact_pdf(points, drawn, &mut scalar);
    if exact.is_ok() {
        answers.extend(&scalar);
    }
    let exact = exact.unwrap_or_default();

    let mut values = vec![None; params.len()];
    if let (Some(value), Some(column)) = (values.last_mut(), params.pop()) {
        *value = Some(column[0]);
    }
    let bound = backend.bind(&values).expect("one value per parameter");
    let points = Points { params: &params, wo };
    bound.eval(points, drawn, slices_mut(&mut color)).expect(FITS);
    answers.extend(color.iter().flatten());
    let counts = [mixture, exact].map(|counts| format!("{} {}", counts.queries, counts.unconverged));
    (answers, counts.join(" "))
}

fn columns(length: usize) -> [Vec<f32>; 3] {
    std::array::from_fn(|_| vec![0.0; length])
}

fn slices(columns: &[Vec<f32>; 3]) -> [&[f32]; 3] {
    columns.each_ref().map(Vec::as_slice)
}

fn slices_mut(columns: &mut [Vec<f32>; 3]) -> [&mut [f32]; 3] {
    columns.each_mut().map(Vec::as_mut_slice)
}
