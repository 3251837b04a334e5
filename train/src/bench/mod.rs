//! Speed of what others are compared with, beside the error that it buys.

pub mod peak;
pub mod reference;
