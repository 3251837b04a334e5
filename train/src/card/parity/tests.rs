//! Differences of known size between runners, and what is no difference: the rim of the disk.

use super::*;
use crate::card::fake;
use crate::presets::Preset;
use crate::training::mlp::Mlp;
use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::network::Dense;
use bake_runtime::{Family, Network, NetworkSpec, Points, Role};

/// f32 through the layers and heads of a network with charts.
const CHARTS_TOL: f64 = 1e-3;
/// The same on the disk, next to [`HEIGHT_MARGIN`].
const DISK_TOL: f64 = 0.02;
/// What is planted, and round-off of f32 in it.
const PLANTED: f32 = 0.125;
/// See [`PLANTED`].
const PLANTED_TOL: f64 = 1e-5;
/// The query whose answer is wrong.
const SPOILT: usize = 5000;

/// Untrained networks of `preset`; the outputs of the sampling network are `spread` times as large.
fn networks(preset: Preset, material: &Material, spread: f32) -> BakedMaterial {
    let mut rng = Rng::new(&[0x9a]);
    let mut network = |role: Role| {
        let spec: NetworkSpec = preset.spec(role, material).expect("can be baked");
        let mut layers = |shapes: &[(usize, usize)]| Mlp::random(shapes, &mut rng).to_dense();
        // Without steering the charts are the analytic ones, the same for all three.
        let mut frame = match spec.frame_layers()[..] {
            [] => Vec::new(),
            ref shapes => layers(shapes),
        };
        let clear = |v: &mut f32| *v = 0.0;
        let numbers =
            |l: &mut Dense, f: &dyn Fn(&mut f32)| l.weight.iter_mut().chain(&mut l.bias).for_each(f);
        frame.iter_mut().for_each(|l| numbers(l, &clear));
        let mut net = layers(&spec.layers());
        if let (Role::Sample, Some(last)) = (role, net.last_mut()) {
            numbers(last, &|v| *v *= spread);
        }
        Network { spec, frame, net }
    };
    BakedMaterial {
        sample: network(Role::Sample),
        eval: network(Role::Eval),
        pdf: network(Role::Pdf),
    }
}

fn metal() -> BakedMaterial {
    networks(Preset::Warp, &fake::vase(), 1.0)
}

fn lacquer() -> Material {
    Material::fixed("lacquer", Family::Principled, &[("roughness", &[0.3])]).expect("valid parameters")
}

/// Answers as `own` does, but for something that is added to one number in the batch.
struct Spoilt {
    own: NativeBackend,
    column: Option<usize>,
    by: f32,
}

impl Spoilt {
    fn spoil<const N: usize>(&self, first: usize, columns: [&mut [f32]; N]) {
        for (c, column) in columns.into_iter().enumerate() {
            if self.column == Some(first + c) {
                column[SPOILT] += self.by * column[SPOILT].abs().max(1.0);
            }
        }
    }
}

impl Backend for Spoilt {
    fn sample_learned(
        &self,
        points: Points,
        u: [&[f32]; 2],
        [x, y, z]: [&mut [f32]; 3],
        [r, g, b]: [&mut [f32]; 3],
    ) -> bake_runtime::Result<()> {
        self.own.sample_learned(
            points,
            u,
            [&mut *x, &mut *y, &mut *z],
            [&mut *r, &mut *g, &mut *b],
        )?;
        self.spoil(0, [x, y, z, r, g, b]);
        Ok(())
    }

    fn sample_jacobian(
        &self,
        points: Points,
        u: [&[f32]; 2],
        [x, y, z]: [&mut [f32]; 3],
        jacobian: &mut [f32],
    ) -> bake_runtime::Result<()> {
        self.own
            .sample_jacobian(points, u, [&mut *x, &mut *y, &mut *z], &mut *jacobian)?;
        self.spoil(6, [x, y, z, jacobian]);
        Ok(())
    }

    fn eval(&self, points: Points, wi: [&[f32]; 3], [r, g, b]: [&mut [f32]; 3]) -> bake_runtime::Result<()> {
        self.own.eval(points, wi, [&mut *r, &mut *g, &mut *b])?;
        self.spoil(10, [r, g, b]);
        Ok(())
    }

    fn pdf(&self, points: Points, wi: [&[f32]; 3], pdf: &mut [f32]) -> bake_runtime::Result<()> {
        self.own.pdf(points, wi, &mut *pdf)?;
        self.spoil(13, [pdf]);
        Ok(())
    }
}

/// Our kernels, and in place of onnxruntime the same with `by` added to one number of `column`.
fn compared(material: &BakedMaterial, column: Option<usize>, by: f32) -> Parity {
    let native = || NativeBackend::new(material, Tier::best()).expect("sound networks");
    let spoilt = Spoilt {
        own: native(),
        column,
        by,
    };
    let runners = Runners {
        tier: "none",
        native: &native(),
        ort: Some(&spoilt),
        mixture: None,
    };
    parity(material, &runners).expect("it runs")
}

#[test]
fn equal_runners_agree_and_are_near_the_oracle() {
    for material in [metal(), networks(Preset::Warp, &lacquer(), 1.0)] {
        let found = compared(&material, None, 0.0);
        assert_eq!(found.ort_vs_native_max, Some(0.0));
        assert_eq!(found.ort_vs_f64_max, Some(found.native_vs_f64_max));
        let error = found.native_vs_f64_max;
        assert!(error > 0.0 && error < CHARTS_TOL, "{error}");
    }
}

#[test]
fn one_wrong_number_anywhere_is_told_by_its_size() {
    let material = metal();
    for column in 0..OUTPUTS {
        let found = compared(&material, Some(column), PLANTED);
        assert!(found.native_vs_f64_max < CHARTS_TOL, "{found:?}");
        let of_native = found.ort_vs_native_max.unwrap_or(0.0) - f64::from(PLANTED);
        let of_oracle = found.ort_vs_f64_max.unwrap_or(0.0) - f64::from(PLANTED);
        assert!(
            of_native.abs() < PLANTED_TOL && of_oracle.abs() < CHARTS_TOL,
            "{column}: {found:?}"
        );
    }
    let found = compared(&material, Some(13), f32::NAN);
    assert_eq!(found.ort_vs_native_max, Some(f64::MAX));
}

#[test]
fn without_a_second_runner_its_differences_are_null() {
    let material = metal();
    let native = NativeBackend::new(&material, Tier::best()).expect("sound networks");
    let runners = Runners {
        tier: "none",
        native: &native,
        ort: None,
        mixture: None,
    };
    let found = parity(&material, &runners).expect("it runs");
    assert_eq!((found.ort_vs_native_max, found.ort_vs_f64_max), (None, None));
    assert!(found.native_vs_f64_max < CHARTS_TOL);
}

/// Positions on the rim of the disk are no difference between backends.
#[test]
fn the_rim_of_the_disk_is_left_out() {
    let mut material = networks(Preset::Paper, &lacquer(), 4.0);
    if let Some(last) = material.sample.net.last_mut() {
        // Means of x = 0.72 and y = 0.42: what outputs add takes some positions to the rim, and leaves others inside.
        last.bias[..2].copy_from_slice(&[1.8, 0.9]);
    }
    let q = Queries::new(&material.sample.spec.material);
    let left = (0..QUERIES).filter(|i| q.truth(&material, *i).is_none()).count();
    assert!(
        (QUERIES / 20..QUERIES * 19 / 20).contains(&left),
        "{left} left out"
    );
    let error = compared(&material, None, 0.0).native_vs_f64_max;
    assert!(error > 0.0 && error < DISK_TOL, "{error}");
}
