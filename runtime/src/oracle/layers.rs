//! Dense layers on values and their tangents.

use crate::network::Dense;
use crate::spec::Activation;

/// Layers on a value and its tangents: `columns[0]` is the value, the rest are directional derivatives.
pub fn forward(layers: &[Dense], activation: Activation, columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut columns = columns.to_vec();
    for (i, layer) in layers.iter().enumerate() {
        let mut next: Vec<Vec<f64>> = Vec::new();
        for (c, column) in columns.iter().enumerate() {
            let rows = layer.weight.chunks_exact(layer.inputs);
            let dot = rows.map(|row| {
                row.iter()
                    .zip(column)
                    .map(|(&w, x)| f64::from(w) * x)
                    .sum::<f64>()
            });
            next.push(match c {
                0 => dot.zip(&layer.bias).map(|(v, &b)| v + f64::from(b)).collect(),
                _ => dot.collect(),
            });
        }
        if i + 1 < layers.len() {
            let slopes: Vec<(f64, f64)> = next[0].iter().map(|&x| activate(activation, x)).collect();
            for (c, column) in next.iter_mut().enumerate() {
                for (v, (value, slope)) in column.iter_mut().zip(&slopes) {
                    *v = if c == 0 { *value } else { *v * slope };
                }
            }
        }
        columns = next;
    }
    columns
}

/// Value and derivative of the activation.
fn activate(activation: Activation, x: f64) -> (f64, f64) {
    match activation {
        Activation::Silu => {
            let sigmoid = 1.0 / (1.0 + (-x).exp());
            (x * sigmoid, sigmoid * (1.0 + x * (1.0 - sigmoid)))
        }
        Activation::Relu => match x > 0.0 {
            true => (x, 1.0),
            false => (0.0, 0.0),
        },
    }
}
