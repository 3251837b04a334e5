//! Writes the seeds of all targets, `corpus/TARGET/seed-*`: small networks of every kind, and small tables.

use bake_runtime::imported::{FORMAT, FORMAT_KEY};
use bake_runtime::network::parse_spec;
use bake_runtime::{BakedMaterial, Dense, Network, Rng, Role};
use bake_runtime_fuzz::mutation::join;
use bake_runtime_fuzz::queries::{QUERY_BYTES, Query, answer};
use serde_json::{Value, json};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    for (name, material, geometry, symmetry) in kinds() {
        let (mut files, mut networks) = (Vec::new(), Vec::new());
        for role in Role::ALL {
            let spec = spec(role, &material, &geometry, symmetry).to_string();
            let network = with_weights(&spec)?;
            let bytes = network.to_bytes();
            write("spec", &format!("{name}-{}", role.name()), spec.as_bytes())?;
            write("network", &format!("{name}-{}", role.name()), &bytes)?;
            files.push(bytes);
            networks.push(network);
        }
        if let Ok([sample, eval, pdf]) = <[Network; 3]>::try_from(networks) {
            answer(&BakedMaterial { sample, eval, pdf }, &Query::ALL)?;
        }
        let query: Vec<u8> = [0.3f32, 0.8, 0.6, 0.0, 0.8, -0.48, 0.36, 0.8, 0.1, 0.9]
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        assert_eq!(query.len(), QUERY_BYTES);
        let lengths = [u16::try_from(files[0].len())?, u16::try_from(files[1].len())?].map(u16::to_le_bytes);
        write(
            "material",
            name,
            &[&query, lengths.as_flattened(), &files.concat()].concat(),
        )?;
    }
    write("slices", "isotropic", &table(0, &[0.0], 4, 5))?;
    write("slices", "anisotropic", &table(1, &[0.0, 120.0, 240.0], 3, 2))?;
    Ok(())
}

fn write(target: &str, name: &str, bytes: &[u8]) -> std::io::Result<()> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target);
    std::fs::create_dir_all(&folder)?;
    std::fs::write(folder.join(format!("seed-{name}")), bytes)
}

/// Name, material, geometry and symmetry.
fn kinds() -> [(&'static str, Value, Value, &'static str); 4] {
    let charts = |anchors: Value, alpha: Value| {
        let inputs = json!([
            {"quantity": "wo", "encoding": "grazing"},
            {"quantity": "anchor", "encoding": "identity"},
        ]);
        json!({"charts": {"anchors": anchors, "alpha": alpha, "inputs": inputs, "hidden": [3]}})
    };
    let fixed = |alpha: f64| json!({"fixed": alpha});
    let free = |power: u8| json!({"free": {"parameter": 0, "factor": 1.0, "power": power}});
    [
        (
            "one-chart",
            json!({"name": "a", "family": "conductor", "alpha": [0.3, 0.1], "reflectance": [1, 0.8, 0.3]}),
            charts(json!(["mirror"]), json!([fixed(0.3), fixed(0.1)])),
            "quadrant",
        ),
        (
            "two-charts",
            json!({"name": "b", "family": "principled", "roughness": {"min": 0.1, "max": 1}, "metallic": {"min": 0, "max": 1}}),
            charts(json!(["mirror", "diffuse"]), json!([free(2), free(2)])),
            "rotation",
        ),
        (
            "layered",
            json!({"name": "c", "family": "layered", "alpha": {"min": 0.01, "max": 1}, "sigma_t": 1, "albedo": [0.9, 0.5, 0.1],
                "base": [0.5, 0.4, 0.3], "g": {"min": -0.5, "max": 0.5}}),
            charts(json!(["diffuse", "mirror"]), json!([free(1), fixed(0.2)])),
            "rotation",
        ),
        (
            "disk",
            json!({"name": "d", "family": "conductor", "alpha": [{"min": 0.1, "max": 0.5}, {"min": 0.2, "max": 0.9}], "ior": "Au"}),
            json!("disk"),
            "quadrant",
        ),
    ]
}

fn spec(role: Role, material: &Value, geometry: &Value, symmetry: &str) -> Value {
    let plain = |quantity: Value, encoding: Value| json!({"quantity": quantity, "encoding": encoding});
    let mut inputs = vec![plain(json!("wo_disk"), json!({"frequency": 2}))];
    let charts = geometry
        .pointer("/charts/anchors")
        .and_then(Value::as_array)
        .map_or(0, Vec::len);
    match role {
        Role::Sample => inputs.push(plain(json!("u"), json!({"one_blob": 2}))),
        Role::Eval | Role::Pdf => inputs.push(plain(json!("wi_disk"), json!("centred"))),
    }
    if role == Role::Sample && charts > 1 {
        inputs.push(plain(json!("chart"), json!("identity")));
    }
    if role != Role::Sample && charts > 0 {
        inputs.push(plain(json!({"local": charts - 1}), json!("slant")));
    }
    if material.to_string().contains("min") {
        let scale = json!({"sqrt": [0.1, 1]});
        inputs.push(json!({"quantity": {"parameter": 0}, "scale": scale, "encoding": "centred"}));
    }
    json!({
        "format": 2, "role": role.name(), "material": material, "symmetry": symmetry, "inputs": inputs,
        "hidden": if role == Role::Eval { vec![4, 2] } else { vec![4] },
        "activation": if charts == 0 { "relu" } else { "silu" }, "geometry": geometry,
    })
}

/// A network of `spec` with random weights in ±1.
fn with_weights(spec: &str) -> Result<Network, String> {
    let spec = parse_spec(spec)?;
    let mut rng = Rng::new(&[spec.role as u64]);
    let mut numbers = |count: usize| (0..count).map(|_| (2.0 * rng.uniform() - 1.0) as f32).collect();
    let mut layers = |shapes: Vec<(usize, usize)>| -> Vec<Dense> {
        let layer = |(inputs, outputs)| Dense {
            weight: numbers(inputs * outputs),
            bias: numbers(outputs),
            inputs,
            outputs,
        };
        shapes.into_iter().map(layer).collect()
    };
    let frame = layers(spec.frame_layers());
    let net = layers(spec.layers());
    Ok(Network { spec, frame, net })
}

/// A table of two θ with `params` parameters of two values.
fn table(params: usize, phi: &[f32], height: usize, width: usize) -> Vec<u8> {
    let mut rows: Vec<Vec<f32>> = vec![vec![]];
    for axis in vec![&[0.1, 0.5][..]; params]
        .into_iter()
        .chain([&[0.0, 60.0], phi])
    {
        let longer = |row: &Vec<f32>| {
            axis.iter()
                .map(|&v| [&row[..], &[v]].concat())
                .collect::<Vec<_>>()
        };
        rows = rows.iter().flat_map(longer).collect();
    }
    let n = rows.len();
    let column =
        |range: std::ops::Range<usize>| rows.iter().flat_map(|row| row[range.clone()].to_vec()).collect();
    let pixels = vec![0.25; n * height * width * 3];
    let tensors: [(&str, Vec<usize>, Vec<f32>); 3] = [
        ("params", vec![n, params], column(0..params)),
        ("wo", vec![n, 2], column(params..params + 2)),
        ("f_cos", vec![n, height, width, 3], pixels),
    ];
    let mut header = json!({"__metadata__": {FORMAT_KEY: FORMAT, "description": "a seed"}});
    let mut data: Vec<u8> = Vec::new();
    for (name, shape, values) in tensors {
        let start = data.len();
        data.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        header[name] = json!({"dtype": "F32", "shape": shape, "data_offsets": [start, data.len()]});
    }
    join(header.to_string().as_bytes(), &data)
}
