//! The boost as graph operations: the f32 counterpart of `bake_runtime::boost`.
//!
//! Deviation in form, not in value: for unit directions 1 − v·β = ½(|v_xy − β|² + v_z² + cos²), a sum of squares that
//! keeps its relative precision where v·β nearly is 1. In the same terms the new x and y are
//! (cos·(v_xy − β) + β·½(cos² − |v_xy − β|² − v_z²)/(1 + cos)) over that sum, whose terms do not exceed it, so that
//! nothing large cancels.

use crate::graph::{Graph, Value};

/// A boost; every value is `[N, 1]`.
#[derive(Clone, Copy)]
pub struct Boost {
    /// Velocity β.
    pub beta: [Value; 2],
    /// √(1 − |β|²), known better than from β.
    pub cos: Value,
}

impl Boost {
    /// Nothing changes.
    pub fn none(g: &mut Graph) -> Boost {
        Boost {
            beta: [g.scalar(0.0); 2],
            cos: g.scalar(1.0),
        }
    }

    /// The boost that undoes this one.
    pub fn inverse(self, g: &mut Graph) -> Boost {
        Boost {
            beta: self.beta.map(|b| g.unary("Neg", b)),
            cos: self.cos,
        }
    }

    /// Where the unit direction `v` goes, and the solid angle there per solid angle at `v`.
    pub fn apply(self, g: &mut Graph, v: [Value; 3]) -> ([Value; 3], Value) {
        let Boost { beta, cos } = self;
        let [dx, dy] = [0, 1].map(|c: usize| g.sub(v[c], beta[c]));
        let [dx2, dy2, z2, cos2] = [dx, dy, v[2], cos].map(|x| g.mul(x, x));
        let distance2 = g.add(dx2, dy2);
        let away = g.add(distance2, z2);
        let sum = g.add(away, cos2);
        let divisor = g.mul_scalar(sum, 0.5);
        let difference = g.sub(cos2, away);
        let half = g.mul_scalar(difference, 0.5);
        let above = g.add_scalar(cos, 1.0);
        let bend = g.div(half, above);
        let [x, y] = [(dx, beta[0]), (dy, beta[1])].map(|(d, beta)| {
            let (straight, bent) = (g.mul(cos, d), g.mul(bend, beta));
            let sum = g.add(straight, bent);
            g.div(sum, divisor)
        });
        let scale = g.div(cos, divisor);
        let z = g.mul(scale, v[2]);
        ([x, y, z], g.mul(scale, scale))
    }
}
