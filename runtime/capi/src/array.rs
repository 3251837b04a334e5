//! From what C passes to what Rust may hold: pointers to references, arrays to slices. What a plain mistake breaks is
//! refused here: null, misaligned, longer than memory, overlapping.

use crate::status::{BakeStatus, Failure};
use std::ffi::{CStr, c_char};
use std::fmt::Display;
use std::ops::Range;

/// The object that `pointer` points to.
///
/// # Errors
/// When it is null or misaligned.
///
/// # Safety
/// Otherwise there is a `T` that nobody changes as long as `'a`.
pub unsafe fn object<'a, T>(name: &str, pointer: *const T) -> Result<&'a T, Failure> {
    addresses(name, pointer, 1)?;
    // SAFETY: neither null nor misaligned; the caller answers for the rest.
    Ok(unsafe { &*pointer })
}

/// The place for a result, to be written through this pointer.
///
/// # Errors
/// When it is null or misaligned.
pub fn place<T>(name: &str, pointer: *mut T) -> Result<*mut T, Failure> {
    addresses(name, pointer, 1)?;
    Ok(pointer)
}

/// The string at `pointer`.
///
/// # Errors
/// When it is null.
///
/// # Safety
/// Otherwise there is a string that ends with NUL and that nobody changes as long as `'a`.
pub unsafe fn text<'a>(name: &str, pointer: *const c_char) -> Result<&'a CStr, Failure> {
    addresses(name, pointer, 1)?;
    // SAFETY: not null; the caller answers for the rest.
    Ok(unsafe { CStr::from_ptr(pointer) })
}

/// The `length` elements from `pointer` on; none whatever the pointer is where `length` is 0.
///
/// # Errors
/// When it is null, misaligned, or longer than memory.
///
/// # Safety
/// Otherwise there are as many that nobody changes as long as `'a`.
pub unsafe fn array<'a, T>(name: impl Display, pointer: *const T, length: usize) -> Result<&'a [T], Failure> {
    if addresses(name, pointer, length)?.is_empty() {
        return Ok(&[]);
    }
    // SAFETY: not null, aligned, and its size fits an isize; the caller answers for the rest.
    Ok(unsafe { std::slice::from_raw_parts(pointer, length) })
}

/// [`array`] for each of `names`.
///
/// # Errors
/// As of [`array`].
///
/// # Safety
/// As of [`array`].
pub unsafe fn inputs<'a, const N: usize>(
    names: [&'static str; N],
    pointers: [*const f32; N],
    count: usize,
) -> Result<[&'a [f32]; N], Failure> {
    let mut arrays = [&[][..]; N];
    for ((slot, name), pointer) in arrays.iter_mut().zip(names).zip(pointers) {
        // SAFETY: as the caller says.
        *slot = unsafe { array(name, pointer, count)? };
    }
    Ok(arrays)
}

/// The arrays of `count` numbers each that a call fills; `taken` are all those that it reads.
///
/// # Errors
/// As of [`array`], and when one overlaps another or one of `taken`.
///
/// # Safety
/// Otherwise there are as many numbers that nobody else touches as long as `'a`.
pub unsafe fn outputs<'a, 'b, const N: usize>(
    names: [&'static str; N],
    pointers: [*mut f32; N],
    count: usize,
    taken: impl Iterator<Item = (&'static str, &'b [f32])> + Clone,
) -> Result<[&'a mut [f32]; N], Failure> {
    let mut ranges: [Range<usize>; N] = [const { 0..0 }; N];
    for i in 0..N {
        let range = addresses(names[i], pointers[i], count)?;
        let read = taken.clone().map(|(name, values)| (name, addresses_of(values)));
        let filled = names.into_iter().zip(ranges[..i].iter().cloned());
        for (name, other) in read.chain(filled) {
            if range.start < other.end && other.start < range.end {
                return Err(Failure::argument(names[i], format!("it overlaps `{name}`")));
            }
        }
        ranges[i] = range;
    }
    Ok(pointers.map(|pointer| match count {
        0 => &mut [][..],
        // SAFETY: not null, aligned, its size fits an isize, and it shares memory with no other slice; the caller answers
        // for the rest.
        _ => unsafe { std::slice::from_raw_parts_mut(pointer, count) },
    }))
}

/// The addresses of `length` elements from `pointer` on; checks what can be checked without reading them.
fn addresses<T>(name: impl Display, pointer: *const T, length: usize) -> Result<Range<usize>, Failure> {
    if length == 0 {
        return Ok(0..0);
    }
    if pointer.is_null() {
        return Err(Failure::new(BakeStatus::NullPointer, format!("`{name}` is null")));
    }
    if !pointer.is_aligned() {
        let reason = format!("its address is no multiple of {}", align_of::<T>());
        return Err(Failure::argument(name, reason));
    }
    let start = pointer.addr();
    let size = length.checked_mul(size_of::<T>());
    let end = size
        .filter(|size| isize::try_from(*size).is_ok())
        .and_then(|size| start.checked_add(size));
    match end {
        Some(end) => Ok(start..end),
        None => {
            let message = format!("`{name}`: no array has {length} elements");
            Err(Failure::new(BakeStatus::WrongLength, message))
        }
    }
}

fn addresses_of(values: &[f32]) -> Range<usize> {
    let Range { start, end } = values.as_ptr_range();
    match values.is_empty() {
        true => 0..0,
        false => start.addr()..end.addr(),
    }
}
