//! The safetensors files of this crate, with every check of what they say about themselves.

use safetensors::tensor::{Dtype, Metadata};

/// Longest header, bytes: what it becomes in memory is up to 24 times as long. Those of networks stay below 4 kB; the rest is
/// for descriptions of imported tables.
const HEADER_MAX: usize = 1 << 17;

/// Bytes of the length that the file begins with.
const LENGTH_BYTES: usize = 8;

/// A whole file: its header agrees with its length, and tensors follow each other without gaps.
pub struct Archive<'a> {
    header: Metadata,
    data: &'a [u8],
}

/// One tensor of an [`Archive`].
pub struct Tensor<'a> {
    /// Type of its elements.
    pub dtype: Dtype,
    /// Its product is the number of elements in `data`.
    pub shape: &'a [usize],
    /// Its elements, little-endian.
    pub data: &'a [u8],
}

impl<'a> Archive<'a> {
    /// Opens the content of a file.
    ///
    /// # Errors
    /// Why it is not a whole one, for the caller to name the file.
    pub fn open(bytes: &'a [u8]) -> Result<Archive<'a>, String> {
        let broken = |reason: &str| format!("not a whole safetensors file ({reason})");
        let (length, rest) = bytes
            .split_first_chunk::<LENGTH_BYTES>()
            .ok_or_else(|| broken(&format!("it has {} bytes", bytes.len())))?;
        let length = u64::from_le_bytes(*length);
        if length > rest.len() as u64 {
            let reason = format!("its header should have {length} bytes, but {} follow", rest.len());
            return Err(broken(&reason));
        }
        if length > HEADER_MAX as u64 {
            return Err(format!("its header has {length} bytes, more than {HEADER_MAX}"));
        }
        let (header, data) = rest.split_at(length as usize);
        // safetensors' own reader adds the lengths of header and data, which may be any, without a check.
        let header: Metadata = serde_json::from_slice(header).map_err(|e| broken(&e.to_string()))?;
        match header.data_len() == data.len() {
            true => Ok(Archive { header, data }),
            false => {
                let reason = format!(
                    "its tensors have {} bytes, but {} follow",
                    header.data_len(),
                    data.len()
                );
                Err(broken(&reason))
            }
        }
    }

    /// The text under `key` in `__metadata__`.
    pub fn text(&self, key: &str) -> Option<&str> {
        Some(self.header.metadata().as_ref()?.get(key)?)
    }

    /// Bytes of all tensors.
    pub fn data_len(&self) -> usize {
        self.data.len()
    }

    /// The tensor called `name`.
    pub fn tensor(&self, name: &str) -> Option<Tensor<'_>> {
        let info = self.header.info(name)?;
        let (start, end) = info.data_offsets;
        Some(Tensor {
            dtype: info.dtype,
            shape: &info.shape,
            data: &self.data[start..end],
        })
    }
}
