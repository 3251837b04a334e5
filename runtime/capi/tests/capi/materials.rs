//! Materials: what is refused when they are loaded, bound and described, and what binding leaves free.

use crate::support::{Batch, Material, directions, exact_pdf, refused, said, shipped};
use bake::*;
use bake_runtime::Network;
use std::ffi::CStr;
use std::path::Path;
use std::ptr::{null, null_mut};

const COUNT: usize = 40;

#[test]
fn null_materials_and_places_are_refused_or_have_nothing() {
    let material = Material::shipped("conductor");
    let mut place = null_mut();
    let empty = BakeBytes {
        data: null(),
        length: 3,
    };
    // SAFETY: nothing but null, and places that live.
    unsafe {
        let null_pointer = |status, name| refused(said(status), BakeStatus::NullPointer, name);
        null_pointer(bake_material_load(null(), null(), &mut place), "`folder`");
        null_pointer(bake_material_load(c"x".as_ptr(), null(), null_mut()), "`out`");
        let status = bake_material_from_memory(empty, empty, empty, null(), &mut place);
        null_pointer(status, "`sample`");
        null_pointer(bake_material_bind(null(), null(), 0, &mut place), "`material`");
        let status = bake_material_bind(material.pointer(), null(), material.free(), &mut place);
        null_pointer(status, "`values`");
        let status = bake_material_parameter(material.pointer(), 0, null_mut());
        null_pointer(status, "`out`");
        assert_eq!(bake_material_parameter_count(null()), 0);
        assert_eq!(bake_material_chart_count(null()), 0);
        assert!(bake_material_tier(null()).is_null());
        bake_material_free(null_mut());
    }
    assert!(place.is_null());
}

#[test]
fn names_indices_and_values_that_make_no_sense_are_refused() {
    let tier = Material::load(&shipped("vase"), Some("sse9"));
    refused(tier.map(drop), BakeStatus::InvalidArgument, "`tier`: is `sse9`");
    let material = Material::shipped("conductor");
    for wrong in [0, material.free() - 1, material.free() + 1] {
        let bound = material.bind(&vec![0.5; wrong]);
        refused(bound.map(drop), BakeStatus::WrongLength, "`count`");
    }
    let mut values = vec![0.5; material.free()];
    values[1] = f32::NEG_INFINITY;
    refused(
        material.bind(&values).map(drop),
        BakeStatus::InvalidArgument,
        "`values[1]`",
    );
    let mut parameter = BakeParameter {
        name: null(),
        min: 0.0,
        max: 0.0,
    };
    // SAFETY: the material and the place live.
    let status = unsafe { bake_material_parameter(material.pointer(), material.free(), &mut parameter) };
    refused(said(status), BakeStatus::InvalidArgument, "`index`");
    assert!(parameter.name.is_null());

    let paper = Material::shipped("conductor-paper");
    let mut batch = Batch::random(COUNT, paper.free(), 1);
    let columns = batch.columns();
    let (points, wi) = (batch.points(&columns), directions(&batch.wo));
    let said = exact_pdf(
        paper.pointer(),
        &points,
        wi,
        batch.scalar.as_mut_ptr(),
        null_mut(),
    );
    refused(said, BakeStatus::InvalidArgument, "use `pdf`");
    assert!(batch.untouched());
}

#[test]
fn what_is_bound_is_not_free_any_more() {
    let material = Material::shipped("conductor");
    let mut values = vec![f32::NAN; material.free()];
    values[0] = 0.5;
    let bound = material.bind(&values).expect("one value per parameter");
    assert_eq!(bound.free(), material.free() - 1);
    let describe = |material: &Material, index| {
        let mut parameter = BakeParameter {
            name: null(),
            min: 0.0,
            max: 0.0,
        };
        // SAFETY: material and place live, and so do names as long as the material.
        unsafe {
            said(bake_material_parameter(material.pointer(), index, &mut parameter)).expect("it is free");
            let name = CStr::from_ptr(parameter.name).to_string_lossy().into_owned();
            (name, parameter.min, parameter.max)
        }
    };
    for index in 0..bound.free() {
        assert_eq!(describe(&bound, index), describe(&material, index + 1));
    }
    let (name, min, max) = describe(&material, 0);
    assert!(name == "alpha[0]" && min < max, "{name} {min} {max}");
    // The bound one lives on without the first.
    drop(material);
    let mut batch = Batch::random(COUNT, bound.free(), 1);
    batch.sample(&bound).expect("a valid batch");
    assert!(!batch.untouched());
}

#[test]
fn files_that_are_missing_or_no_networks_are_refused_by_name() {
    let missing = Material::load(Path::new("no/such/folder"), None);
    refused(
        missing.map(drop),
        BakeStatus::Io,
        "no/such/folder/sample.safetensors",
    );
    let refuse = |files: [&[u8]; 3], part: &str| {
        let material = Material::from_memory(files);
        refused(material.map(drop), BakeStatus::Network, part);
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        for (name, bytes) in ["sample", "eval", "pdf"].iter().zip(files) {
            let path = folder.path().join(name).with_extension("safetensors");
            std::fs::write(path, bytes).expect("a temporary folder can be written");
        }
        let material = Material::load(folder.path(), None);
        refused(material.map(drop), BakeStatus::Network, part);
    };
    let read = |name: &str| {
        ["sample", "eval", "pdf"].map(|role| {
            let path = shipped(name).join(role).with_extension("safetensors");
            std::fs::read(path).expect("shipped networks are there")
        })
    };
    let [sample, eval, pdf] = read("vase");
    drop(Material::from_memory([&sample, &eval, &pdf]).expect("as shipped"));
    let mut network = Network::from_bytes(&pdf).expect("as shipped");
    network.net[0].weight[3] = f32::NAN;
    let not_finite = network.to_bytes();
    refuse([&sample, &eval, &not_finite], "pdf.safetensors");
    refuse([&sample, &eval[..eval.len() / 2], &pdf], "eval.safetensors");
    refuse([b"", &eval, &pdf], "sample.safetensors");
    refuse(
        [&sample, &pdf, &eval],
        "eval.safetensors: not a network this program can run: it is a pdf network",
    );
    let [_, other, _] = read("conductor");
    refuse([&sample, &other, &pdf], "another material");
}
