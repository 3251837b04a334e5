//! The C interface: its header, programs in C that use it, its answers, and what it refuses.

mod compiler;
mod header;
mod materials;
mod mistakes;
mod programs;
mod support;
mod threads;
