//! Tables of independent values under `tests/reference`; the `note` of each says how it was made.

use serde_json::Value;
use std::path::Path;

/// Relative slack beside the standard errors against the tables: a row of theirs holds as few as 100 000
/// walks, so rare bright ones may be missing from its mean and from its standard error alike.
pub const TABLE_SLACK: f64 = 5e-3;

/// Rows of the table `name`.
pub fn table(name: &str) -> Vec<Value> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../tests/reference")
        .join(name);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let table: Value = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    table["rows"].as_array().expect("an array `rows`").clone()
}

/// The number `key` of `row`.
pub fn number(row: &Value, key: &str) -> f64 {
    row[key]
        .as_f64()
        .unwrap_or_else(|| panic!("no number `{key}` in {row}"))
}

/// The `N` numbers of the list `key` of `row`.
pub fn numbers<const N: usize>(row: &Value, key: &str) -> [f64; N] {
    std::array::from_fn(|i| {
        row[key][i]
            .as_f64()
            .unwrap_or_else(|| panic!("no numbers `{key}` in {row}"))
    })
}
