//! What the types of a specification leave open, checked: a file may say anything.

use super::{CHARTS_MAX, Input, NetworkSpec, Role, Roughness};
use crate::encoding::{Encoding, Quantity, Scale};

/// Widest layer, or input of one, that a file may declare; the presets stay below 256. The native kernels hold the rows of
/// two layers for a tile of queries, 256 bytes each: what they take beside the weights is a megabyte or two at most.
const WIDTH_MAX: usize = 1024;
/// Deepest network a file may declare.
const DEPTH_MAX: usize = 64;
/// Most inputs a file may declare: the widest preset has 8 parameters and 4 more.
const INPUTS_MAX: usize = 64;

impl NetworkSpec {
    /// Checks everything that the types leave open.
    ///
    /// # Errors
    /// What is wrong, for the caller to name the file.
    pub fn validate(&self) -> Result<(), String> {
        self.material.validate().map_err(|e| e.to_string())?;
        let free = self.material.free().len();
        let sizes = |what: &str, hidden: &[usize], inputs: &[Input]| {
            if hidden.len() > DEPTH_MAX || hidden.iter().any(|w| !(1..=WIDTH_MAX).contains(w)) {
                return Err(format!(
                    "its {what} layers are not 1..{WIDTH_MAX} wide and at most {DEPTH_MAX} deep"
                ));
            }
            match inputs.len() {
                1..=INPUTS_MAX => Ok(()),
                n => Err(format!("its {what} has {n} inputs, expected 1..{INPUTS_MAX}")),
            }
        };
        sizes("hidden", &self.hidden, &self.inputs)?;
        for input in &self.inputs {
            self.check(input, free, false)?;
        }
        features("network", &self.inputs)?;
        let Some(charts) = self.charts() else {
            return Ok(());
        };
        sizes("frame network's", &charts.hidden, &charts.inputs)?;
        for input in &charts.inputs {
            self.check(input, free, true)?;
        }
        features("frame network", &charts.inputs)?;
        if !(1..=CHARTS_MAX).contains(&charts.anchors.len()) {
            return Err(format!(
                "it has {} charts, expected 1..{CHARTS_MAX}",
                charts.anchors.len()
            ));
        }
        for alpha in charts.alpha {
            let sound = match alpha {
                Roughness::Fixed(value) => (Roughness::MIN..=Roughness::MAX).contains(&value),
                Roughness::Free {
                    parameter,
                    factor,
                    power,
                } => parameter < free && factor > 0.0 && factor <= Roughness::MAX && (1..=2).contains(&power),
            };
            if !sound {
                return Err(format!("its charts cannot start from the roughness {alpha:?}"));
            }
        }
        Ok(())
    }

    /// Checks one input of the network, or of its frame network.
    fn check(&self, input: &Input, free: usize, of_frame: bool) -> Result<(), String> {
        let charts = self.charts().map_or(0, |c| c.anchors.len());
        let (sampling, density) = (
            self.role == Role::Sample && !of_frame,
            self.role != Role::Sample && !of_frame,
        );
        let known = match input.quantity {
            Quantity::U => {
                sampling
                    && matches!(
                        input.encoding,
                        Encoding::Centred
                            | Encoding::Frequency(_)
                            | Encoding::OneBlob(_)
                            | Encoding::Identity
                    )
            }
            Quantity::Chart => sampling && charts > 1,
            Quantity::WiDisk => density,
            Quantity::Local(chart) => density && chart < charts,
            Quantity::Anchor => charts > 0,
            Quantity::Parameter(parameter) => parameter < free,
            Quantity::Wo | Quantity::WoDisk => true,
        };
        let unscaled = input.scale == Scale::None;
        let direction = matches!(input.encoding, Encoding::Grazing | Encoding::Slant);
        let reason = if !known {
            "it is not asked for that"
        } else if !input.encoding.suits(input.quantity.scalars()) {
            "the encoding does not suit it"
        } else if !input.scale.is_sound() {
            "the scale has no range"
        } else if input.quantity == Quantity::U && !unscaled {
            // The derivatives by u are those of the encodings alone.
            "u enters as it is"
        } else if direction && !unscaled {
            "the encoding takes unit directions as they are"
        } else if matches!(input.scale, Scale::Sqrt(_)) && self.may_be_negative(input.quantity) {
            "it may be negative, and has no root there"
        } else {
            return Ok(());
        };
        Err(format!(
            "{} {} network cannot take {:?}, scaled {:?}, as {:?}: {reason}",
            if self.role == Role::Eval { "an" } else { "a" },
            self.role.name(),
            input.quantity,
            input.scale,
            input.encoding
        ))
    }

    /// Whether a scalar of `quantity` may be below 0. Those of the camera are not: it is folded, whatever the symmetry.
    fn may_be_negative(&self, quantity: Quantity) -> bool {
        match quantity {
            Quantity::U | Quantity::Wo | Quantity::WoDisk => false,
            Quantity::WiDisk | Quantity::Local(_) | Quantity::Anchor | Quantity::Chart => true,
            Quantity::Parameter(i) => self.material.free().get(i).is_some_and(|(_, min, _)| *min < 0.0),
        }
    }
}

/// Checks how many features the sound `inputs` of the network called `what` have.
fn features(what: &str, inputs: &[Input]) -> Result<(), String> {
    match inputs.iter().map(|input| input.features()).sum() {
        0..=WIDTH_MAX => Ok(()),
        n => Err(format!(
            "the inputs of its {what} have {n} features, more than {WIDTH_MAX}"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::anchor::Anchor;
    use crate::spec::{Activation, ChartsSpec, FORMAT, Geometry, Symmetry};

    /// A network of two charts with one input; `g` may be negative, `sigma_t` not.
    fn spec(role: Role, input: Input) -> NetworkSpec {
        let json = r#"{"name": "varnish", "family": "layered", "alpha": 0.3, "eta": 1.4, "albedo": [0.9, 0.6, 0.3],
            "base": [0.8, 0.5, 0.2], "sigma_t": {"min": 0, "max": 4}, "g": {"min": -0.5, "max": 0.9}}"#;
        NetworkSpec {
            format: FORMAT,
            role,
            material: serde_json::from_str(json).expect("a valid description"),
            symmetry: Symmetry::Rotation,
            inputs: vec![input],
            hidden: vec![4],
            activation: Activation::Silu,
            geometry: Geometry::Charts(ChartsSpec {
                anchors: vec![Anchor::Mirror, Anchor::Diffuse],
                alpha: [Roughness::Fixed(0.3); 2],
                inputs: vec![Input::plain(Quantity::Wo, Encoding::Slant)],
                hidden: vec![4],
            }),
        }
    }

    fn scaled(quantity: Quantity, scale: Scale, encoding: Encoding) -> Input {
        Input {
            quantity,
            scale,
            encoding,
        }
    }

    /// The number of the free parameter called `name`.
    fn number(name: &str) -> usize {
        let material = spec(Role::Pdf, Input::plain(Quantity::Wo, Encoding::Slant)).material;
        let found = material.free().iter().position(|(label, ..)| label == name);
        found.expect("it is free")
    }

    #[test]
    fn roots_are_for_what_is_never_negative() {
        let root = Scale::Sqrt([0.0, 1.0]);
        let with = |role, quantity| spec(role, scaled(quantity, root, Encoding::Identity)).validate();
        for quantity in [
            Quantity::Wo,
            Quantity::WoDisk,
            Quantity::Parameter(number("sigma_t")),
        ] {
            assert_eq!(with(Role::Sample, quantity), Ok(()));
        }
        for (role, quantity) in [
            (Role::Sample, Quantity::Chart),
            (Role::Sample, Quantity::Anchor),
            (Role::Sample, Quantity::Parameter(number("g"))),
            (Role::Eval, Quantity::WiDisk),
            (Role::Pdf, Quantity::Local(1)),
        ] {
            let error = with(role, quantity).expect_err("it must be refused");
            assert!(
                error.contains("Sqrt") && error.contains("may be negative"),
                "{error}"
            );
        }
        let of_u = with(Role::Sample, Quantity::U).expect_err("it must be refused");
        assert!(of_u.contains("u enters as it is"), "{of_u}");
    }

    #[test]
    fn encodings_of_directions_take_no_scale() {
        for (quantity, encoding) in [
            (Quantity::Wo, Encoding::Grazing),
            (Quantity::Wo, Encoding::Slant),
            (Quantity::Local(0), Encoding::Grazing),
        ] {
            assert_eq!(
                spec(Role::Eval, Input::plain(quantity, encoding)).validate(),
                Ok(())
            );
            for scale in [Scale::Linear([-1.0, 1.0]), Scale::Decay([0.0, 1.0])] {
                let error = spec(Role::Eval, scaled(quantity, scale, encoding)).validate();
                let error = error.expect_err("it must be refused");
                assert!(
                    error.contains("an eval network") && error.contains("unit directions"),
                    "{error}"
                );
            }
        }
    }

    #[test]
    fn other_reasons_are_told_apart() {
        let free = 2;
        for (input, reason) in [
            (Input::plain(Quantity::U, Encoding::Identity), "not asked for"),
            (
                Input::plain(Quantity::Local(2), Encoding::Identity),
                "not asked for",
            ),
            (
                Input::plain(Quantity::Parameter(free), Encoding::Identity),
                "not asked for",
            ),
            (Input::plain(Quantity::WiDisk, Encoding::Slant), "does not suit"),
            (Input::plain(Quantity::Wo, Encoding::OneBlob(0)), "does not suit"),
            (
                scaled(Quantity::Wo, Scale::Linear([1.0, 1.0]), Encoding::Identity),
                "no range",
            ),
        ] {
            let error = spec(Role::Pdf, input).validate().expect_err("it must be refused");
            assert!(
                error.contains("a pdf network") && error.contains(reason),
                "{error}"
            );
        }
    }
}
