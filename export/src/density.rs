//! Graphs of evaluation and pdf networks: (params, wo, wi) ↦ Σ over charts of density · e^output.

use crate::chart::Charts;
use crate::features::Point;
use crate::graph::{Graph, Value};
use crate::layers::forward;
use crate::query::{Query, above_horizon, answer, bounded_exp};
use crate::symmetry::fold;
use bake_runtime::{Network, NetworkSpec, Role};

/// The whole graph of an evaluation or pdf network.
pub fn density(g: &mut Graph, network: &Network) {
    let spec = &network.spec;
    let query = Query::new(g, spec);
    let lit = above_horizon(g, query.other);
    let valid = g.and(query.valid, lit);
    let parts = parts(g, "", network, &query.params, query.wo, query.other);
    g.scope("answer");
    let value = sum(g, &parts);
    let zero = g.scalar(0.0);
    let value = answer(g, valid, value, zero);
    for port in spec.role.graph_outputs() {
        g.output(port, value);
    }
}

/// What a network makes of `params`, `wo` and `wi` `[N, 3]`, of each chart: its density · e^output, `[N, k]`, for a pdf
/// times its share; without charts e^output alone.
///
/// Weights are stored under names that begin with `prefix`.
pub fn parts(
    g: &mut Graph,
    prefix: &str,
    network: &Network,
    params: &[Value],
    wo: Value,
    wi: Value,
) -> Vec<Value> {
    let spec = &network.spec;
    let (wo, turn) = fold(g, spec.symmetry, wo);
    let wi = turn.fold(g, wi);
    let mut point = Point::new(params.to_vec(), wo);
    point.wi = Some(wi);
    let charts = spec
        .charts()
        .map(|of| Charts::predict(g, prefix, network, of, &mut point));
    let mut densities = Vec::new();
    for chart in charts.iter().flat_map(Charts::all) {
        let (local, density) = chart.to_local(g, wi);
        point.local.push(local);
        densities.push(density);
    }

    g.scope("net");
    let features = point.features(g, &spec.inputs);
    let name = format!("{prefix}net");
    let logs = forward(g, &name, &network.net, spec.activation, features);
    let values = bounded_exp(g, logs);
    g.scope("density");
    match (charts, of_charts(g, spec, values)) {
        (Some(Charts::Two(_, shares)), values) if spec.role == Role::Pdf => {
            let weights = densities.iter().zip(shares);
            let weights: Vec<Value> = weights.map(|(&density, share)| g.mul(density, share)).collect();
            products(g, &weights, &values)
        }
        (Some(_), values) => products(g, &densities, &values),
        (None, values) => values,
    }
}

/// a + b + …
pub fn sum(g: &mut Graph, parts: &[Value]) -> Value {
    let (first, rest) = parts.split_first().expect("a network has at least one part");
    rest.iter().fold(*first, |sum, part| g.add(sum, *part))
}

/// The outputs of a network, chart by chart.
fn of_charts(g: &mut Graph, spec: &NetworkSpec, outputs: Value) -> Vec<Value> {
    match spec.charts().map_or(1, |charts| charts.anchors.len()) {
        1 => vec![outputs],
        2 => g.columns::<2>(outputs).to_vec(),
        _ => unreachable!("a checked specification has one or two charts"),
    }
}

fn products(g: &mut Graph, weights: &[Value], values: &[Value]) -> Vec<Value> {
    let pairs = weights.iter().zip(values);
    pairs.map(|(&weight, &value)| g.mul(weight, value)).collect()
}
