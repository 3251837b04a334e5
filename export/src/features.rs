//! From a query to the features that enter a network: the graph counterpart of `bake_runtime::features`.

use crate::encoding::{encode, encode_with_slopes, scaled};
use crate::graph::{Graph, Value};
use bake_runtime::encoding::{Encoding, Quantity};
use bake_runtime::spec::Input;
use std::ops::Range;

/// Everything that inputs are made of, as far as it is known; a checked specification asks for nothing else.
pub struct Point {
    /// Free parameters, `[N, 1]` each.
    pub params: Vec<Value>,
    /// Camera direction, folded, `[N, 3]`.
    pub wo: Value,
    /// Scalars of the analytic mirror chart, `[N, 6]`.
    pub anchor: Option<Value>,
    /// Uniform numbers of the drawn chart, `[N, 2]`.
    pub u: Option<Value>,
    /// +1 or −1 for the drawn chart, `[N, 1]`.
    pub chart: Option<Value>,
    /// Light direction, folded, `[N, 3]`.
    pub wi: Option<Value>,
    /// The same in the frame of every chart.
    pub local: Vec<Value>,
}

/// Features of a sampling network.
pub struct Features {
    /// All of them, `[N, k]`.
    pub value: Value,
    /// Those that depend on u.
    pub moving: Vec<Moving>,
}

/// Features that depend on u.
pub struct Moving {
    /// Their places among all features.
    pub columns: Range<usize>,
    /// Their derivatives along u₀ and u₁, `[2, N, columns]`, or `[2, 1, columns]` where every query has the same.
    pub tangents: Value,
}

impl Point {
    /// The point at `params` and the folded `wo`.
    pub fn new(params: Vec<Value>, wo: Value) -> Point {
        Point {
            params,
            wo,
            anchor: None,
            u: None,
            chart: None,
            wi: None,
            local: Vec::new(),
        }
    }

    /// Features of `inputs`, `[N, k]`.
    pub fn features(&self, g: &mut Graph, inputs: &[Input]) -> Value {
        let parts: Vec<Value> = inputs
            .iter()
            .map(|input| {
                let scalars = self.scalars(g, input.quantity);
                let scaled = scaled(g, input.scale, scalars);
                encode(g, input.encoding, scaled, input.quantity.scalars())
            })
            .collect();
        g.concat(&parts)
    }

    /// The same with derivatives along u.
    pub fn features_along_u(&self, g: &mut Graph, inputs: &[Input]) -> Features {
        let mut parts = Vec::new();
        let mut moving = Vec::new();
        let mut start = 0;
        for input in inputs {
            let columns = start..start + input.features();
            start = columns.end;
            match input.quantity {
                Quantity::U => {
                    let u = self.scalars(g, Quantity::U);
                    let (value, tangents) = along_u(g, input.encoding, u);
                    parts.push(value);
                    moving.push(Moving { columns, tangents });
                }
                _ => parts.push(self.features(g, std::slice::from_ref(input))),
            }
        }
        Features {
            value: g.concat(&parts),
            moving,
        }
    }

    fn scalars(&self, g: &mut Graph, quantity: Quantity) -> Value {
        let disk = |g: &mut Graph, w: Value| {
            let [x, y, _] = g.columns(w);
            g.concat(&[x, y])
        };
        let known = |value: Option<Value>| value.expect("a checked specification takes what its role has");
        match quantity {
            Quantity::U => known(self.u),
            Quantity::Wo => self.wo,
            Quantity::WoDisk => disk(g, self.wo),
            Quantity::WiDisk => disk(g, known(self.wi)),
            Quantity::Local(chart) => self.local[chart],
            Quantity::Anchor => known(self.anchor),
            Quantity::Parameter(parameter) => self.params[parameter],
            Quantity::Chart => known(self.chart),
        }
    }
}

/// Features of `u` `[N, 2]` and their derivatives: the first half depends on u₀ alone, the second on u₁.
fn along_u(g: &mut Graph, encoding: Encoding, u: Value) -> (Value, Value) {
    let scalars = Quantity::U.scalars();
    let (value, slopes) = encode_with_slopes(g, encoding, u, scalars);
    let each = encoding.features(1);
    let mut own = vec![0.0; 4 * each];
    own[..each].fill(1.0);
    own[3 * each..].fill(1.0);
    let own = g.constant(&[2, 1, scalars * each], &own);
    (value, g.mul(slopes, own))
}
