//! What the stages of a bake took, in a file beside their checkpoints: an interrupted bake that goes on has cost what all its
//! pieces cost.

use crate::error::{Error, Result};
use bake_runtime::network::write_atomically;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Name of the file.
const FILE: &str = "seconds.json";

/// Seconds of wall time by stage, over all pieces of a bake.
pub struct Clock {
    path: PathBuf,
    seconds: BTreeMap<String, f64>,
}

impl Clock {
    /// The clock of the bake in `folder`; at zero where there is none.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] for a file that cannot be read.
    pub fn open(folder: &Path) -> Result<Clock> {
        let path = folder.join(FILE);
        let mut seconds = BTreeMap::new();
        if path.exists() {
            let broken = |reason: String| Error::Checkpoint {
                path: path.clone(),
                reason,
            };
            let text = std::fs::read(&path).map_err(|e| broken(e.to_string()))?;
            seconds = serde_json::from_slice(&text).map_err(|e| broken(e.to_string()))?;
        }
        Ok(Clock { path, seconds })
    }

    /// Does `work`, the stage `name` or a piece of it, and writes down what it took, whether it succeeds or not.
    ///
    /// # Errors
    /// Those of `work`, and an I/O error naming the file.
    pub fn time<T>(&mut self, name: &str, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let started = Instant::now();
        let done = work();
        *self.seconds.entry(name.into()).or_default() += started.elapsed().as_secs_f64();
        let text = serde_json::to_vec_pretty(&self.seconds)
            .unwrap_or_else(|_| unreachable!("names and numbers can be written"));
        let written = write_atomically(&self.path, &text);
        let done = done?;
        written?;
        Ok(done)
    }

    /// Seconds of all stages of `names` together.
    pub fn seconds(&self, names: &[&str]) -> f64 {
        names.iter().filter_map(|name| self.seconds.get(*name)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn pieces_add_up_even_if_one_fails() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let nap = Duration::from_millis(20);
        let failed: Result<()> = Clock::open(folder.path()).expect("empty").time("maps", || {
            std::thread::sleep(nap);
            Err(Error::Interrupted)
        });
        assert!(matches!(failed, Err(Error::Interrupted)));
        let mut clock = Clock::open(folder.path()).expect("just written");
        let first = clock.seconds(&["maps"]);
        assert!(first >= nap.as_secs_f64());
        clock
            .time("maps", || {
                std::thread::sleep(nap);
                Ok(())
            })
            .expect("nothing fails");
        clock.time("eval", || Ok(())).expect("nothing fails");
        let all = Clock::open(folder.path()).expect("just written");
        assert!(all.seconds(&["maps"]) >= first + nap.as_secs_f64());
        assert!(all.seconds(&["maps", "eval"]) >= all.seconds(&["maps"]));
        assert_eq!(all.seconds(&["pdf"]), 0.0);
        std::fs::write(folder.path().join(FILE), "no clock").expect("can be written");
        assert!(matches!(
            Clock::open(folder.path()),
            Err(Error::Checkpoint { .. })
        ));
    }
}
