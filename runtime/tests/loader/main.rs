//! Networks that are damaged, of another program or full of lies: one reason each, before anything is built from them.

mod file;
mod folder;
mod headers;
mod specifications;
mod tensors;
