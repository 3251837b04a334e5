//! How calls end: a status, the message behind it, and the version of all of this.

use bake_runtime::Error;
use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char, c_int};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Version of this interface. It changes whenever a program built with an older header would not run any more.
pub const BAKE_ABI_VERSION: u32 = 1;

/// How a call ended.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BakeStatus {
    /// It did what it says.
    Ok = 0,
    /// A pointer is null that must not be.
    NullPointer = 1,
    /// The number of parameters or the length of a column is not what material and batch ask for.
    WrongLength = 2,
    /// An argument makes no sense: a name, an index, a number that is not finite, an array that is misaligned or overlaps
    /// another one.
    InvalidArgument = 3,
    /// A file could not be read.
    Io = 4,
    /// A file is not a network that this library can run, or not one of the same material as the others.
    Network = 5,
    /// This processor lacks the SIMD tier.
    Tier = 6,
    /// An error of this library.
    Internal = 7,
}

impl BakeStatus {
    const ALL: [(BakeStatus, &CStr); 8] = [
        (BakeStatus::Ok, c"ok"),
        (BakeStatus::NullPointer, c"null pointer"),
        (BakeStatus::WrongLength, c"wrong length"),
        (BakeStatus::InvalidArgument, c"invalid argument"),
        (BakeStatus::Io, c"file not readable"),
        (BakeStatus::Network, c"not a network"),
        (BakeStatus::Tier, c"tier not available"),
        (BakeStatus::Internal, c"internal error"),
    ];
}

/// Version of the interface that the library has: a program asks for it once and goes on if it is BAKE_ABI_VERSION.
#[unsafe(no_mangle)]
pub extern "C" fn bake_abi_version() -> u32 {
    BAKE_ABI_VERSION
}

/// The name of a status in English, e.g. "wrong length"; "unknown status" for any other number. Never null, lives forever.
#[unsafe(no_mangle)]
pub extern "C" fn bake_status_name(status: c_int) -> *const c_char {
    let known = BakeStatus::ALL
        .iter()
        .find(|(known, _)| *known as c_int == status);
    known.map_or(c"unknown status", |(_, name)| name).as_ptr()
}

/// What was wrong with the calling thread's last call that failed, in one line that names the argument or the file; empty
/// before the first. Never null; valid until the thread's next call that fails, or its end.
#[unsafe(no_mangle)]
pub extern "C" fn bake_last_error() -> *const c_char {
    // A thread that is ending may have lost its message already.
    LAST_ERROR
        .try_with(|last| last.borrow().as_ptr())
        .unwrap_or(c"".as_ptr())
}

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

/// Why a call failed.
#[derive(Debug)]
pub struct Failure {
    status: BakeStatus,
    message: String,
}

impl Failure {
    /// A failure with `status`, in words.
    pub fn new(status: BakeStatus, message: impl Into<String>) -> Failure {
        let message = message.into();
        Failure { status, message }
    }

    /// An argument that makes no sense.
    pub fn argument(name: impl std::fmt::Display, reason: impl std::fmt::Display) -> Failure {
        Failure::new(BakeStatus::InvalidArgument, format!("`{name}`: {reason}"))
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Failure {
        let status = match error {
            Error::Io { .. } => BakeStatus::Io,
            Error::Network { .. } => BakeStatus::Network,
            Error::Tier(_) => BakeStatus::Tier,
            Error::BatchLength { .. } => BakeStatus::WrongLength,
            Error::Query { .. } | Error::Parameter { .. } => BakeStatus::InvalidArgument,
            // Nothing that this library calls reads tables or rows, or runs onnxruntime.
            Error::Import { .. } | Error::Json(_) | Error::Onnxruntime(_) => BakeStatus::Internal,
        };
        Failure::new(status, error.to_string())
    }
}

/// Does the work of one call, and keeps the message where it fails. No panic passes.
pub fn answer(work: impl FnOnce() -> Result<(), Failure>) -> BakeStatus {
    // What a panic leaves behind is dropped or, in the thread's buffers, written anew by the next query.
    let failure = match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => return BakeStatus::Ok,
        Ok(Err(failure)) => failure,
        Err(panic) => Failure::new(BakeStatus::Internal, words(&*panic)),
    };
    let line = failure.message.replace(['\0', '\n'], " ");
    // Without NULs it is always one; a thread that is ending keeps no message.
    let message = CString::new(line).unwrap_or_default();
    let _ = LAST_ERROR.try_with(|last| *last.borrow_mut() = message);
    failure.status
}

/// What a panic said.
fn words(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or(panic.downcast_ref::<&str>().copied());
    format!("internal error: {}", text.unwrap_or("no message"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn last_error() -> String {
        let message = bake_last_error();
        // SAFETY: it is never null, and nothing failed on this thread since.
        let message = unsafe { CStr::from_ptr(message) };
        message.to_string_lossy().into_owned()
    }

    #[test]
    fn panics_become_a_status_and_the_library_goes_on() {
        let status = answer(|| panic!("cell {} is\nempty", 3));
        assert_eq!(status, BakeStatus::Internal);
        assert_eq!(last_error(), "internal error: cell 3 is empty");
        assert_eq!(answer(|| panic!("plain")), BakeStatus::Internal);
        assert_eq!(last_error(), "internal error: plain");
        assert_eq!(answer(|| Ok(())), BakeStatus::Ok);
        assert_eq!(last_error(), "internal error: plain", "success keeps the message");
    }

    #[test]
    fn messages_are_one_line_without_nul() {
        let status = answer(|| Err(Failure::argument("a\0b", "c")));
        assert_eq!(status, BakeStatus::InvalidArgument);
        assert_eq!(last_error(), "`a b`: c");
    }

    #[test]
    fn numbers_and_names_of_statuses_stay() {
        for (number, (status, name)) in BakeStatus::ALL.iter().enumerate() {
            assert_eq!(*status as usize, number);
            // SAFETY: names are static.
            let found = unsafe { CStr::from_ptr(bake_status_name(number as c_int)) };
            assert_eq!(found, *name);
        }
        for unknown in [-1, BakeStatus::ALL.len() as c_int] {
            // SAFETY: names are static.
            let found = unsafe { CStr::from_ptr(bake_status_name(unknown)) };
            assert_eq!(found, c"unknown status");
        }
    }
}
