//! The graph of a sampling network: (params, wo, u) ↦ wi, learned weight, Jacobian.

use crate::chart::{Chart, Charts};
use crate::density::{parts, sum};
use crate::features::Point;
use crate::frame::Square;
use crate::graph::{Graph, Value};
use crate::layers::{Affine, Dual, hidden_dual};
use crate::query::{Query, answer, bounded_exp, limit_u};
use crate::symmetry::fold;
use crate::warp::{disk_direction, place, warp};
use bake_runtime::spec::U_MIN;
use bake_runtime::{BakedMaterial, Network};

/// Number of outputs of a sampling network that steer the position; the learned weight follows.
const STEERING_OUTPUTS: usize = 2;

/// The whole graph.
///
/// With two charts the Jacobian takes the pdf network as well (`oracle::jacobian`), which then stands in the graph under
/// the prefix `pdf.`; its queries are the raw ones and the answered `wi`, as a caller would ask them.
pub fn sample(g: &mut Graph, material: &BakedMaterial) {
    let network = &material.sample;
    let spec = &network.spec;
    let query = Query::new(g, spec);
    let (folded, turn) = fold(g, spec.symmetry, query.wo);
    let u = limit_u(g, query.other);
    let mut point = Point::new(query.params.clone(), folded);
    let charts = spec
        .charts()
        .map(|of| Charts::predict(g, "", network, of, &mut point));
    let (place, log_weight, drawn) = match charts {
        None => {
            point.u = Some(u);
            let (steering, log_weight) = outputs(g, network, &point);
            let (square, det) = place(g, steering);
            let (direction, area) = disk_direction(g, &square);
            (Place { direction, area, det }, log_weight, None)
        }
        Some(Charts::One(chart)) => {
            point.u = Some(u);
            let (steering, log_weight) = outputs(g, network, &point);
            let complement = g.one_minus(u);
            let u = Square {
                position: u,
                complement,
            };
            (Place::in_chart(g, chart, &u, steering), log_weight, None)
        }
        Some(Charts::Two(charts, shares)) => {
            let drawn = Drawn::new(g, charts, shares, u);
            point.u = Some(drawn.u.position);
            let (plus, minus) = (g.scalar(1.0), g.scalar(-1.0));
            point.chart = Some(g.select(drawn.is_first, plus, minus));
            let (steering, log_weight) = outputs(g, network, &point);
            let place = Place::in_chart(g, drawn.chart, &drawn.u, steering);
            (place, log_weight, Some(drawn))
        }
    };

    g.scope("answer");
    let wi = turn.unfold(g, place.direction);
    let weight = bounded_exp(g, log_weight);
    let mut jacobian = g.mul(place.area, place.det);
    if let Some(drawn) = drawn {
        let densities = parts(g, "pdf.", &material.pdf, &query.params, query.wo, wi);
        g.scope("answer");
        let own = g.select(drawn.is_first, densities[0], densities[1]);
        let total = sum(g, &densities);
        let of_all = g.div(own, total);
        let alone = g.div(jacobian, drawn.share);
        jacobian = g.mul(alone, of_all);
    }
    let zero = g.scalar(0.0);
    let normal = g.constant(&[1, 3], &[0.0, 0.0, 1.0]);
    let answers = [(wi, normal), (weight, zero), (jacobian, zero)];
    for (port, (value, fallback)) in spec.role.graph_outputs().iter().zip(answers) {
        let value = answer(g, query.valid, value, fallback);
        g.output(port, value);
    }
}

/// Where a sample lands.
struct Place {
    /// Folded direction, `[N, 3]`.
    direction: Value,
    /// Its solid angle per area of the square, sr.
    area: Value,
    /// Signed determinant of u ↦ square.
    det: Value,
}

impl Place {
    fn in_chart(g: &mut Graph, chart: Chart, u: &Square, steering: Dual) -> Place {
        let (square, det) = warp(g, u, steering);
        let (direction, area) = chart.square_to_direction(g, &square);
        Place { direction, area, det }
    }
}

/// The chart, of two, that a query draws from.
struct Drawn {
    is_first: Value,
    chart: Chart,
    share: Value,
    /// u with its first component stretched over the chart.
    u: Square,
}

impl Drawn {
    fn new(g: &mut Graph, charts: [Chart; 2], [first, second]: [Value; 2], u: Value) -> Drawn {
        g.scope("draw");
        let [u0, u1] = g.columns(u);
        let is_first = g.less(u0, first);
        // Distances from both ends of the chart, each where it keeps its digits: the first end of the second chart has
        // lost them to the split already.
        let to_end = {
            let (of_first, of_second) = (g.sub(first, u0), g.one_minus(u0));
            g.select(is_first, of_first, of_second)
        };
        let share = g.select(is_first, first, second);
        let complement = g.div(to_end, share);
        let low = {
            let (of_first, of_second) = (g.div(u0, first), g.one_minus(complement));
            g.select(is_first, of_first, of_second)
        };
        let [low, complement] = [low, complement].map(|part| {
            let (least, most) = (g.scalar(U_MIN as f32), g.scalar(1.0 - U_MIN as f32));
            let raised = g.max(part, least);
            g.min(raised, most)
        });
        let rest = g.one_minus(u1);
        let [one, other] = charts;
        Drawn {
            chart: Chart::select(g, is_first, one, other),
            u: Square {
                position: g.concat(&[low, u1]),
                complement: g.concat(&[complement, rest]),
            },
            share,
            is_first,
        }
    }
}

/// The outputs that steer the position, with their tangents, and the logarithm of the learned weight.
fn outputs(g: &mut Graph, network: &Network, point: &Point) -> (Dual, Value) {
    g.scope("net");
    let features = point.features_along_u(g, &network.spec.inputs);
    let (last, hidden) = network
        .net
        .split_last()
        .expect("a network has at least its last layer");
    let trunk = hidden_dual(g, "net", hidden, network.spec.activation, features);
    let name = format!("net.{}", hidden.len());
    let steering = Affine::new(g, &format!("{name}.shift"), last, 0..STEERING_OUTPUTS);
    let weight = Affine::new(g, &format!("{name}.weight"), last, STEERING_OUTPUTS..last.outputs);
    (steering.dual(g, &trunk), weight.value(g, trunk.value()))
}
