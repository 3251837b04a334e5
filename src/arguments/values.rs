//! Values of options: what is read from their text, and what a wrong one is told.

use bake_runtime::Family;
use bake_runtime::field::Field;
use bake_train::presets::Preset;
use bake_train::transport::Solver;

/// A finite number.
pub fn finite(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err("give a number".into()),
    }
}

/// A polar angle above the horizon, degrees.
pub fn polar_angle(text: &str) -> Result<f64, String> {
    match finite(text) {
        Ok(theta) if (0.0..90.0).contains(&theta) => Ok(theta),
        _ => Err("give an angle in degrees, 0 to below 90".into()),
    }
}

/// A positive, finite number of seconds.
pub fn positive_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds.is_finite() => Ok(seconds),
        _ => Err("give a positive number of seconds".into()),
    }
}

/// A solver by its name.
pub fn solver(name: &str) -> Result<Solver, String> {
    let names = || Solver::ALL.map(Solver::name).join(", ");
    Solver::find(name).ok_or_else(|| format!("give one of {}", names()))
}

/// A preset by its name.
pub fn preset(name: &str) -> Result<Preset, String> {
    let names = || Preset::ALL.map(Preset::name).join(" or ");
    let found = Preset::ALL.into_iter().find(|preset| preset.name() == name);
    found.ok_or_else(|| format!("give {}", names()))
}

/// Cells per side of a map.
pub fn cells(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(cells @ (32 | 64 | 128 | 256)) => Ok(cells),
        _ => Err("give 32, 64, 128 or 256".into()),
    }
}

/// `KEY=VALUE`, the value as JSON or as a bare word.
pub fn assignment(text: &str) -> Result<(String, Field), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() && !value.trim().is_empty() => {
            let value = value.trim();
            let field = serde_json::from_str(value).unwrap_or_else(|_| Field::Text(value.into()));
            Ok((key.trim().into(), field))
        }
        _ => Err("give KEY=VALUE, e.g. roughness=0.3".into()),
    }
}

/// A family that can be measured from the command line alone.
pub fn measured_family(name: &str) -> Result<Family, String> {
    Family::find(name)
        .filter(|family| *family != Family::Imported)
        .ok_or_else(|| "give `conductor`, `layered` or `principled`".into())
}
