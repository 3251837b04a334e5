//! What is measured: dense layers alone, synthetic networks of the shapes that bakes use, and baked materials.

use crate::commands::check::{CARD_FILE, read_card};
use anyhow::Result;
use bake_runtime::anchor::Anchor;
use bake_runtime::encoding::{Encoding, Quantity};
use bake_runtime::spec::{Activation, ChartsSpec, FORMAT, Geometry, Input, Roughness, Symmetry};
use bake_runtime::{BakedMaterial, Dense, Family, Material, Network, NetworkSpec, Rng, Role};
use std::path::{Path, PathBuf};

/// Width of input and output of the layers that are measured alone.
const ENDS: [usize; 2] = [32, 5];
/// Hidden layers and width of these, and of synthetic networks with encodings as in the paper.
const PAPER: [[usize; 2]; 2] = [[6, 64], [6, 128]];
/// Hidden layers and width of synthetic networks as the warp preset has them.
const WARP: [[usize; 2]; 3] = [[3, 32], [4, 32], [3, 64]];
/// Hidden layers of the frame network of these.
const FRAME: [usize; 2] = [16, 16];
/// Roughness of the synthetic material.
const ALPHA: [f64; 2] = [0.3, 0.1];
/// Seed of the synthetic weights.
const SEED: u64 = 0xbe7c4;

/// One thing that is measured.
pub struct Subject {
    /// What it is called in reports.
    pub name: String,
    /// Hidden layers and width of its sampling network.
    pub shape: [usize; 2],
    /// What runs.
    pub kind: Kind,
}

/// What runs.
pub enum Kind {
    /// Dense layers without encodings and heads.
    Layers(Vec<Dense>, Activation),
    /// A material's networks.
    Networks {
        /// Them.
        material: Box<BakedMaterial>,
        /// Binning error of the sampling network, θ_o ≤ 75°, as its card has it.
        binning_l1: Option<f64>,
        /// Where its files lie, if it has any.
        folder: Option<PathBuf>,
    },
}

/// The baked materials in `folders`, after the synthetic networks, where `synthetic` ones are wanted.
pub fn all(folders: &[PathBuf], synthetic: bool) -> Result<Vec<Subject>> {
    let mut subjects = Vec::new();
    if synthetic {
        subjects.extend(PAPER.map(layers));
        subjects.extend(PAPER.map(|shape| networks("as in the paper", shape, Geometry::Disk)));
        subjects.extend(WARP.map(|shape| networks("one chart", shape, charts())));
    }
    for folder in folders {
        subjects.push(baked(folder)?);
    }
    Ok(subjects)
}

fn layers([depth, width]: [usize; 2]) -> Subject {
    let mut widths = vec![ENDS[0]];
    widths.extend(vec![width; depth]);
    widths.push(ENDS[1]);
    let shapes: Vec<(usize, usize)> = widths.windows(2).map(|w| (w[0], w[1])).collect();
    Subject {
        name: format!("layers {depth}×{width}"),
        shape: [depth, width],
        kind: Kind::Layers(weights(&shapes, &mut Rng::new(&[SEED])), Activation::Relu),
    }
}

fn baked(folder: &Path) -> Result<Subject> {
    let material = BakedMaterial::load(folder)?;
    let card = read_card(&folder.join(CARD_FILE))?;
    let spec = &material.sample.spec;
    let binning = card.and_then(|card| card.errors.get("theta_0_75").map(|e| e.binning_l1.mean));
    Ok(Subject {
        name: spec.material.name.clone(),
        shape: [spec.hidden.len(), spec.hidden.iter().copied().max().unwrap_or(0)],
        kind: Kind::Networks {
            binning_l1: binning,
            material: Box::new(material),
            folder: Some(folder.to_path_buf()),
        },
    })
}

/// One chart as the warp preset has it.
fn charts() -> Geometry {
    Geometry::Charts(ChartsSpec {
        anchors: vec![Anchor::Mirror],
        alpha: ALPHA.map(Roughness::Fixed),
        inputs: place_inputs(),
        hidden: FRAME.to_vec(),
    })
}

fn place_inputs() -> Vec<Input> {
    vec![
        Input::plain(Quantity::Wo, Encoding::Grazing),
        Input::plain(Quantity::Anchor, Encoding::Identity),
    ]
}

/// Networks with random weights.
fn networks(what: &str, [depth, width]: [usize; 2], geometry: Geometry) -> Subject {
    let given = [("alpha", &ALPHA[..]), ("reflectance", &[0.9; 3][..])];
    let material =
        Material::fixed("synthetic", Family::Conductor, &given).expect("values that the family allows");
    let mut rng = Rng::new(&[SEED, 1]);
    let [sample, eval, pdf] = Role::ALL.map(|role| {
        let mut spec = NetworkSpec {
            format: FORMAT,
            role,
            material: material.clone(),
            symmetry: Symmetry::Quadrant,
            inputs: Vec::new(),
            hidden: vec![width; depth],
            activation: Activation::Silu,
            geometry: geometry.clone(),
        };
        match &geometry {
            Geometry::Charts(_) => {
                spec.inputs.push(match role {
                    Role::Sample => Input::plain(Quantity::U, Encoding::Centred),
                    _ => Input::plain(Quantity::Local(0), Encoding::Identity),
                });
                spec.inputs.extend(place_inputs());
            }
            Geometry::Disk => {
                // 32 features, as the layers alone have.
                spec.activation = Activation::Relu;
                let other = match role {
                    Role::Sample => Quantity::U,
                    _ => Quantity::WiDisk,
                };
                spec.inputs = vec![
                    Input::plain(other, Encoding::OneBlob(8)),
                    Input::plain(Quantity::WoDisk, Encoding::Frequency(4)),
                ];
            }
        }
        Network {
            frame: weights(&spec.frame_layers(), &mut rng),
            net: weights(&spec.layers(), &mut rng),
            spec,
        }
    });
    Subject {
        name: format!("{what} {depth}×{width}"),
        shape: [depth, width],
        kind: Kind::Networks {
            material: Box::new(BakedMaterial { sample, eval, pdf }),
            binning_l1: None,
            folder: None,
        },
    }
}

/// Random layers of (inputs, outputs) that keep the size of what enters (He et al. 2015), the last a smaller one.
fn weights(shapes: &[(usize, usize)], rng: &mut Rng) -> Vec<Dense> {
    let layer = |(i, &(inputs, outputs)): (usize, &(usize, usize))| {
        let gain: f64 = if i + 1 == shapes.len() { 0.3 } else { 6.0 };
        let bound = (gain / inputs as f64).sqrt();
        let mut centred = |bound: f64| ((2.0 * rng.uniform() - 1.0) * bound) as f32;
        Dense {
            weight: (0..inputs * outputs).map(|_| centred(bound)).collect(),
            bias: (0..outputs).map(|_| centred(0.1)).collect(),
            inputs,
            outputs,
        }
    };
    shapes.iter().enumerate().map(layer).collect()
}
