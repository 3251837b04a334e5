//! The exact assignment against another's: the network simplex of POT (Flamary et al. 2021, *POT: Python Optimal
//! Transport*), on the points of three slices from narrow to broad.

mod support;

use bake_runtime::bsdf::direction;
use bake_runtime::conductor::Conductor;
use bake_train::lobes::LUMINANCE;
use bake_train::spline::cell_centre;
use bake_train::transport::points::{row_column_points, source_points};
use bake_train::transport::raster::Raster;
use bake_train::transport::{assignment, kantorovich, sinkhorn};
use glam::DVec3;
use serde_json::{Value, json};
use std::process::Command;
use support::python::python;

/// Two exact solvers in double precision, whose sums of a thousand terms are in another order.
const COST_TOL: f64 = 1e-9;
/// Cells per side of the map: 1024 points, which POT solves in a fraction of a second.
const SIDE: usize = 32;
/// Pixels per side of a slice, as the paper has it.
const PIXELS: usize = 128;
/// Roughness along x and y, and θ of `wo` in degrees.
const SLICES: [([f64; 2], f64); 3] = [([0.3, 0.1], 45.0), ([0.05, 0.05], 60.0), ([0.6, 0.6], 80.0)];

const SOLVE: &str = r#"
import json, sys
import numpy as np
import ot

costs = []
for problem in json.load(open(sys.argv[1])):
    x, y = (np.array(problem[key]) for key in ("source", "target"))
    matrix = ((x[:, None] - y[None]) ** 2).sum(axis=-1)
    costs.append(ot.emd2([], [], matrix, numItermax=10_000_000))
print(json.dumps([float(cost) for cost in costs]))
"#;

#[test]
fn the_cost_is_that_of_the_network_simplex_of_pot() {
    let source = source_points(SIDE);
    let targets = SLICES.map(|(alpha, theta)| row_column_points(&slice(alpha, theta), SIDE * SIDE));
    let problems: Vec<Value> = targets
        .iter()
        .map(|target| json!({"source": source, "target": target}))
        .collect();
    for ((target, slice), theirs) in targets.iter().zip(SLICES).zip(costs_of_pot(&problems)) {
        let cold = assignment::solve(&source, target, None).unwrap_or_else(|e| panic!("{e}"));
        let problem = sinkhorn::Problem::new(&source, target).expect("not empty");
        let [_, start] = problem.solve(|| Ok(())).expect("nothing breaks").duals;
        let warm = assignment::solve(&source, target, Some(&start)).unwrap_or_else(|e| panic!("{e}"));
        for ours in [cold.cost, warm.cost] {
            assert!(
                (ours / theirs - 1.0).abs() <= COST_TOL,
                "{slice:?}: {ours} and {theirs}"
            );
        }
        let bound = kantorovich::lower_bound(&source, target, &start);
        assert!(
            bound <= theirs * (1.0 + COST_TOL),
            "{slice:?}: {bound} above {theirs}"
        );
    }
}

/// Single scattering of gold's luminance on the disk.
fn slice(alpha: [f64; 2], theta_deg: f64) -> Raster {
    let gold = Conductor::new(alpha, [1.0, 0.782, 0.344]).unwrap_or_else(|e| panic!("{e}"));
    let wo = direction(theta_deg, 0.0);
    let values: Vec<f64> = (0..PIXELS * PIXELS)
        .map(|k| {
            let [x, y] = cell_centre(k, PIXELS).map(|u| 2.0 * u - 1.0);
            let z2 = 1.0 - x * x - y * y;
            // dx dy = cos θ dω, so the disk holds f without the cosine.
            if z2 > 0.0 {
                gold.single(wo, DVec3::new(x, y, z2.sqrt())).dot(LUMINANCE) / z2.sqrt()
            } else {
                0.0
            }
        })
        .collect();
    Raster::new(PIXELS, &values).unwrap_or_else(|e| panic!("{e}"))
}

fn costs_of_pot(problems: &[Value]) -> Vec<f64> {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let path = folder.path().join("problems.json");
    let text = serde_json::to_string(problems).expect("finite numbers");
    std::fs::write(&path, text).expect("a temporary folder can be written");
    let output = Command::new(python()).args(["-c", SOLVE]).arg(&path).output();
    let output = output.expect("the interpreter starts");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let costs: Vec<f64> = serde_json::from_slice(&output.stdout).expect("one list of numbers");
    assert_eq!(costs.len(), problems.len());
    costs
}
