//! Samplers side by side at the held-out places of a material.

use super::SliceSampler;
use super::measure::{Errors, measure};
use crate::Tick;
use crate::card::heldout::{self, HeldOut};
use crate::card::truth::Truth;
use crate::card::{Bias, Spread};
use crate::error::Result;
use crate::maps::advance;
use bake_runtime::Material;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;
use std::sync::atomic::AtomicU64;

/// Makes the sampler of one place; every place is measured on a thread of its own.
pub type Contender<'a> = &'a (dyn Fn(&HeldOut, &Truth) -> Result<Box<dyn SliceSampler>> + Sync);

/// Errors of one sampler over one stratum of held-out places, as [`Errors`] has them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Standing {
    /// Σ over bins of |share of samples − true mass|.
    pub binning_l1: Spread,
    /// What a perfect sampler would score.
    pub binning_floor: f64,
    /// Share of u that gives no direction.
    pub lost: f64,
    /// Variance over squared mean of the weight, of the sampler alone.
    pub weight_relvar: Spread,
    /// Largest weight.
    pub weight_max: f64,
    /// Of the weight f_cos · jacobian.
    pub albedo_bias: Bias,
}

/// Errors of one sampler over all strata.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Standings {
    /// Per stratum: `theta_0_75`, `theta_75_85`, `theta_85_89`.
    pub strata: BTreeMap<String, Standing>,
    /// Over all of them.
    pub albedo_bias: Bias,
}

/// Measures `contenders` at every `every`-th held-out place of each stratum of the domain of `material`; one result for
/// each, in their order.
///
/// # Errors
/// [`crate::Error::Interrupted`] when `tick` breaks; as [`heldout::places`] and [`Truth::new`]; what a contender returns.
pub fn standings(
    material: &Material,
    contenders: &[Contender],
    every: usize,
    tick: Tick,
) -> Result<Vec<Standings>> {
    let strata = heldout::places(material)?;
    let all: Vec<(&String, &HeldOut)> = strata
        .iter()
        .flat_map(|(name, places)| places.iter().step_by(every).map(move |place| (name, place)))
        .collect();
    let done = AtomicU64::new(0);
    let measured: Result<Vec<Vec<Errors>>> = all
        .par_iter()
        .enumerate()
        .with_max_len(1)
        .map(|(seed, (_, place))| {
            let errors = at_place(material, place, contenders, seed as u64)?;
            advance(&done, all.len(), tick)?;
            Ok(errors)
        })
        .collect();
    let measured = measured?;
    let of = |contender: usize| {
        let rows = |name: &str| -> Vec<Errors> {
            let rows = all.iter().zip(&measured);
            rows.filter(|((stratum, _), _)| stratum.as_str() == name)
                .map(|(_, errors)| errors[contender])
                .collect()
        };
        let everywhere: Vec<Errors> = measured.iter().map(|errors| errors[contender]).collect();
        Standings {
            strata: strata
                .keys()
                .map(|name| (name.clone(), summarise(&rows(name))))
                .collect(),
            albedo_bias: bias(&everywhere),
        }
    };
    Ok((0..contenders.len()).map(of).collect())
}

fn at_place(
    material: &Material,
    place: &HeldOut,
    contenders: &[Contender],
    seed: u64,
) -> Result<Vec<Errors>> {
    let reference = material.bind(&place.params)?;
    let truth = Truth::new(&reference, place.wo)?;
    let one = |contender: &Contender| {
        let mut sampler = contender(place, &truth)?;
        measure(sampler.as_mut(), &reference, &truth, seed)
    };
    contenders.iter().map(one).collect()
}

fn bias(rows: &[Errors]) -> Bias {
    Bias::of(&rows.iter().map(|e| e.albedo_bias).collect::<Vec<_>>())
}

fn summarise(rows: &[Errors]) -> Standing {
    let mean = |f: fn(&Errors) -> f64| rows.iter().map(f).sum::<f64>() / rows.len() as f64;
    let max = |f: fn(&Errors) -> f64| rows.iter().map(f).fold(0.0, f64::max);
    let spread = |f: fn(&Errors) -> f64| Spread {
        mean: mean(f),
        worst: max(f),
    };
    Standing {
        binning_l1: spread(|e| e.binning_l1),
        binning_floor: mean(|e| e.binning_floor),
        lost: mean(|e| e.lost),
        weight_relvar: spread(|e| e.weight_relvar),
        weight_max: max(|e| e.weight_max),
        albedo_bias: bias(rows),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::comparators::blinn_phong::BlinnPhong;
    use crate::error::Error;
    use bake_runtime::Family;
    use std::ops::ControlFlow;

    /// Of 32 places per stratum.
    const EVERY: usize = 32;

    fn plastic() -> Material {
        Material::fixed("plastic", Family::Principled, &[("roughness", &[0.5])]).expect("valid parameters")
    }

    #[test]
    fn contenders_are_measured_at_the_same_places() {
        let material = plastic();
        let fit: Contender = &|_, truth| Ok(Box::new(BlinnPhong::fit(&truth.lobes)));
        let cosine: Contender = &|place, _| {
            Ok(Box::new(BlinnPhong {
                wo: place.wo,
                exponent: 1.0,
                share: 0.0,
            }))
        };
        let found = standings(&material, &[fit, cosine, fit], EVERY, &|_, _| {
            ControlFlow::Continue(())
        });
        let [first, plain, again] = &found.expect("bright slices")[..] else {
            panic!("one result each");
        };
        assert_eq!(first, again);
        assert_eq!(first.strata.len(), heldout::STRATA.len());
        for (name, fitted) in &first.strata {
            let plain = &plain.strata[name];
            assert!(fitted.binning_l1.mean < plain.binning_l1.mean, "{name}");
            assert!(fitted.weight_relvar.mean < plain.weight_relvar.mean, "{name}");
            assert_eq!((plain.lost, fitted.binning_floor), (0.0, plain.binning_floor));
        }
    }

    #[test]
    fn ticks_stop_it() {
        let cosine: Contender = &|place, _| {
            Ok(Box::new(BlinnPhong {
                wo: place.wo,
                exponent: 1.0,
                share: 0.0,
            }))
        };
        let stopped = standings(&plastic(), &[cosine], EVERY, &|_, _| ControlFlow::Break(()));
        assert!(matches!(stopped, Err(Error::Interrupted)));
    }
}
