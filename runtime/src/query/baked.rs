//! Questions to a baked material, answered by its networks.

use super::{Answer, Ask, DEFAULT_SAMPLES, Row};
use crate::backend::{Backend, BakedMaterial, Points};
use crate::bsdf::{shifted_r2, usable};
use crate::error::{Error, Result};
use crate::material::Material;
use crate::moments::Moments;
use crate::native::{NativeBackend, Tier};
use crate::random::Rng;
use crate::real::{Real, Vec3};
use std::path::Path;

/// Shifts of the point set behind an albedo, whose spread is its error.
const REPLICATES: u64 = 16;

/// Key of those shifts.
const ALBEDO_KEY: u64 = 0xa1be_d001;

/// The largest f32 below 1, where rounding would leave `[0, 1)`.
const U_LARGEST: f32 = 1.0 - f32::EPSILON / 2.0;

/// A baked material with as many backends as threads have asked at once.
pub struct Baked {
    material: BakedMaterial,
    backend: NativeBackend,
}

impl Baked {
    /// Takes the networks; the native backend runs them at the tier that the environment chooses ([`Tier::chosen`]).
    ///
    /// # Errors
    /// What the backend says of networks that it cannot run.
    pub fn new(material: BakedMaterial) -> Result<Baked> {
        let backend = NativeBackend::new(&material, Tier::chosen()?)?;
        Ok(Baked { material, backend })
    }

    /// Answers as [`super::Subject::answer`] does: `f_cos` of the evaluation network, the density of the pdf network,
    /// the learned weight of a sample beside its Jacobian, the mean learned weight as albedo.
    pub(super) fn answer(&self, row: &Row, seed: u64) -> Result<Answer> {
        let own = &self.material.sample.spec.material;
        let params = free_values(own, &own.narrowed(row.params.clone(), Path::new(""))?)?;
        let params: Vec<&[f32]> = params.iter().map(std::slice::from_ref).collect();
        ask(&self.backend, &params, row, seed)
    }
}

/// The values in `narrowed` of what `material` leaves free.
fn free_values(material: &Material, narrowed: &Material) -> Result<Vec<f32>> {
    let mut values = Vec::new();
    for ((name, setting), (_, given)) in material.parameters.iter().zip(&narrowed.parameters) {
        for (i, (own, given)) in setting.scalars().iter().zip(given.scalars()).enumerate() {
            if own.range().is_some() {
                let value = given
                    .fixed()
                    .map_err(|reason| Error::parameter(setting.label(name, i), reason))?;
                values.push(value as f32);
            }
        }
    }
    Ok(values)
}

/// A structure of arrays of one direction.
fn column(w: Vec3) -> [[f32; 1]; 3] {
    w.to_array().map(|v| [v as f32])
}

fn row_of(columns: [[f32; 1]; 3]) -> [f64; 3] {
    columns.map(|[v]| f64::from(v))
}

fn narrow(u: [Real; 2]) -> [f32; 2] {
    u.map(|v| (v as f32).min(U_LARGEST))
}

fn ask(backend: &dyn Backend, params: &[&[f32]], row: &Row, seed: u64) -> Result<Answer> {
    let wo = column(row.wo);
    let points = Points {
        params,
        wo: wo.each_ref().map(|c| c.as_slice()),
    };
    let (mut rgb, mut pdf) = ([[0.0; 1]; 3], [0.0; 1]);
    match row.ask {
        Ask::Eval { wi } => {
            let wi = column(wi);
            let wi = wi.each_ref().map(|c| c.as_slice());
            backend.eval(points, wi, rgb.each_mut().map(|c| c.as_mut_slice()))?;
            backend.pdf(points, wi, &mut pdf)?;
            Ok(Answer::Eval {
                f_cos: row_of(rgb),
                se: [0.0; 3],
                pdf: pdf[0].into(),
            })
        }
        Ask::Sample { .. } if !usable(row.wo) => Ok(Answer::Sample {
            wi: None,
            weight: [0.0; 3],
            pdf: 0.0,
            jacobian: Some(0.0),
        }),
        Ask::Sample { u } => {
            let u = narrow(u).map(|v| [v]);
            let u = u.each_ref().map(|c| c.as_slice());
            let (mut wi, mut jacobian) = ([[0.0; 1]; 3], [0.0; 1]);
            backend.sample_jacobian(points, u, wi.each_mut().map(|c| c.as_mut_slice()), &mut jacobian)?;
            backend.sample_learned(
                points,
                u,
                wi.each_mut().map(|c| c.as_mut_slice()),
                rgb.each_mut().map(|c| c.as_mut_slice()),
            )?;
            backend.pdf(points, wi.each_ref().map(|c| c.as_slice()), &mut pdf)?;
            Ok(Answer::Sample {
                wi: Some(row_of(wi)),
                weight: row_of(rgb),
                pdf: pdf[0].into(),
                jacobian: Some(jacobian[0].into()),
            })
        }
        Ask::Albedo => albedo(backend, params, row, seed),
    }
}

/// The mean learned weight over an R2 sequence under random shifts.
fn albedo(backend: &dyn Backend, params: &[&[f32]], row: &Row, seed: u64) -> Result<Answer> {
    let each = row.samples.unwrap_or(DEFAULT_SAMPLES).div_ceil(REPLICATES) as usize;
    let wo = row.wo.to_array().map(|v| vec![v as f32; each]);
    let (mut x, mut y) = (vec![0.0; each], vec![0.0; each]);
    let mut wi: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0; each]);
    let mut weight = wi.clone();
    let points = Points {
        params,
        wo: wo.each_ref().map(|c| c.as_slice()),
    };
    let mut replicates = Moments::default();
    for replicate in 0..REPLICATES {
        let shift = Rng::new(&[ALBEDO_KEY, seed, replicate]).pair();
        for (i, (a, b)) in x.iter_mut().zip(&mut y).enumerate() {
            [*a, *b] = narrow(shifted_r2(i as u64, shift));
        }
        backend.sample_learned(
            points,
            [&x, &y],
            wi.each_mut().map(|c| c.as_mut_slice()),
            weight.each_mut().map(|c| c.as_mut_slice()),
        )?;
        let mean = |c: &Vec<f32>| c.iter().map(|v| f64::from(*v)).sum::<f64>() / each as f64;
        replicates.add(Vec3::from_array(weight.each_ref().map(mean)));
    }
    let albedo = replicates.estimate();
    Ok(Answer::Albedo {
        albedo: albedo.mean.to_array(),
        se: albedo.se.to_array(),
    })
}
