//! The checked-in header is what cbindgen makes of the sources.

use cbindgen::{Builder, Config};
use std::path::Path;

/// Writes the header instead of comparing it.
const WRITE_VARIABLE: &str = "BAKE_WRITE_HEADER";

/// The sources with what C sees, in the order of the header.
const SOURCES: [&str; 4] = ["status", "batch", "material", "query"];

#[test]
fn the_header_is_up_to_date() {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = Config::from_file(package.join("cbindgen.toml")).expect("cbindgen.toml is read");
    let builder = SOURCES
        .iter()
        .fold(Builder::new().with_config(config), |builder, name| {
            builder.with_src(package.join("src").join(name).with_extension("rs"))
        });
    let mut made = Vec::new();
    builder
        .generate()
        .expect("cbindgen reads the sources")
        .write(&mut made);
    let made = String::from_utf8(made).expect("a header is text");
    let path = package.join("../include/bake.h");
    if std::env::var_os(WRITE_VARIABLE).is_some() {
        std::fs::write(&path, made).expect("the header can be written");
        return;
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    let differs = made
        .lines()
        .zip(found.lines())
        .find(|(made, found)| made != found);
    assert!(
        made == found,
        "{} is out of date, first at {differs:?}: {WRITE_VARIABLE}=1 cargo test -p bake-capi header",
        path.display()
    );
}
