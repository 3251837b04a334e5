//! Charts and their prediction as graph operations: the f32 counterpart of `bake_runtime::chart` and of
//! `oracle::predict_charts`.

use crate::anchor::Start;
use crate::boost::Boost;
use crate::features::Point;
use crate::frame::{Frame, Square, normalized};
use crate::graph::{Graph, Value};
use crate::layers::forward;
use bake_runtime::Network;
use bake_runtime::anchor::Anchor;
use bake_runtime::encoding::Quantity;
use bake_runtime::frame::{FRAME_OUTPUT_MAX, FRAME_OUTPUTS};
use bake_runtime::spec::{ChartsSpec, SHARE_MIN};

/// A frame, and the boost that follows it where there is one.
#[derive(Clone, Copy)]
pub struct Chart {
    frame: Frame,
    boost: Option<Boost>,
}

/// The charts of a query.
pub enum Charts {
    /// One that gets all samples.
    One(Chart),
    /// Two with the share of the samples that each gets, `[N, 1]`; both are computed, so that neither loses its
    /// relative precision to a difference from 1.
    Two([Chart; 2], [Value; 2]),
}

impl Charts {
    /// The charts that `network` predicts at `point`, which learns what its charts start from.
    ///
    /// Weights are stored as `{prefix}frame.0` and on.
    pub fn predict(
        g: &mut Graph,
        prefix: &str,
        network: &Network,
        spec: &ChartsSpec,
        point: &mut Point,
    ) -> Charts {
        let told = [&network.spec.inputs, &spec.inputs]
            .into_iter()
            .flatten()
            .any(|input| input.quantity == Quantity::Anchor);
        let mirror = (told || spec.anchors.contains(&Anchor::Mirror))
            .then(|| Start::mirror(g, spec, &point.params, point.wo));
        point.anchor = mirror.filter(|_| told).map(|start| start.scalars(g));

        g.scope("frame");
        let features = point.features(g, &spec.inputs);
        let name = format!("{prefix}frame");
        let outputs = forward(g, &name, &network.frame, network.spec.activation, features);
        let chart = |g: &mut Graph, anchor: Anchor, outputs: &[Value]| {
            let limited = std::array::from_fn(|i| g.clip(outputs[i], FRAME_OUTPUT_MAX as f32));
            let start = match anchor {
                Anchor::Mirror => mirror.as_ref(),
                Anchor::Diffuse => None,
            };
            Chart {
                frame: Frame::from_outputs(g, limited, start),
                boost: start.map(|start| start.boost),
            }
        };
        match spec.anchors[..] {
            [only] => {
                let outputs: [Value; FRAME_OUTPUTS] = g.columns(outputs);
                Charts::One(chart(g, only, &outputs))
            }
            [first, second] => {
                let outputs: [Value; 2 * FRAME_OUTPUTS + 1] = g.columns(outputs);
                let (frames, logit) = (outputs.as_chunks::<FRAME_OUTPUTS>().0, outputs[2 * FRAME_OUTPUTS]);
                let charts = [chart(g, first, &frames[0]), chart(g, second, &frames[1])];
                let opposite = g.unary("Neg", logit);
                Charts::Two(charts, [opposite, logit].map(|against| share(g, against)))
            }
            _ => unreachable!("a checked specification has one or two charts"),
        }
    }

    /// All of them.
    pub fn all(&self) -> &[Chart] {
        match self {
            Charts::One(chart) => std::slice::from_ref(chart),
            Charts::Two(charts, _) => charts,
        }
    }
}

impl Chart {
    /// `yes` for queries where `condition` holds, else `no`.
    pub fn select(g: &mut Graph, condition: Value, yes: Chart, no: Chart) -> Chart {
        let boost = (yes.boost.is_some() || no.boost.is_some()).then(|| {
            let [yes, no] = [yes.boost, no.boost].map(|boost| boost.unwrap_or_else(|| Boost::none(g)));
            let mut pick = |yes, no| g.select(condition, yes, no);
            Boost {
                beta: [pick(yes.beta[0], no.beta[0]), pick(yes.beta[1], no.beta[1])],
                cos: pick(yes.cos, no.cos),
            }
        });
        let (yes, no) = (yes.frame, no.frame);
        let mut pick = |yes, no| g.select(condition, yes, no);
        let frame = Frame {
            x: pick(yes.x, no.x),
            y: pick(yes.y, no.y),
            shear: pick(yes.shear, no.shear),
            delta: [pick(yes.delta[0], no.delta[0]), pick(yes.delta[1], no.delta[1])],
        };
        Chart { frame, boost }
    }

    /// Direction `[N, 3]` at `square`, and dω / d(square), sr, `[N, 1]`.
    pub fn square_to_direction(self, g: &mut Graph, square: &Square) -> (Value, Value) {
        g.scope("direction");
        let (v, area) = self.frame.square_to_direction(g, square);
        let (w, area) = match self.boost {
            None => (v, area),
            Some(boost) => {
                let (w, scale) = boost.apply(g, v);
                // The boost multiplies what rounding left of 1 in the length of v.
                (normalized(g, w), g.mul(scale, area))
            }
        };
        (g.concat(&w), area)
    }

    /// Local direction `[N, 3]` of `w` `[N, 3]`, and the density of a direction drawn evenly over the square at `w`,
    /// sr⁻¹, `[N, 1]`.
    pub fn to_local(self, g: &mut Graph, w: Value) -> (Value, Value) {
        g.scope("local");
        let w = g.columns(w);
        let (local, density) = match self.boost {
            None => self.frame.to_local(g, w),
            Some(boost) => {
                let (v, scale) = boost.inverse(g).apply(g, w);
                let (local, density) = self.frame.to_local(g, v);
                (local, g.mul(density, scale))
            }
        };
        (g.concat(&local), density)
    }
}

/// σ(−against) within the limits of a share. By the exponential, because onnxruntime's sigmoid is precise to 1e-7 of 1 only.
fn share(g: &mut Graph, against: Value) -> Value {
    let odds = g.unary("Exp", against);
    let sum = g.add_scalar(odds, 1.0);
    let one = g.scalar(1.0);
    let share = g.div(one, sum);
    let (least, most) = (g.scalar(SHARE_MIN as f32), g.scalar(1.0 - SHARE_MIN as f32));
    let raised = g.max(share, least);
    g.min(raised, most)
}
