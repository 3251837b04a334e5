//! Queries of a material, and what is promised of every answer.

use bake_runtime::encoding::{Encoding, Quantity};
use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::spec::Input;
use bake_runtime::{Backend, BakedMaterial, Dense, Network, Points, Role};

/// Stated in the interface: `wi` has unit length within this.
const UNIT_TOL: f32 = 1e-6;

/// One query; parameters beyond these repeat them.
#[derive(Clone, Copy, Debug)]
pub struct Query {
    pub params: [f32; 2],
    pub wo: [f32; 3],
    pub wi: [f32; 3],
    pub u: [f32; 2],
}

/// Bytes that [`Query::read`] takes.
pub const QUERY_BYTES: usize = 40;

impl Query {
    /// Ordinary, at the horizon, and of nothing but NaN.
    pub const ALL: [Query; 3] = [
        Query {
            params: [0.3, 0.8],
            wo: [0.6, 0.0, 0.8],
            wi: [-0.36, 0.48, 0.8],
            u: [0.25, 0.75],
        },
        Query {
            params: [0.0, 1.0],
            wo: [0.0, -1.0, 1e-20],
            wi: [1.0, 0.0, 1e-7],
            u: [0.0, 1.0],
        },
        Query {
            params: [f32::NAN; 2],
            wo: [f32::NAN; 3],
            wi: [f32::NAN; 3],
            u: [f32::NAN; 2],
        },
    ];

    /// The query in `bytes`: any numbers.
    pub fn read(bytes: &[u8; QUERY_BYTES]) -> Query {
        let at = |i: usize| f32::from_le_bytes([0, 1, 2, 3].map(|k: usize| bytes[4 * i + k]));
        Query {
            params: [at(0), at(1)],
            wo: [at(2), at(3), at(4)],
            wi: [at(5), at(6), at(7)],
            u: [at(8), at(9)],
        }
    }
}

/// The material of `network` and the smallest other two that go with it.
pub fn complete(network: Network) -> BakedMaterial {
    let [sample, eval, pdf] = Role::ALL.map(|role| match role == network.spec.role {
        true => network.clone(),
        false => other(&network, role),
    });
    BakedMaterial { sample, eval, pdf }
}

/// A network of the same material and charts that knows `wo` alone.
fn other(network: &Network, role: Role) -> Network {
    let mut spec = network.spec.clone();
    spec.role = role;
    spec.inputs = vec![Input::plain(Quantity::Wo, Encoding::Identity)];
    spec.hidden = Vec::new();
    let layer = |(inputs, outputs): (usize, usize)| Dense {
        weight: vec![0.5; inputs * outputs],
        bias: vec![0.0; outputs],
        inputs,
        outputs,
    };
    let net = spec.layers().into_iter().map(layer).collect();
    Network {
        frame: network.frame.clone(),
        spec,
        net,
    }
}

/// Answers `queries` in one batch on the slowest and the fastest tier. Panics unless all answers are finite, weights and
/// densities not negative and directions unit.
///
/// # Errors
/// Those of [`NativeBackend::new`], as texts.
pub fn answer(material: &BakedMaterial, queries: &[Query]) -> Result<(), String> {
    let free = material.sample.spec.material.free().len();
    let column = |of: &dyn Fn(&Query) -> f32| queries.iter().map(of).collect::<Vec<f32>>();
    let params: Vec<Vec<f32>> = (0..free).map(|p| column(&|q| q.params[p % 2])).collect();
    let params: Vec<&[f32]> = params.iter().map(Vec::as_slice).collect();
    let [wo, wi] = [0, 1]
        .map(|side: usize| [0, 1, 2].map(|c: usize| column(&|q| if side == 0 { q.wo[c] } else { q.wi[c] })));
    let u = [0, 1].map(|c: usize| column(&|q| q.u[c]));
    let points = Points {
        params: &params,
        wo: wo.each_ref().map(Vec::as_slice),
    };
    let wi = wi.each_ref().map(Vec::as_slice);
    let u = u.each_ref().map(Vec::as_slice);
    for tier in [Tier::Scalar, Tier::best()] {
        let backend = &mut NativeBackend::new(material, tier).map_err(|e| e.to_string())?;
        let one = || vec![f32::NAN; queries.len()];
        let three = || [one(), one(), one()];
        let (mut drawn, mut weight, mut f_cos) = ([three(), three(), three()], three(), three());
        let [mut jacobian, mut mixture, mut pdf, mut exact] = [one(), one(), one(), one()];
        let [learned, by_jacobian, by_mixture] = &mut drawn;
        let sound = "lengths agree";
        backend
            .sample_learned(points, u, slices(learned), slices(&mut weight))
            .expect(sound);
        backend
            .sample_jacobian(points, u, slices(by_jacobian), &mut jacobian)
            .expect(sound);
        backend
            .sample_mixture(points, u, slices(by_mixture), &mut mixture)
            .expect(sound);
        backend.eval(points, wi, slices(&mut f_cos)).expect(sound);
        backend.pdf(points, wi, &mut pdf).expect(sound);
        match material.sample.spec.charts() {
            Some(_) => drop(backend.exact_pdf(points, wi, &mut exact).expect(sound)),
            None => exact.fill(0.0),
        }
        for (name, column) in [("jacobian", &jacobian), ("mixture", &mixture)] {
            assert!(
                column.iter().all(|v| v.is_finite()),
                "{tier:?}: {name} is {column:?}"
            );
        }
        let positive = weight
            .iter()
            .map(|c| ("weight", c))
            .chain(f_cos.iter().map(|c| ("f_cos", c)));
        for (name, column) in positive.chain([("pdf", &pdf), ("exact pdf", &exact)]) {
            let sound = column.iter().all(|v| v.is_finite() && *v >= 0.0);
            assert!(sound, "{tier:?}: {name} is {column:?}");
        }
        for [x, y, z] in &drawn {
            for (i, query) in queries.iter().enumerate() {
                let wi = [x[i], y[i], z[i]];
                assert!(wi.iter().all(|v| v.is_finite()), "{tier:?}: wi is {wi:?}");
                // Directions that are not unit give others that are not.
                if (length(query.wo) - 1.0).abs() < UNIT_TOL {
                    let sound = (length(wi) - 1.0).abs() < UNIT_TOL && wi[2] > 0.0;
                    assert!(sound, "{tier:?}: wi is {wi:?}, of length {}", length(wi));
                }
            }
        }
    }
    Ok(())
}

fn length(w: [f32; 3]) -> f32 {
    let [x, y, z] = w.map(f64::from);
    (x * x + y * y + z * z).sqrt() as f32
}

fn slices(columns: &mut [Vec<f32>; 3]) -> [&mut [f32]; 3] {
    columns.each_mut().map(Vec::as_mut_slice)
}
