//! A row of JSON again, with the keys of its answer.

use super::Answer;
use crate::error::{Error, Result};
use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use serde_json::value::RawValue;
use std::fmt;

/// The text `line`, which [`super::Row::parse`] accepts, with the keys of `answer` added. What the row asks for by a
/// key of the answer's name (`"albedo": true`) gives its place to the answer.
///
/// # Errors
/// [`Error::Json`] for a line that is no object after all.
pub fn answered(line: &str, answer: &Answer) -> Result<String> {
    let json = |error: serde_json::Error| Error::Json(error.to_string());
    let added = serde_json::to_string(answer).map_err(json)?;
    let Answer::Albedo { .. } = answer else {
        // Two objects that are not empty: the end of one and the start of the other go.
        let open = line.trim().strip_suffix('}');
        let open = open.ok_or_else(|| Error::Json(format!("{line} is no object")))?;
        return Ok(format!("{}, {}", open.trim_end(), &added[1..]));
    };
    let Entries(entries) = serde_json::from_str(line).map_err(json)?;
    let mut text = String::from("{");
    for (key, value) in entries.iter().filter(|(key, _)| key != "albedo") {
        let key = serde_json::to_string(key).map_err(json)?;
        text.push_str(&format!("{key}: {value}, "));
    }
    text.push_str(&added[1..]);
    Ok(text)
}

/// The entries of an object in order, each value as it is written.
struct Entries<'a>(Vec<(String, &'a RawValue)>);

impl<'de: 'a, 'a> Deserialize<'de> for Entries<'a> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct InOrder;
        impl<'de> Visitor<'de> for InOrder {
            type Value = Vec<(String, &'de RawValue)>;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<Self::Value, A::Error> {
                let mut entries = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    entries.push(entry);
                }
                Ok(entries)
            }
        }
        deserializer.deserialize_map(InOrder).map(Entries)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALBEDO: Answer = Answer::Albedo {
        albedo: [0.25, 0.5, 1.0],
        se: [0.0; 3],
    };

    #[test]
    fn the_row_stands_first_as_it_was_written() {
        let eval = Answer::Eval {
            f_cos: [0.25, 0.5, 1.0],
            se: [0.0; 3],
            pdf: 1e-30,
        };
        let line = r#" {"wo": [4.50e1, 0], "id": 12345678901234567890, "wi": [30,180] } "#;
        assert_eq!(
            answered(line, &eval).expect("an object"),
            r#"{"wo": [4.50e1, 0], "id": 12345678901234567890, "wi": [30,180], "f_cos":[0.25,0.5,1.0],"se":[0.0,0.0,0.0],"pdf":1e-30}"#
        );
    }

    #[test]
    fn an_albedo_takes_the_place_of_the_question() {
        let line = r#"{"albedo":true,"params":{"albedo":[1,1,1]},"id":"\"albedo\"","wo":[45,0]}"#;
        assert_eq!(
            answered(line, &ALBEDO).expect("an object"),
            r#"{"params": {"albedo":[1,1,1]}, "id": "\"albedo\"", "wo": [45,0], "albedo":[0.25,0.5,1.0],"se":[0.0,0.0,0.0]}"#
        );
        assert!(answered("[1]", &ALBEDO).is_err());
    }
}
