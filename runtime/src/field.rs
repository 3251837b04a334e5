//! Values as a material file, a line of JSON or a command line gives them, before anyone knows what they should be.
//!
//! Material files (TOML), metadata (JSON) and rows of queries all describe the same parameters. They are first read
//! into this form, which keeps NaN, order and repeated keys; [`crate::Material`] then says what is wrong with them, by
//! the one table of each family.

use serde::de::{Deserialize, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use std::fmt;

/// Any value.
#[derive(Clone, Debug, PartialEq)]
pub enum Field {
    /// A number.
    Number(f64),
    /// A text.
    Text(String),
    /// A list.
    List(Vec<Field>),
    /// A table.
    Table(Fields),
    /// `true` or `false`, which no parameter takes.
    Truth(bool),
    /// JSON's null, which no parameter takes.
    Null,
}

/// A table: keys with their values, in the order of the source.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fields(pub Vec<(String, Field)>);

impl Fields {
    /// Takes the value of `key` out of the table.
    pub fn take(&mut self, key: &str) -> Option<Field> {
        let index = self.0.iter().position(|(k, _)| k == key)?;
        Some(self.0.remove(index).1)
    }

    /// Whether `key` is there.
    pub fn has(&self, key: &str) -> bool {
        self.0.iter().any(|(k, _)| k == key)
    }
}

impl fmt::Display for Field {
    /// As TOML writes it.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Field::Number(value) => write!(f, "{value}"),
            Field::Text(text) => write!(f, "{text:?}"),
            Field::List(list) => {
                f.write_str("[")?;
                for (i, item) in list.iter().enumerate() {
                    write!(f, "{}{item}", if i > 0 { ", " } else { "" })?;
                }
                f.write_str("]")
            }
            Field::Table(Fields(fields)) => {
                f.write_str("{")?;
                for (i, (key, value)) in fields.iter().enumerate() {
                    write!(f, "{} {key} = {value}", if i > 0 { "," } else { "" })?;
                }
                f.write_str(" }")
            }
            Field::Truth(value) => write!(f, "{value}"),
            Field::Null => f.write_str("null"),
        }
    }
}

impl<'de> Deserialize<'de> for Field {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(FieldVisitor)
    }
}

impl<'de> Deserialize<'de> for Fields {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match Field::deserialize(deserializer)? {
            Field::Table(fields) => Ok(fields),
            other => Err(D::Error::custom(format_args!("is {other}, expected a table"))),
        }
    }
}

struct FieldVisitor;

impl<'de> Visitor<'de> for FieldVisitor {
    type Value = Field;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a number, a text, a list or a table")
    }

    fn visit_f64<E>(self, value: f64) -> Result<Field, E> {
        Ok(Field::Number(value))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Field, E> {
        Ok(Field::Number(value as f64))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Field, E> {
        Ok(Field::Number(value as f64))
    }

    fn visit_str<E>(self, value: &str) -> Result<Field, E> {
        Ok(Field::Text(value.into()))
    }

    fn visit_bool<E>(self, value: bool) -> Result<Field, E> {
        Ok(Field::Truth(value))
    }

    fn visit_unit<E>(self) -> Result<Field, E> {
        Ok(Field::Null)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Field, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = list.next_element()? {
            items.push(item);
        }
        Ok(Field::List(items))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Field, A::Error> {
        let mut fields = Fields::default();
        while let Some((key, value)) = map.next_entry::<String, Field>()? {
            if fields.has(&key) {
                return Err(A::Error::custom(format_args!("`{key}` is given twice")));
            }
            fields.0.push((key, value));
        }
        Ok(Field::Table(fields))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_is_read_and_shown() {
        let text = r#"{"a": [1, -2.5, "x"], "b": {"min": 0, "max": 1e3}, "c": null, "d": true}"#;
        let fields: Fields = serde_json::from_str(text).expect("valid JSON");
        let shown = Field::Table(fields.clone()).to_string();
        assert_eq!(
            shown,
            r#"{ a = [1, -2.5, "x"], b = { min = 0, max = 1000 }, c = null, d = true }"#
        );
        assert!(fields.has("c") && !fields.has("min"));
    }

    #[test]
    fn a_key_given_twice_is_refused() {
        let error = serde_json::from_str::<Fields>(r#"{"a": 1, "a": 2}"#).expect_err("twice");
        assert!(error.to_string().contains("`a` is given twice"), "{error}");
        assert!(serde_json::from_str::<Fields>("[1]").is_err());
    }
}
