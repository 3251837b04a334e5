//! The networks that ship, and their cards.

use bake_train::card::Card;
use std::path::{Path, PathBuf};

/// The folder of the networks called `name` under `scenes/materials`; that of all where the name is empty.
pub fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("scenes/materials")
        .join(name)
}

/// The card of the networks called `name`.
pub fn card(name: &str) -> Card {
    let path = folder(name).join("card.json");
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}
