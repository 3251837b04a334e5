//! Where charts start from, as graph operations: the f32 counterpart of `bake_runtime::anchor`.

use crate::boost::Boost;
use crate::graph::{Graph, Value};
use bake_runtime::anchor::{PULL, VARIANCE_MAX};
use bake_runtime::spec::{ChartsSpec, Roughness};

/// The start of a mirrored lobe; every value is `[N, 1]`.
#[derive(Clone, Copy)]
pub struct Start {
    /// First diagonal element of the frame's matrix.
    pub x: Value,
    /// Second diagonal element.
    pub y: Value,
    /// Its shear.
    pub shear: Value,
    /// Where the lobe lies.
    pub boost: Boost,
}

impl Start {
    /// The analytic mirror chart of `charts` at the folded `wo` `[N, 3]`, where the free parameters are `params`.
    pub fn mirror(g: &mut Graph, charts: &ChartsSpec, params: &[Value], wo: Value) -> Start {
        g.scope("anchor");
        let alpha = charts.alpha.map(|roughness| roughness_at(g, roughness, params));
        let [x, y, z] = g.columns(wo);
        let (xx, yy) = (g.mul(x, x), g.mul(y, y));
        let sin2 = g.add(xx, yy);
        let chord = chord(g, alpha, [x, y]);
        let area = g.mul(alpha[0], alpha[1]);
        let spread = g.mul(area, sin2);
        let width = g.div(spread, chord);
        let pull = g.mul_scalar(width, PULL as f32);
        let d = g.add(z, pull);
        let dd = g.mul(d, d);
        let length2 = g.add(dd, sin2);
        let length = g.unary("Sqrt", length2);
        let (beta, cos) = ([x, y].map(|c| g.div(c, length)), g.div(d, length));
        shape(g, alpha, Boost { beta, cos })
    }

    /// What networks are told about it, `[N, 6]`.
    pub fn scalars(&self, g: &mut Graph) -> Value {
        g.scope("anchor");
        let [log_x, log_y] = [self.x, self.y].map(|size| {
            let log = g.unary("Log", size);
            let half = g.mul_scalar(log, 0.5);
            g.add_scalar(half, 1.0)
        });
        let square = g.mul(self.shear, self.shear);
        let longer = g.add_scalar(square, 1.0);
        let length = g.unary("Sqrt", longer);
        let shear = g.div(self.shear, length);
        let [bx, by] = self.boost.beta;
        g.concat(&[bx, by, self.boost.cos, log_x, log_y, shear])
    }
}

fn roughness_at(g: &mut Graph, roughness: Roughness, params: &[Value]) -> Value {
    match roughness {
        Roughness::Fixed(value) => g.scalar(value as f32),
        Roughness::Free {
            parameter,
            factor,
            power,
        } => {
            let value = params[parameter];
            let power = if power == 1 { value } else { g.mul(value, value) };
            let scaled = g.mul_scalar(power, factor as f32);
            let least = g.scalar(Roughness::MIN as f32);
            g.max(scaled, least)
        }
    }
}

/// |(α_x·y, α_y·x)|, not 0.
fn chord(g: &mut Graph, alpha: [Value; 2], [x, y]: [Value; 2]) -> Value {
    let (a, b) = (g.mul(alpha[0], y), g.mul(alpha[1], x));
    let (aa, bb) = (g.mul(a, a), g.mul(b, b));
    let square = g.add(aa, bb);
    let length = g.unary("Sqrt", square);
    let least = g.scalar(f32::MIN_POSITIVE);
    g.max(length, least)
}

/// The frame of the start with `boost` over the roughness `alpha`.
///
/// 1 − k·β_x² with k = 1/(1 + cos) is formed as cos + k·β_y²: no difference loses what little it is next to the horizon.
fn shape(g: &mut Graph, alpha: [Value; 2], boost: Boost) -> Start {
    let Boost { beta: [bx, by], cos } = boost;
    let quarter = g.scalar(0.25);
    let [qx, qy] = alpha.map(|a| {
        let square = g.mul(a, a);
        g.div(quarter, square)
    });
    let above = g.add_scalar(cos, 1.0);
    let [kx, ky] = [bx, by].map(|b| g.div(b, above));
    let (kxx, kxy, kyy) = (g.mul(kx, bx), g.mul(kx, by), g.mul(ky, by));
    // S⁻¹, with the sign of its mixed element turned.
    let (sxx, sxy, syy) = (g.add(cos, kyy), kxy, g.add(cos, kxx));
    let (sxx2, sxy2, syy2) = (g.mul(sxx, sxx), g.mul(sxy, sxy), g.mul(syy, syy));
    let sum_of = |g: &mut Graph, a: Value, b: Value| {
        let (a, b) = (g.mul(a, qx), g.mul(b, qy));
        g.add(a, b)
    };
    let (pxx, pyy) = (sum_of(g, sxx2, sxy2), sum_of(g, sxy2, syy2));
    let (over, under) = (g.mul(sxx, sxy), g.mul(sxy, syy));
    let negated_pxy = sum_of(g, over, under);
    let least = (1.0 / VARIANCE_MAX) as f32;
    let capped_yy = g.add_scalar(pyy, least);
    let det = {
        let (cos2, qq) = (g.mul(cos, cos), g.mul(qx, qy));
        let product = g.mul(cos2, qq);
        let trace = g.add(pxx, capped_yy);
        let rest = g.mul_scalar(trace, least);
        g.add(product, rest)
    };
    let (root_yy, root) = (g.unary("Sqrt", capped_yy), g.unary("Sqrt", det));
    let one = g.scalar(1.0);
    Start {
        x: g.div(root_yy, root),
        y: g.div(one, root_yy),
        shear: g.div(negated_pxy, root),
        boost,
    }
}
