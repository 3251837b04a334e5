//! A network checked against its specification and packed for the kernels, and what sampling and density
//! queries share: encoding, and the lobe frames of a tile.

use super::kernel::{Buffers, Layer, Linear, Silu, Values};
use super::lobe::{Lobe, grazing};
use super::tile::{Cameras, Column};
use super::vector::Vector;
use crate::encoding::{Encoding, GRAZING_FEATURES, Quantity};
use crate::error::{Error, Result};
use crate::frame::FRAME_OUTPUTS;
use crate::network::{Dense, Network};
use crate::spec::{Activation, Input, Role, Symmetry};

/// A packed network.
pub struct Program {
    /// How queries are folded.
    pub symmetry: Symmetry,
    /// Hidden layers.
    pub hidden: Vec<Layer>,
    /// The last layer.
    pub last: Layer,
    /// Number of features that enter.
    pub features: usize,
    /// Widest layer or input, of the network and of the frame's.
    pub width: usize,
    inputs: Vec<Input>,
    frame_hidden: Vec<Layer>,
    frame_last: Layer,
    anchor_alpha: [f32; 2],
}

impl Program {
    /// Packs `network`, which must have the role `role`.
    ///
    /// # Errors
    /// [`Error::Network`] when weights contradict the specification or it asks for an input that such a query
    /// does not have.
    pub fn new(network: &Network, role: Role) -> Result<Program> {
        let spec = &network.spec;
        let refuse = |reason: String| Error::network(format!("the {} network", role.name()), reason);
        if spec.role != role {
            return Err(refuse(format!("it is a {} network", spec.role.name())));
        }
        let Activation::Silu = spec.activation;
        for input in &spec.inputs {
            let known = match input.quantity {
                Quantity::U => role == Role::Sample && input.encoding == Encoding::Centred,
                Quantity::Local => role != Role::Sample,
                Quantity::Wo => true,
            };
            if !known {
                return Err(refuse(format!(
                    "its input {:?} {:?} does not exist here",
                    input.quantity, input.encoding
                )));
            }
        }
        let shapes = |what: &str, layers: &[Dense], expected: Vec<(usize, usize)>| {
            let found: Vec<_> = layers.iter().map(|l| (l.inputs, l.outputs)).collect();
            let whole = |l: &Dense| l.weight.len() == l.inputs * l.outputs && l.bias.len() == l.outputs;
            if found != expected
                || expected.iter().any(|&(i, o)| i == 0 || o == 0)
                || !layers.iter().all(whole)
            {
                return Err(refuse(format!(
                    "its {what} layers are {found:?}, its specification says {expected:?}"
                )));
            }
            Ok(())
        };
        shapes("network", &network.net, spec.layers())?;
        shapes("frame", &network.frame, spec.frame_layers())?;
        let pack = |layers: &[Dense]| -> (Vec<Layer>, Layer) {
            let (last, hidden) = layers.split_last().expect("a chain has at least one layer");
            (hidden.iter().map(Layer::new).collect(), Layer::new(last))
        };
        let (hidden, last) = pack(&network.net);
        let (frame_hidden, frame_last) = pack(&network.frame);
        let widths = network
            .net
            .iter()
            .chain(&network.frame)
            .flat_map(|l| [l.inputs, l.outputs]);
        Ok(Program {
            symmetry: spec.symmetry,
            hidden,
            last,
            features: spec.input_features(),
            width: widths.max().unwrap_or(0),
            inputs: spec.inputs.clone(),
            frame_hidden,
            frame_last,
            anchor_alpha: spec.frame.anchor_alpha.map(|a| a as f32),
        })
    }

    /// Outputs of the frame network for the grazing features of a tile.
    #[inline(always)]
    pub fn frame_outputs<V: Vector, const N: usize>(
        &self,
        wo_features: &[Column<V, N>; GRAZING_FEATURES],
        buffers: &mut Buffers<V, N>,
    ) -> [Column<V, N>; FRAME_OUTPUTS] {
        buffers.input()[..GRAZING_FEATURES].copy_from_slice(wo_features);
        let rows = buffers.run::<Silu<Values>, Linear<Values>>(
            GRAZING_FEATURES,
            &self.frame_hidden,
            &self.frame_last,
        );
        let mut outputs = [rows[0]; FRAME_OUTPUTS];
        outputs.copy_from_slice(rows);
        outputs
    }

    /// The lobe frame of vector `q` of a tile, from [`Program::frame_outputs`].
    #[inline(always)]
    pub fn lobe<V: Vector, const N: usize>(
        &self,
        outputs: &[Column<V, N>; FRAME_OUTPUTS],
        cameras: &Cameras<V, N>,
        q: usize,
    ) -> Lobe<V> {
        let [log_x, log_y, shear, dx, dy] = outputs;
        Lobe::new(
            [log_x[q], log_y[q], shear[q], dx[q], dy[q]],
            cameras.wo(q),
            self.anchor_alpha,
        )
    }

    /// Writes the features of a tile to `out`; `other` are the scalars of the quantity that is not `wo`.
    #[inline(always)]
    pub fn encode<V: Vector, const N: usize>(
        &self,
        wo_features: &[Column<V, N>; GRAZING_FEATURES],
        other: &[Column<V, N>],
        out: &mut [Column<V, N>],
    ) {
        let mut rest = out;
        for input in &self.inputs {
            let scalars = match input.quantity {
                Quantity::U | Quantity::Local => other,
                // The first grazing features are the direction itself.
                Quantity::Wo => &wo_features[..3],
            };
            let (rows, after) = rest.split_at_mut(input.encoding.features(scalars.len()));
            rest = after;
            match (input.encoding, input.quantity) {
                (Encoding::Identity, _) => rows.copy_from_slice(scalars),
                (Encoding::Centred, _) => {
                    for (row, scalar) in rows.iter_mut().zip(scalars) {
                        for (v, &s) in row.iter_mut().zip(scalar) {
                            *v = s + s - s.splat(1.0);
                        }
                    }
                }
                (Encoding::Grazing, Quantity::Wo) => rows.copy_from_slice(wo_features),
                (Encoding::Grazing, Quantity::U | Quantity::Local) => {
                    rows.copy_from_slice(&grazing_columns(&[scalars[0], scalars[1], scalars[2]]));
                }
            }
        }
    }

    /// ∂(first layer)/∂u per row of `layer`, the layer that the features enter: twice the weights of the
    /// centred u, so that no tangent has to run through the first layer.
    pub fn first_slopes(&self, layer: &Dense) -> Vec<[f32; 2]> {
        let mut slopes = vec![[0.0; 2]; layer.outputs];
        let mut offset = 0;
        for input in &self.inputs {
            if input.quantity == Quantity::U {
                for (slope, row) in slopes.iter_mut().zip(layer.weight.chunks_exact(layer.inputs)) {
                    slope[0] += 2.0 * row[offset];
                    slope[1] += 2.0 * row[offset + 1];
                }
            }
            offset += input.encoding.features(input.quantity.scalars());
        }
        slopes
    }
}

/// Grazing features of the directions `w`.
#[inline(always)]
pub fn grazing_columns<V: Vector, const N: usize>(w: &[Column<V, N>; 3]) -> [Column<V, N>; GRAZING_FEATURES] {
    let mut columns = [w[0]; GRAZING_FEATURES];
    for q in 0..N {
        for (column, feature) in columns.iter_mut().zip(grazing([w[0][q], w[1][q], w[2][q]])) {
            column[q] = feature;
        }
    }
    columns
}
