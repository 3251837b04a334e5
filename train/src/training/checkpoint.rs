//! Checkpoints of a training run: the whole state of its optimiser, and what run it belongs to.
//!
//! Tensors: `value`, `first`, `second` and `slow` in f32 as [`Optimiser`] has them, `step` in u64, `loss_sum` and
//! `seconds` in f64. The metadata holds what the run depends on, as JSON, so that a checkpoint of another run is
//! refused with the difference named.

use crate::error::{Error, Result};
use crate::optimiser::Optimiser;
use crate::tensors;
use bake_runtime::network::write_atomically;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::collections::HashMap;
use std::path::Path;

/// Version of the layout, and of whatever the numbers depend on without the identity saying so.
const FORMAT: u32 = 2;
/// Metadata key of the identity.
const IDENTITY_KEY: &str = "bake.checkpoint";
/// Name of the version within the identity.
const FORMAT_NAME: &str = "format";
/// Longer texts are shown from a little before their first difference on, and no further than this.
const EXCERPT_CHARS: usize = 60;
/// Characters shown before the difference.
const EXCERPT_LEAD: usize = 20;

/// What a run depends on: (name, value) pairs that are compared one by one.
#[derive(Clone, Debug, PartialEq)]
pub struct Identity(Vec<(String, String)>);

/// All that changes as a run goes on.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Parameters and what the optimiser remembers.
    pub optimiser: Optimiser,
    /// Sum of the losses since the last row of the learning curve.
    pub loss_sum: f64,
    /// Seconds spent.
    pub seconds: f64,
}

impl Identity {
    /// The pairs `named`, and the version of the format.
    pub fn new(named: &[(&str, String)]) -> Identity {
        let format = (FORMAT_NAME, FORMAT.to_string());
        let all = std::iter::once(&format).chain(named);
        Identity(
            all.map(|(name, value)| (name.to_string(), value.clone()))
                .collect(),
        )
    }

    fn get(&self, name: &str) -> Option<&str> {
        let pair = self.0.iter().find(|(own, _)| own == name);
        pair.map(|(_, value)| value.as_str())
    }

    /// What in `found` is not as here, in words; empty when nothing is.
    fn differences(&self, found: &Identity) -> Vec<String> {
        let difference = |(name, own): &(String, String)| match found.get(name) {
            Some(other) if other == own => None,
            Some(other) => {
                let (other, own) = excerpts(other, own);
                Some(format!("{name} {other} instead of {own}"))
            }
            None => Some(format!("no {name}")),
        };
        self.0.iter().filter_map(difference).collect()
    }
}

/// The parts of two texts where they begin to differ.
fn excerpts(a: &str, b: &str) -> (String, String) {
    let common = a.chars().zip(b.chars()).take_while(|(x, y)| x == y).count();
    let cut = |text: &str| {
        let count = text.chars().count();
        if count <= EXCERPT_CHARS {
            return text.to_string();
        }
        let start = common.saturating_sub(EXCERPT_LEAD);
        let part: String = text.chars().skip(start).take(EXCERPT_CHARS).collect();
        let lead = if start > 0 { "…" } else { "" };
        let tail = if start + EXCERPT_CHARS < count { "…" } else { "" };
        format!("{lead}{part}{tail}")
    };
    (cut(a), cut(b))
}

/// Writes `state` to `path`, whole or not at all.
///
/// # Errors
/// An I/O error naming the file.
pub fn save(path: &Path, identity: &Identity, state: &State) -> Result<()> {
    let o = &state.optimiser;
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let tensors = [
        ("value", Dtype::F32, o.value.len(), floats(&o.value)),
        ("first", Dtype::F32, o.first.len(), floats(&o.first)),
        ("second", Dtype::F32, o.second.len(), floats(&o.second)),
        ("slow", Dtype::F32, o.slow.len(), floats(&o.slow)),
        ("step", Dtype::U64, 1, o.step.to_le_bytes().to_vec()),
        ("loss_sum", Dtype::F64, 1, state.loss_sum.to_le_bytes().to_vec()),
        ("seconds", Dtype::F64, 1, state.seconds.to_le_bytes().to_vec()),
    ];
    let views = tensors.iter().map(|(name, dtype, length, data)| {
        let view = TensorView::new(*dtype, vec![*length], data);
        (*name, view.expect("shape matches data by construction"))
    });
    let text = serde_json::to_string(&identity.0).expect("pairs of texts are JSON");
    let metadata = HashMap::from([(IDENTITY_KEY.to_string(), text)]);
    let bytes =
        safetensors::serialize(views, Some(metadata)).expect("tensor names are unique by construction");
    Ok(write_atomically(path, &bytes)?)
}

/// Brings `state` to what the checkpoint `path` holds; false when there is none.
///
/// # Errors
/// [`Error::Checkpoint`] when it is damaged or belongs to another run than that of `identity`; `state` is as
/// before then.
pub fn load(path: &Path, identity: &Identity, state: &mut State) -> Result<bool> {
    if !path.exists() {
        return Ok(false);
    }
    let broken = |reason: String| Error::Checkpoint {
        path: path.into(),
        reason,
    };
    let bytes = std::fs::read(path).map_err(|e| broken(e.to_string()))?;
    *state = parse(&bytes, identity, state).map_err(broken)?;
    Ok(true)
}

/// The state in the file `bytes`, of the same size as `state`, or what is wrong with it.
fn parse(bytes: &[u8], identity: &Identity, state: &State) -> std::result::Result<State, String> {
    let unfinished = |e: safetensors::SafeTensorError| format!("not a whole checkpoint ({e})");
    let file = SafeTensors::deserialize(bytes).map_err(unfinished)?;
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(unfinished)?;
    let text = header.metadata().as_ref().and_then(|m| m.get(IDENTITY_KEY));
    let text = text.ok_or("it is not a checkpoint of a training run")?;
    let found: Option<Identity> = serde_json::from_str(text).ok().map(Identity);
    let version = found.as_ref().and_then(|f| f.get(FORMAT_NAME));
    if version.and_then(|v| v.parse().ok()) != Some(FORMAT) {
        let version = version.unwrap_or("1");
        return Err(format!(
            "it was written by another version of this program: format {version} instead of {FORMAT}"
        ));
    }
    let differences = found.map_or(Vec::new(), |found| identity.differences(&found));
    if !differences.is_empty() {
        let differences = differences.join("; ");
        return Err(format!("it belongs to another training run: {differences}"));
    }
    let floats = |name: &str, like: &[f32]| -> std::result::Result<Vec<f32>, String> {
        tensors::read(&file, name, Dtype::F32, like.len(), f32::from_le_bytes)
    };
    let number = |name: &str| tensors::read(&file, name, Dtype::F64, 1, f64::from_le_bytes);
    let own = &state.optimiser;
    let optimiser = Optimiser {
        value: floats("value", &own.value)?,
        first: floats("first", &own.first)?,
        second: floats("second", &own.second)?,
        slow: floats("slow", &own.slow)?,
        step: tensors::read(&file, "step", Dtype::U64, 1, u64::from_le_bytes)?[0],
        ..own.clone()
    };
    if !optimiser.is_finite() {
        return Err("it holds values that are not finite".into());
    }
    Ok(State {
        optimiser,
        loss_sum: number("loss_sum")?[0],
        seconds: number("seconds")?[0],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optimiser::{Rule, layout};

    fn state() -> State {
        let blocks = layout(&[(2, 3), (3, 1)]);
        let count = blocks.last().expect("two layers").range().end;
        let value = (0..count).map(|i| i as f32).collect();
        State {
            optimiser: Optimiser::new(Rule::Ranger, blocks, value),
            loss_sum: 0.1,
            seconds: 2.5,
        }
    }

    fn identity() -> Identity {
        Identity::new(&[("seed", "1".into())])
    }

    /// The refusal of the file `bytes`.
    fn refusal(bytes: &[u8]) -> String {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        let path = folder.path().join("checkpoint.safetensors");
        std::fs::write(&path, bytes).expect("the folder is writable");
        let (mut found, before) = (state(), state());
        let error = load(&path, &identity(), &mut found).expect_err("not such a checkpoint");
        assert_eq!(found, before);
        error.to_string()
    }

    fn saved(state: &State) -> Vec<u8> {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        let path = folder.path().join("checkpoint.safetensors");
        save(&path, &identity(), state).expect("the folder is writable");
        std::fs::read(&path).expect("just written")
    }

    /// A safetensors file with nothing but `text` under the key of the identity.
    fn headed(text: &str) -> Vec<u8> {
        let metadata = HashMap::from([(IDENTITY_KEY.to_string(), text.to_string())]);
        let none: [(&str, TensorView); 0] = [];
        safetensors::serialize(none, Some(metadata)).expect("no tensors")
    }

    #[test]
    fn a_state_comes_back_whole() {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        let path = folder.path().join("checkpoint.safetensors");
        let (mut expected, mut found) = (state(), state());
        assert!(!load(&path, &identity(), &mut found).expect("no file"));
        expected.optimiser.descend(&[0.5; 13], 0.1);
        expected.loss_sum = 1.0 / 3.0;
        save(&path, &identity(), &expected).expect("the folder is writable");
        assert!(load(&path, &identity(), &mut found).expect("just written"));
        assert_eq!(found, expected);
    }

    #[test]
    fn damaged_and_foreign_files_are_refused() {
        let whole = saved(&state());
        assert!(refusal(&whole[..whole.len() / 2]).contains("not a whole checkpoint"));
        assert!(refusal(b"").contains("not a whole checkpoint"));
        let mut spoilt = state();
        spoilt.optimiser.second[3] = f32::NAN;
        assert!(refusal(&saved(&spoilt)).contains("values that are not finite"));
        let mut small = state();
        small.optimiser.first.pop();
        assert!(refusal(&saved(&small)).contains("tensor `first` has the wrong type or size"));
        let none: [(&str, TensorView); 0] = [];
        let bare = safetensors::serialize(none, None).expect("no tensors");
        assert!(refusal(&bare).contains("it is not a checkpoint of a training run"));
    }

    #[test]
    fn other_versions_are_refused_by_their_number() {
        let words = "written by another version of this program: format";
        let first = refusal(&headed("Plan { stage: \"sample\", steps: 10000 }"));
        assert!(
            first.contains(&format!("{words} 1 instead of {FORMAT}")),
            "{first}"
        );
        let next = refusal(&headed(&format!(
            "[[\"format\",\"{}\"],[\"seed\",\"1\"]]",
            FORMAT + 1
        )));
        assert!(
            next.contains(&format!("{words} {} instead of {FORMAT}", FORMAT + 1)),
            "{next}"
        );
        // One that lacks what this version compares.
        let less = refusal(&headed(&format!("[[\"format\",\"{FORMAT}\"]]")));
        assert!(less.contains("another training run: no seed"), "{less}");
    }
}
