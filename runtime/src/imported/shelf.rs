//! The tables used last, kept in memory: rows of queries and tiles of pictures bind the same file again and again.

use super::{Imported, ImportedTable};
use crate::error::{Error, Result};
use crate::real::Real;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::SystemTime;

/// Bindings kept; what is used least falls off.
const KEPT: usize = 8;

/// The bindings used last, the latest first.
static SHELF: Mutex<Vec<Kept>> = Mutex::new(Vec::new());

/// A binding with what it was made from.
struct Kept {
    path: PathBuf,
    /// Length and time of the last change: another file of the same name is read anew.
    stamp: (u64, Option<SystemTime>),
    params: Vec<Real>,
    imported: Imported,
}

impl ImportedTable {
    /// Binds the table in the file `path`, its parameters given by `param`, which is asked for each by name and told
    /// the range that is tabulated.
    ///
    /// The few files and bindings used last are kept, so that neither is read nor blended again while it lasts.
    ///
    /// # Errors
    /// As [`ImportedTable::load`] and [`ImportedTable::bind`], and whatever `param` returns.
    pub fn bind_file(path: &Path, param: impl Fn(&str, [Real; 2]) -> Result<Real>) -> Result<Imported> {
        let metadata = std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
        let stamp = (metadata.len(), metadata.modified().ok());
        // A thread that waits here would have to read the same file; a poisoned shelf is still whole.
        let mut shelf = SHELF.lock().unwrap_or_else(|e| e.into_inner());
        let known = shelf.iter().find(|k| k.path == path && k.stamp == stamp);
        let table = match known {
            Some(kept) => kept.imported.table().clone(),
            None => Arc::new(ImportedTable::load(path)?),
        };
        let params: Vec<Real> = table
            .param_names()
            .iter()
            .zip(table.ranges())
            .map(|(name, range)| param(name, range))
            .collect::<Result<_>>()?;
        let same = |k: &Kept| k.path == path && k.stamp == stamp && k.params == params;
        let kept = match shelf.iter().position(same) {
            Some(i) => shelf.remove(i),
            None => Kept {
                path: path.into(),
                stamp,
                imported: table.bind(&params)?,
                params,
            },
        };
        let imported = kept.imported.clone();
        shelf.truncate(KEPT - 1);
        shelf.insert(0, kept);
        Ok(imported)
    }
}
