//! A network checked against its specification and packed for the kernels.

use super::encode::Feature;
use super::layer::Layer;
use super::place::Frames;
use super::stack::Stack;
use crate::encoding::Quantity;
use crate::error::{Error, Result};
use crate::network::{Dense, Network};
use crate::spec::{Activation, Role, Symmetry};

/// A packed network; copies share its weights.
#[derive(Clone)]
pub struct Program {
    /// How queries are folded.
    pub symmetry: Symmetry,
    /// Its inputs.
    pub inputs: Vec<Feature>,
    /// Its layers.
    pub net: Stack,
    /// Its charts, where it has any.
    pub frames: Option<Frames>,
    /// Widest layer or input, of the network and of the frame's.
    pub width: usize,
}

impl Program {
    /// Packs `network`, which must have the role `role`.
    ///
    /// # Errors
    /// [`Error::Network`] when its specification is not sound, or weights contradict it.
    pub fn new(network: &Network, role: Role) -> Result<Program> {
        let spec = &network.spec;
        let refuse = |reason: String| Error::network(format!("the {} network", role.name()), reason);
        if spec.role != role {
            return Err(refuse(format!("it is a {} network", spec.role.name())));
        }
        spec.validate().map_err(refuse)?;
        let shapes = |what: &str, layers: &[Dense], expected: Vec<(usize, usize)>| {
            let found: Vec<_> = layers.iter().map(|l| (l.inputs, l.outputs)).collect();
            let whole = |l: &Dense| l.weight.len() == l.inputs * l.outputs && l.bias.len() == l.outputs;
            match found == expected && layers.iter().all(whole) {
                true => Ok(()),
                false => Err(refuse(format!(
                    "its {what} layers are {found:?}, its specification says {expected:?}"
                ))),
            }
        };
        shapes("network", &network.net, spec.layers())?;
        shapes("frame", &network.frame, spec.frame_layers())?;
        let widths = network
            .net
            .iter()
            .chain(&network.frame)
            .flat_map(|l| [l.inputs, l.outputs]);
        let frames = spec.charts().map(|charts| {
            let asked = spec.inputs.iter().chain(&charts.inputs);
            Frames::new(charts, stack(spec.activation, &network.frame), asked)
        });
        let mut inputs = Feature::all(&spec.inputs);
        if let Some(frames) = &frames {
            Feature::share(&mut inputs, frames.inputs());
        }
        Ok(Program {
            symmetry: spec.symmetry,
            inputs,
            net: stack(spec.activation, &network.net),
            frames,
            width: widths.max().unwrap_or(0),
        })
    }

    /// The same with the free parameters that have `values` folded into the first layers; the others are counted anew.
    pub fn bound(&self, values: &[Option<f64>]) -> Program {
        let mut bound = self.clone();
        bind_first_layer(&mut bound.net, &mut bound.inputs, values);
        if let Some(frames) = &mut bound.frames {
            frames.bind(values);
        }
        bound
    }

    /// Number of charts; 0 on the disk.
    pub fn charts(&self) -> usize {
        self.frames.as_ref().map_or(0, Frames::charts)
    }
}

/// `layers`, of which there is one at least, packed.
pub fn stack(activation: Activation, layers: &[Dense]) -> Stack {
    let (last, hidden) = layers.split_last().expect("a chain has at least one layer");
    Stack {
        activation,
        inputs: layers[0].inputs,
        hidden: hidden.iter().map(Layer::new).collect(),
        last: Some(Layer::new(last)),
    }
}

/// Folds those of `inputs` that the parameters `values` decide into the first layer of `net`, and numbers the parameters of
/// the rest anew.
pub fn bind_first_layer(net: &mut Stack, inputs: &mut Vec<Feature>, values: &[Option<f64>]) {
    let mut known = Vec::new();
    inputs.retain_mut(|input| {
        let Quantity::Parameter(parameter) = &mut input.quantity else {
            return true;
        };
        let number = *parameter;
        *parameter = renumbered(number, values);
        if let Some(value) = values[number] {
            known.extend(input.rows.clone().zip(input.of_number(value)));
        }
        values[number].is_none()
    });
    let first = net.hidden.first_mut().or(net.last.as_mut());
    let first = first.expect("a chain has at least one layer");
    *first = first.folded(&known);
}

/// The number of the free parameter `parameter` where those with `values` are not free any more.
pub fn renumbered(parameter: usize, values: &[Option<f64>]) -> usize {
    values[..parameter].iter().filter(|value| value.is_none()).count()
}
