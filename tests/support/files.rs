//! Sets of files by name, compared byte by byte.

use std::collections::BTreeMap;

/// Files with what is in them.
pub type Files = BTreeMap<String, Vec<u8>>;

/// Asserts that both are the same, and says where they first differ.
pub fn assert_same(expected: &Files, found: &Files) {
    assert!(
        expected.keys().eq(found.keys()),
        "{:?} and {:?}",
        expected.keys(),
        found.keys()
    );
    for (name, bytes) in expected {
        let first = bytes.iter().zip(&found[name]).position(|(a, b)| a != b);
        assert!(*bytes == found[name], "{name} differs, first at byte {first:?}");
    }
}
