//! One row of a query: what it asks, at which parameters and directions.

use crate::bsdf::direction;
use crate::error::{Error, Result};
use crate::field::{Field, Fields};
use crate::real::{Real, Vec3};

/// Most evaluations that a row may ask for: a day's work of one core.
const SAMPLES_MAX: f64 = 1e12;

/// The keys of a row, for errors.
const KEYS: &str = "`params`, `wo`, `wi`, `u`, `albedo`, `samples`, `id`";

/// What is asked at `wo`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ask {
    /// `f_cos` and `pdf` for light from `wi`, a unit vector.
    Eval {
        /// To the light.
        wi: Vec3,
    },
    /// A sampled direction for `u` in `[0,1)²`.
    Sample {
        /// Two uniform numbers.
        u: [Real; 2],
    },
    /// The directional albedo.
    Albedo,
}

/// One row.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The parameters, not looked at yet.
    pub params: Fields,
    /// Unit vector to the camera.
    pub wo: Vec3,
    /// What is asked.
    pub ask: Ask,
    /// Evaluations or walks to average, ≥ 1, where the row says.
    pub samples: Option<u64>,
}

impl Row {
    /// Reads one line of JSON:
    /// `{"params": {…}, "wo": [θ, φ], "wi": [θ, φ], "samples": n}`, or `"u": [a, b]` or `"albedo": true` in place of
    /// `wi`; angles in degrees, θ in 0..180 from the normal, φ from x towards y. An `id` may hold anything.
    ///
    /// # Errors
    /// [`Error::Json`] when it is no JSON object, [`Error::Query`] naming the key that is unknown, missing or wrong.
    pub fn parse(line: &str) -> Result<Row> {
        let mut given = match serde_json::from_str(line) {
            Ok(Field::Table(fields)) => fields,
            Ok(other) => return Err(Error::Json(format!("{other} is no object"))),
            Err(error) => return Err(Error::Json(without_line(&error))),
        };
        let params = match given.take("params") {
            Some(Field::Table(params)) => params,
            None => Fields::default(),
            Some(other) => return Err(wrong("params", &other, "an object with the parameters")),
        };
        let wo = match given.take("wo") {
            Some(field) => angles("wo", &field)?,
            None => return Err(Error::query("wo", "is missing; give [θ, φ] in degrees")),
        };
        let ask = ask(&mut given)?;
        let samples = match given.take("samples") {
            None => None,
            Some(Field::Number(n)) if n.fract() == 0.0 && (1.0..=SAMPLES_MAX).contains(&n) => Some(n as u64),
            Some(other) => return Err(wrong("samples", &other, "a whole number in 1..1e12")),
        };
        given.take("id");
        match given.0.first() {
            Some((key, _)) => Err(Error::query(key, format!("unknown key, expected one of {KEYS}"))),
            None => Ok(Row {
                params,
                wo,
                ask,
                samples,
            }),
        }
    }
}

fn ask(given: &mut Fields) -> Result<Ask> {
    let albedo = match given.take("albedo") {
        None | Some(Field::Truth(false)) => None,
        Some(Field::Truth(true)) => Some(Ask::Albedo),
        Some(other) => return Err(wrong("albedo", &other, "true or false")),
    };
    let wi = match given.take("wi") {
        Some(field) => Some(Ask::Eval {
            wi: angles("wi", &field)?,
        }),
        None => None,
    };
    let u = match given.take("u") {
        Some(field) => match pair(&field) {
            Some(u) if u.iter().all(|v| (0.0..1.0).contains(v)) => Some(Ask::Sample { u }),
            _ => return Err(wrong("u", &field, "two numbers in [0, 1)")),
        },
        None => None,
    };
    let mut asked = [("wi", wi), ("u", u), ("albedo", albedo)]
        .into_iter()
        .filter_map(|(key, ask)| Some((key, ask?)));
    match (asked.next(), asked.next()) {
        (Some((_, ask)), None) => Ok(ask),
        (Some((first, _)), Some((second, _))) => Err(Error::query(
            second,
            format!("is given beside `{first}`; ask for one of them in a row"),
        )),
        (None, _) => Err(Error::query(
            "wi",
            "is missing; give [θ, φ] in degrees, or `u`, or `albedo`: true",
        )),
    }
}

/// The direction of `[θ, φ]` in degrees.
fn angles(name: &str, field: &Field) -> Result<Vec3> {
    match pair(field) {
        Some([theta, phi]) if (0.0..=180.0).contains(&theta) => Ok(direction(theta, phi)),
        _ => Err(wrong(name, field, "[θ, φ] in degrees, θ in 0..180")),
    }
}

/// Two numbers; JSON's are always finite.
fn pair(field: &Field) -> Option<[Real; 2]> {
    match field {
        Field::List(items) => match items.as_slice() {
            [Field::Number(a), Field::Number(b)] => Some([*a, *b]),
            _ => None,
        },
        _ => None,
    }
}

fn wrong(name: &str, found: &Field, expected: &str) -> Error {
    Error::query(name, format!("is {found}, expected {expected}"))
}

/// What serde_json says, without the number of the only line it sees.
fn without_line(error: &serde_json::Error) -> String {
    let text = error.to_string();
    let reason = text.split(" at line ").next().unwrap_or_default();
    match error.column() {
        0 => reason.to_string(),
        column => format!("{reason} at column {column}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_row_is_read() {
        let params = r#""params": {"alpha": [0.3, 0.1]}, "wo": [45, 0]"#;
        let parse = |rest: &str| Row::parse(&format!("{{{params}, {rest}}}")).expect("a valid row");
        let row = parse(r#""wi": [30, 180], "samples": 1e5, "id": [null, "x"]"#);
        assert_eq!(row.wo, direction(45.0, 0.0));
        assert_eq!(
            row.ask,
            Ask::Eval {
                wi: direction(30.0, 180.0)
            }
        );
        assert!(row.params.has("alpha") && row.samples == Some(100_000));
        assert_eq!(parse(r#""u": [0, 0.5]"#).ask, Ask::Sample { u: [0.0, 0.5] });
        assert_eq!(parse(r#""albedo": true"#).ask, Ask::Albedo);
        assert_eq!(
            parse(r#""albedo": false, "u": [0, 0]"#).ask,
            Ask::Sample { u: [0.0; 2] }
        );
        let bare = Row::parse(r#"{"wo": [90, 0], "albedo": true}"#).expect("no parameters");
        assert!(bare.params.0.is_empty() && bare.wo.z == 0.0);
    }

    #[test]
    fn mistakes_are_named() {
        for (line, parts) in [
            ("", &["not a JSON object", "EOF"][..]),
            ("{\"wo\": [45, 0]", &["not a JSON object", "column 14"]),
            ("[45, 0]", &["not a JSON object", "[45, 0] is no object"]),
            (
                r#"{"wo": [1, 2], "wo": [1, 2], "albedo": true}"#,
                &["`wo` is given twice"],
            ),
            (r#"{"albedo": true}"#, &["`wo`", "missing"]),
            (
                r#"{"wo": [45], "albedo": true}"#,
                &["`wo`", "is [45]", "θ in 0..180"],
            ),
            (r#"{"wo": [-1, 0], "albedo": true}"#, &["`wo`", "is [-1, 0]"]),
            (r#"{"wo": [45, 0]}"#, &["`wi`", "missing", "`u`", "`albedo`"]),
            (r#"{"wo": [45, 0], "wi": [0, 0, 1]}"#, &["`wi`", "is [0, 0, 1]"]),
            (r#"{"wo": [45, 0], "wi": "up"}"#, &["`wi`", "is \"up\""]),
            (r#"{"wo": [45, 0], "u": [0, 1]}"#, &["`u`", "[0, 1)"]),
            (
                r#"{"wo": [45, 0], "u": [0, 0], "wi": [0, 0]}"#,
                &["`u`", "beside `wi`"],
            ),
            (r#"{"wo": [45, 0], "albedo": 1}"#, &["`albedo`", "is 1"]),
            (
                r#"{"wo": [45, 0], "wi": [0, 0], "samples": 0}"#,
                &["`samples`", "is 0"],
            ),
            (
                r#"{"wo": [45, 0], "wi": [0, 0], "samples": 1.5}"#,
                &["`samples`", "is 1.5"],
            ),
            (
                r#"{"wo": [45, 0], "wi": [0, 0], "sample": 9}"#,
                &["`sample`", "unknown key", "`samples`"],
            ),
            (
                r#"{"wo": [45, 0], "wi": [0, 0], "params": 3}"#,
                &["`params`", "is 3"],
            ),
        ] {
            let error = Row::parse(line).expect_err(line).to_string();
            for part in parts {
                assert!(error.contains(part), "`{part}` is not in: {error}");
            }
        }
    }
}
