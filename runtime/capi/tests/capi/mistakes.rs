//! What queries refuse, with which status and words, and that a refused call writes nothing.

use crate::support::{Batch, Call, Material, UNTOUCHED, directions, eval, exact_pdf, last_error, refused};
use bake::*;
use std::ptr::{null, null_mut};

const COUNT: usize = 40;

/// Draws from `material` after `spoil` changed the arguments, and checks that it was refused untouched.
fn spoiled(material: &Material, spoil: impl Fn(&mut Call), status: BakeStatus, part: &str) {
    let mut batch = Batch::random(COUNT, material.free(), 1);
    let columns = batch.columns();
    let mut call = batch.call(&columns);
    spoil(&mut call);
    refused(call.sample(material.pointer()), status, part);
    assert!(batch.untouched(), "{part}");
}

#[test]
fn null_pointers_are_refused_by_name() {
    let material = Material::shipped("conductor");
    let null_pointer =
        |spoil: fn(&mut Call), name: &str| spoiled(&material, spoil, BakeStatus::NullPointer, name);
    null_pointer(|call| call.points.params = null(), "`points.params`");
    null_pointer(|call| call.points.wo.x = null(), "`wo.x`");
    null_pointer(|call| call.points.wo.z = null(), "`wo.z`");
    null_pointer(|call| call.u.u1 = null(), "`u.u1`");
    null_pointer(|call| call.wi.y = null_mut(), "`wi.y`");
    null_pointer(|call| call.weight.b = null_mut(), "`weight.b`");

    let mut batch = Batch::random(COUNT, material.free(), 1);
    let mut columns = batch.columns();
    columns[1].data = null();
    let call = batch.call(&columns);
    let said = call.sample(material.pointer());
    refused(said, BakeStatus::NullPointer, "`params[1]`");
    refused(call.sample(null()), BakeStatus::NullPointer, "`material`");

    let columns = batch.columns();
    let (points, wi) = (batch.points(&columns), directions(&batch.wo));
    let mut color = batch.color_out();
    let said = eval(material.pointer(), null(), wi, color);
    refused(said, BakeStatus::NullPointer, "`points`");
    color.g = null_mut();
    let said = eval(material.pointer(), &points, wi, color);
    refused(said, BakeStatus::NullPointer, "`f_cos.g`");
    let said = exact_pdf(material.pointer(), &points, wi, null_mut(), null_mut());
    refused(said, BakeStatus::NullPointer, "`pdf`");
    assert!(batch.untouched());
}

#[test]
fn wrong_lengths_are_refused() {
    let material = Material::shipped("conductor");
    let free = material.free();
    let wrong_length = |material: &Material, spoil: &dyn Fn(&mut Call), part: &str| {
        spoiled(material, spoil, BakeStatus::WrongLength, part);
    };
    for wrong in [0, free - 1, free + 1, usize::MAX] {
        let part = format!("is {wrong}, but the material leaves {free} free");
        wrong_length(&material, &|call| call.points.param_count = wrong, &part);
    }
    for wrong in [0, 2, COUNT - 1, COUNT + 1, usize::MAX] {
        let mut batch = Batch::random(COUNT, free, 1);
        let mut columns = batch.columns();
        columns[2].length = wrong;
        let said = batch.call(&columns).sample(material.pointer());
        let part = format!("`params[2]` has {wrong} values, expected 1 or {COUNT}");
        refused(said, BakeStatus::WrongLength, &part);
        assert!(batch.untouched());
    }
    // Without parameters nothing else stops such counts.
    let vase = Material::shipped("vase");
    for huge in [usize::MAX, usize::MAX / 4 + 1, isize::MAX as usize / 4 + 1] {
        wrong_length(&vase, &|call| call.points.count = huge, "`wo.x`: no array");
    }
}

#[test]
fn misaligned_and_overlapping_arrays_are_refused() {
    let material = Material::shipped("vase");
    let argument =
        |spoil: fn(&mut Call), part: &str| spoiled(&material, spoil, BakeStatus::InvalidArgument, part);
    argument(
        |call| call.points.wo.y = call.points.wo.y.wrapping_byte_add(1),
        "`wo.y`: its address",
    );
    argument(
        |call| call.wi.x = call.wi.x.wrapping_byte_add(2),
        "`wi.x`: its address",
    );
    argument(|call| call.wi.z = call.wi.x, "`wi.z`: it overlaps `wi.x`");
    argument(|call| call.weight.r = call.wi.y, "`weight.r`: it overlaps `wi.y`");
    argument(
        |call| call.wi.x = call.points.wo.x.cast_mut(),
        "`wi.x`: it overlaps `wo`",
    );
    // One number in common; half a batch, so that it stays within the same array.
    argument(
        |call| {
            call.points.count = COUNT / 2;
            call.weight.r = call.wi.y.wrapping_add(COUNT / 2 - 1);
        },
        "`weight.r`: it overlaps `wi.y`",
    );
    argument(
        |call| {
            call.points.count = COUNT / 2;
            call.u.u0 = call.u.u0.wrapping_add(COUNT / 2 - 1);
            call.wi.x = call.u.u0.wrapping_sub(COUNT / 2 - 1).cast_mut();
        },
        "`wi.x`: it overlaps `u.u0`",
    );

    // Inputs may be the same, and arrays may follow one another.
    let mut batch = Batch::random(COUNT, 0, 1);
    let mut whole = [UNTOUCHED; 6 * COUNT];
    let mut rest = whole.chunks_exact_mut(COUNT).map(<[f32]>::as_mut_ptr);
    let [x, y, z, r, g, b] = std::array::from_fn(|_| rest.next().expect("six columns"));
    let mut call = batch.call(&[]);
    call.u.u1 = call.u.u0;
    call.wi = BakeDirectionsOut { x, y, z };
    call.weight = BakeColorsOut { r, g, b };
    call.sample(material.pointer()).expect("nothing overlaps");
    batch.u[1] = batch.u[0].clone();
    batch.sample(&material).expect("a valid batch");
    let alone: Vec<f32> = batch.wi.iter().chain(&batch.color).flatten().copied().collect();
    assert_eq!(alone, whole);
}

#[test]
fn no_queries_need_no_arrays() {
    let material = Material::shipped("vase");
    let [wo, wi] = [const {
        BakeDirections {
            x: null(),
            y: null(),
            z: null(),
        }
    }; 2];
    let [x, y, z, r, g, b] = [null_mut(); 6];
    let call = Call {
        points: BakePoints {
            params: null(),
            param_count: 0,
            wo,
            count: 0,
        },
        u: BakeUniforms {
            u0: null(),
            u1: null(),
        },
        wi: BakeDirectionsOut { x, y, z },
        weight: BakeColorsOut { r, g, b },
    };
    let mut counts = BakeInversions {
        queries: 9,
        unconverged: 9,
    };
    let pointer = material.pointer();
    call.sample(pointer).expect("nothing to do");
    eval(pointer, &call.points, wi, call.weight).expect("nothing to do");
    exact_pdf(pointer, &call.points, wi, null_mut(), &mut counts).expect("nothing to do");
    assert_eq!((counts.queries, counts.unconverged), (0, 0));
}

#[test]
fn queries_that_are_not_valid_get_zeros_and_the_normal() {
    let material = Material::shipped("conductor");
    let mut batch = Batch::random(4, material.free(), 1);
    batch.wo[0][0] = f32::NAN;
    batch.wo[2][1] = -0.1;
    batch.params[0][2] = f32::INFINITY;
    batch.sample(&material).expect("such queries are no errors");
    for i in 0..4 {
        let [wi, color] = [&batch.wi, &batch.color].map(|columns| columns.each_ref().map(|c| c[i]));
        let zeros = wi == [0.0, 0.0, 1.0] && color == [0.0; 3];
        assert_eq!(zeros, i < 3, "{i}: {wi:?} {color:?}");
    }
    assert!(!last_error().contains("internal"), "{}", last_error());
}
