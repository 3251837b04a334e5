//! Reading the tensors of our own checkpoint and shard files, with every check.

use safetensors::tensor::{Dtype, SafeTensors};

/// The `length` little-endian numbers of the tensor `name`, each of `BYTES` bytes.
///
/// # Errors
/// What is wrong with the tensor, for the caller to name the file.
pub fn read<T, const BYTES: usize>(
    file: &SafeTensors,
    name: &str,
    dtype: Dtype,
    length: usize,
    number: fn([u8; BYTES]) -> T,
) -> Result<Vec<T>, String> {
    let view = file
        .tensor(name)
        .map_err(|_| format!("tensor `{name}` is missing"))?;
    let (numbers, rest) = view.data().as_chunks::<BYTES>();
    if view.dtype() != dtype || numbers.len() != length || !rest.is_empty() {
        return Err(format!("tensor `{name}` has the wrong type or size"));
    }
    Ok(numbers.iter().map(|bytes| number(*bytes)).collect())
}
