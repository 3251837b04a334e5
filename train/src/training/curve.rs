//! Learning curves: what a run's loss and errors were, step by step, in a CSV file beside its checkpoint.
//!
//! The file is written whole or not at all, before the checkpoint is; rows that a resumed run will make again
//! are dropped when it starts. So an interrupted run has the same rows as one in a single piece, apart from the
//! seconds.

use crate::error::{Error, Result};
use bake_runtime::network::write_atomically;
use std::path::Path;

/// Names of the columns that every curve has.
const COLUMNS: [&str; 4] = ["step", "seconds", "learning_rate", "training_loss"];

/// One line of a curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Steps taken.
    pub step: u64,
    /// Seconds of training up to here, over all pieces of the run, without the measuring of errors.
    pub seconds: f64,
    /// Learning rate of the last step.
    pub learning_rate: f64,
    /// Mean loss of the steps since the row before.
    pub loss: f64,
    /// Errors on held-out data in the order of the names, or empty where they were not measured.
    pub errors: Vec<f64>,
}

/// The rows of one run.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Names of the held-out errors, each fit for the header of a CSV file.
    pub names: Vec<String>,
    /// Rows, by step.
    pub rows: Vec<Row>,
}

impl Curve {
    /// An empty curve with held-out errors of the given names.
    pub fn new(names: &[&str]) -> Curve {
        Curve {
            names: names.iter().map(ToString::to_string).collect(),
            rows: Vec::new(),
        }
    }

    /// Name of the file of a stage's curve.
    pub fn file_name(stage: &str) -> String {
        format!("train-{stage}.csv")
    }

    /// The curve in the file `path`, with the held-out errors that it has.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] when the file cannot be read or is not a curve.
    pub fn read(path: &Path) -> Result<Curve> {
        let text = std::fs::read_to_string(path).map_err(|e| broken(path, e.to_string()))?;
        let mut lines = text.lines();
        let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
        let Some(names) = header.strip_prefix(&COLUMNS[..]) else {
            return Err(other_columns(path, &header.join(","), &[]));
        };
        let mut curve = Curve::new(names);
        for (i, line) in lines.enumerate() {
            // The header is line 1.
            let row = curve.parse(line).ok_or_else(|| {
                let reason = format!("line {} is not a row of a learning curve: `{line}`", i + 2);
                broken(path, reason)
            })?;
            curve.rows.push(row);
        }
        Ok(curve)
    }

    /// The curve in the file `path` up to `step`; empty when there is no file.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] when the file is not a curve with these `names`.
    pub fn resume(path: &Path, names: &[&str], step: u64) -> Result<Curve> {
        if step == 0 || !path.exists() {
            return Ok(Curve::new(names));
        }
        let mut curve = Curve::read(path)?;
        if curve.names != names {
            return Err(other_columns(path, &curve.header(), names));
        }
        curve.rows.retain(|row| row.step <= step);
        Ok(curve)
    }

    /// Writes the curve to `path`, whole or not at all.
    ///
    /// # Errors
    /// An I/O error naming the file.
    pub fn save(&self, path: &Path) -> Result<()> {
        let mut text = self.header() + "\n";
        for row in &self.rows {
            // Rust prints the shortest digits that read back as the same number.
            let mut fields = vec![
                row.step.to_string(),
                format!("{:.3}", row.seconds),
                format!("{:e}", row.learning_rate),
                format!("{:e}", row.loss),
            ];
            match row.errors.is_empty() {
                true => fields.resize(COLUMNS.len() + self.names.len(), String::new()),
                false => fields.extend(row.errors.iter().map(|e| format!("{e:e}"))),
            }
            text += &(fields.join(",") + "\n");
        }
        Ok(write_atomically(path, text.as_bytes())?)
    }

    fn header(&self) -> String {
        let names = self.names.iter().map(String::as_str);
        COLUMNS.into_iter().chain(names).collect::<Vec<_>>().join(",")
    }

    fn parse(&self, line: &str) -> Option<Row> {
        let fields: Vec<&str> = line.split(',').collect();
        if fields.len() != COLUMNS.len() + self.names.len() {
            return None;
        }
        let number = |i: usize| fields[i].parse::<f64>().ok();
        let errors = &fields[COLUMNS.len()..];
        let errors = match errors.iter().all(|e| e.is_empty()) {
            true => Vec::new(),
            false => errors.iter().map(|e| e.parse().ok()).collect::<Option<_>>()?,
        };
        Some(Row {
            step: fields[0].parse().ok()?,
            seconds: number(1)?,
            learning_rate: number(2)?,
            loss: number(3)?,
            errors,
        })
    }
}

fn broken(path: &Path, reason: String) -> Error {
    Error::Checkpoint {
        path: path.into(),
        reason,
    }
}

/// The file `path` has the columns `found` instead of those of a curve with `names`.
fn other_columns(path: &Path, found: &str, names: &[&str]) -> Error {
    let header = Curve::new(names).header();
    broken(path, format!("its columns are `{found}` instead of `{header}`"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve() -> Curve {
        let row = |step: u64, errors: Vec<f64>| Row {
            step,
            seconds: 0.125 * step as f64,
            learning_rate: 0.1 / step as f64,
            loss: 1.0 / 3.0 / step as f64,
            errors,
        };
        Curve {
            rows: vec![row(100, vec![]), row(200, vec![0.1, 1e-9]), row(300, vec![])],
            ..Curve::new(&["binning_l1", "eval_rel_l1"])
        }
    }

    #[test]
    fn rows_come_back_exactly_up_to_the_step_of_the_checkpoint() {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        let path = folder.path().join("curve.csv");
        let (mut expected, names) = (curve(), ["binning_l1", "eval_rel_l1"]);
        expected.save(&path).expect("the folder is writable");
        assert_eq!(Curve::resume(&path, &names, 300).expect("just written"), expected);
        assert_eq!(Curve::read(&path).expect("just written"), expected);
        expected.rows.truncate(2);
        assert_eq!(Curve::resume(&path, &names, 299).expect("just written"), expected);
        assert_eq!(
            Curve::resume(&path, &names, 0).expect("just written"),
            Curve::new(&names)
        );
        let nowhere = folder.path().join("none.csv");
        assert_eq!(
            Curve::resume(&nowhere, &names, 9).expect("no file"),
            Curve::new(&names)
        );
    }

    #[test]
    fn the_file_is_a_table_with_a_header() {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        let path = folder.path().join("curve.csv");
        curve().save(&path).expect("the folder is writable");
        let text = std::fs::read_to_string(&path).expect("just written");
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[0],
            "step,seconds,learning_rate,training_loss,binning_l1,eval_rel_l1"
        );
        assert_eq!(lines[1], "100,12.500,1e-3,3.333333333333333e-3,,");
        assert!(lines[2].ends_with(",1e-1,1e-9"), "{}", lines[2]);
        assert_eq!(lines.len(), 4);
    }

    #[test]
    fn a_file_that_is_no_such_curve_is_refused() {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        let path = folder.path().join("curve.csv");
        let header = "step,seconds,learning_rate,training_loss";
        for (text, words) in [
            ("", "its columns are ``"),
            ("step,loss\n", "its columns are `step,loss`"),
            (&format!("{header}\n100,1,2\n"), "line 2 is not a row"),
            (
                &format!("{header}\n100,1,2,3\n200,1,2,x\n"),
                "line 3 is not a row",
            ),
        ] {
            std::fs::write(&path, text).expect("the folder is writable");
            let error = Curve::resume(&path, &[], 500)
                .expect_err("not a curve")
                .to_string();
            assert!(error.contains(words), "{error}");
        }
        curve().save(&path).expect("the folder is writable");
        let error = Curve::resume(&path, &[], 500).expect_err("other names");
        let words = format!("its columns are `{header},binning_l1,eval_rel_l1` instead of `{header}`");
        assert!(error.to_string().contains(&words), "{error}");
    }
}
